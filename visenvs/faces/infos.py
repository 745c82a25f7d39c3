"""Step information as Gymnasium wants it: a dictionary for one lane, masked arrays for many."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from visenvs.core.lanes import Lanes, Task
from visenvs.core.layout import Choices, Values
from visenvs.core.outcome import Outcome

Mask = NDArray[np.bool_]
OUTCOMES = np.array([outcome.name.lower() for outcome in Outcome], object)


def term_names(task: Task) -> tuple[str, ...]:
    """Names of the reward terms: those of the cost fields without their prefix."""
    return tuple(name.removeprefix("cost_") for name in task.costs)


def final_info(lanes: Lanes) -> dict[str, Any]:
    """How the episode of a single lane has ended."""
    metrics = lanes.results(0)
    outcome = metrics.pop("outcome")
    return {"outcome": outcome.name.lower(), "metrics": metrics}


def mask_info(lanes: Lanes) -> dict[str, Any]:
    """Which choices a single lane may take, as Gymnasium's spaces want masks."""
    return {"action_mask": lanes.allowed[0].astype(np.int8)}


def mask_infos(lanes: Lanes, where: Mask | np.bool_) -> dict[str, Any]:
    """Which choices the lanes may take, (count, choices), where they have just been asked."""
    if not isinstance(lanes.task.action, Choices):
        return {}
    asked = np.broadcast_to(where, lanes.count)
    return _masked({"action_mask": (lanes.allowed & asked[:, None]).astype(np.int8)}, asked)


def vector_infos(lanes: Lanes, done: Mask) -> dict[str, Any]:
    """The infos of a step, before the lanes that are done begin anew.

    The same as `gymnasium.vector.SyncVectorEnv` in mode SAME_STEP assembles from single infos, one
    lane at a time: running lanes have `reward_terms`, the others `final_obs` and `final_info`.
    """
    running = ~done
    terms = dict(zip(term_names(lanes.task), lanes.terms.T, strict=True))
    infos: dict[str, Any] = {}
    if running.any():
        infos |= _masked({"reward_terms": _numbers(terms, running)}, running)
    if done.any():
        rows = np.full(lanes.count, None, object)
        outcomes = rows.copy()
        for i in np.flatnonzero(done):
            rows[i] = lanes.rows[i].copy()
        outcomes[done] = OUTCOMES[lanes.outcome[done]]
        metrics = {name: lanes.records[name] for name in lanes.task.metrics}
        final = {
            "reward_terms": _numbers(terms, done),
            "outcome": outcomes,
            "metrics": _numbers(metrics, done),
        }
        final = _masked(final, done) | mask_infos(lanes, done)
        infos |= _masked({"final_obs": rows, "final_info": final}, done)
    return infos


def _numbers(values: Mapping[str, Values], mask: Mask) -> dict[str, Any]:
    """Each array with zeros outside the mask, and its mask."""
    return _masked({name: np.where(mask, value, 0.0) for name, value in values.items()}, mask)


def _masked(values: Mapping[str, Any], mask: Mask) -> dict[str, Any]:
    """Each value, and as `_name` which lanes have it."""
    return dict(values) | {f"_{name}": mask.copy() for name in values}
