"""What figures 8, 10 and 11 of the tracking paper and the string share: whole flights by law.

All figures are in feet, as in the paper, which prints none of these numbers but in words.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from agents.registry import load
from visenvs.core.lanes import Lanes
from visenvs.core.outcome import SUCCESS
from visenvs.core.units import FOOT

from ..rollout import PUBLIC_SEEDS, decide
from ._formation import scene

Values = NDArray[np.float64]

LOG = np.dtype([
    ("flies", "?"),  # whether the flight had not ended before
    ("r_V_N", "f8", 3), ("v_V_F", "f8", 3), ("a_V_F", "f8", 3),
    ("offset_F", "f8", 3), ("tracking_error", "f8", 3),
    ("rhat_LV_F", "f8", 3), ("vhat_LV_F", "f8", 3), ("ahat_L_F", "f8", 3),
    ("sd_log_range", "f8"), ("seen", "f8"), ("outcome", "i8"), ("heading", "f8"),
])  # fmt: skip


@cache
def watch(scenario: str, law: str, episodes: int, **changes: Any) -> NDArray[Any]:
    """Whole flights on the first public seeds, one LOG record per step, (steps, n, team).

    The records of a vehicle stay as they were when it ended.
    """
    task, config = scene(scenario, **changes)
    policy = load(law, task, config).policy
    team = task.team(config)
    lanes = Lanes(task, config, episodes * team)
    lanes.reset(PUBLIC_SEEDS[:episodes])
    start, state, out = np.ones(lanes.count, bool), None, []
    while not lanes.done.all():
        entry = np.zeros(lanes.count, LOG)
        entry["flies"] = ~lanes.done
        actions, state = decide(policy, lanes.rows, state, start)
        lanes.step(actions)
        start = np.zeros(lanes.count, bool)
        for name in LOG.names[1:] if LOG.names else ():
            entry[name] = lanes.records[name]
        out.append(entry.reshape(episodes, team))
    return np.array(out)


def times(log: NDArray[Any], dt: float = 0.1) -> NDArray[Any]:
    """Times of the records, s, (steps,)."""
    return dt * np.arange(1, len(log) + 1)


def kept(log: NDArray[Any]) -> NDArray[np.bool_]:
    """Flights in which nobody lost the leader, (n,)."""
    return (log["outcome"][-1] == SUCCESS).all(axis=-1)


def errors(log: NDArray[Any]) -> Values:
    """Estimated minus true relative position in F, ft, (steps, n, team, 3); NaN once ended."""
    out = (log["rhat_LV_F"] - log["offset_F"] - log["tracking_error"]) / FOOT
    return np.where(log["flies"][..., None], out, np.nan)


def off_place(log: NDArray[Any]) -> Values:
    """True minus commanded relative position in F, ft, (steps, n, team, 3); NaN once ended."""
    return np.where(log["flies"][..., None], log["tracking_error"] / FOOT, np.nan)
