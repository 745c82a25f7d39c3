"""What the figures of obstacle avoidance share: flights on the first public seeds, and means."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from agents.registry import load
from visenvs.core.config import override
from visenvs.core.registry import load_task

from ..rollout import PUBLIC_SEEDS, rollout
from . import Row, standard_error


@cache
def fly(scenario: str, law: str, episodes: int, *changes: tuple[str, Any]) -> NDArray[Any]:
    """Final lane records of a scenario under a law, with settings changed."""
    task = load_task("visenvs/Avoidance-v0")
    config = override(task.scenarios[scenario], dict(changes))
    policy = load(law, task, config).policy
    return rollout(policy, task, config, PUBLIC_SEEDS[:episodes]).records


def mean(
    row_id: str,
    values: NDArray[Any],
    paper: float | None = None,
    low: float | None = None,
    high: float | None = None,
) -> Row:
    """Mean of values (n,), or the share of those that are True, beside the published figure."""
    numbers = np.asarray(values, float)
    error = standard_error(numbers)
    return Row(row_id, paper, float(numbers.mean()), error, len(numbers), low, high)


def median(
    row_id: str,
    values: NDArray[Any],
    paper: float | None = None,
    low: float | None = None,
    high: float | None = None,
) -> Row:
    """Median of values (n,) beside the published figure."""
    error = standard_error(values, np.median)
    return Row(row_id, paper, float(np.median(values)), error, len(values), low, high)
