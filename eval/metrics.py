"""What each episode came to: pure functions of the final lane records of a rollout."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from visenvs.core.lanes import Task
from visenvs.core.outcome import Outcome

from .rollout import Rollout

COST = "total_cost"  # every environment has it, SI
MISS, EFFORT, NEES = "miss_distance", "control_cost", "nees_mean"  # where the environment has them


@dataclass(frozen=True)
class Episodes:
    """One entry per seed, in the order of `seeds`.

    Attributes:
        seeds: shape (n,).
        outcomes: names of `Outcome` in lower case, n of them.
        metrics: the environment's metrics by name, SI, each of shape (n,); NaN where the episode
            diverged, except for the cost, which is infinite there.
    """

    seeds: NDArray[np.int64]
    outcomes: tuple[str, ...]
    metrics: dict[str, NDArray[np.float64]]

    @property
    def cost(self) -> NDArray[np.float64]:
        """The task's published cost J of every seed, shape (n,)."""
        return self.metrics[COST]


def measure(flown: Rollout, task: Task) -> Episodes:
    """Outcome and metrics of every seed of a rollout."""
    if COST not in task.metrics:
        raise ValueError(f'{task.id} must report its cost: add "{COST}" to Task.metrics')
    return Episodes(
        seeds=flown.seeds,
        outcomes=tuple(Outcome(int(code)).name.lower() for code in flown.records["outcome"]),
        metrics={name: metric(flown.records, name) for name in task.metrics},
    )


def metric(records: NDArray[Any], name: str) -> NDArray[np.float64]:
    """One field of final lane records (n,); a diverged episode has none, and costs infinity."""
    values = records[name].astype(np.float64)
    values[records["outcome"] == Outcome.DIVERGED] = np.inf if name == COST else np.nan
    return values


def success_rate(episodes: Episodes) -> float:
    """Share of episodes with outcome success."""
    return episodes.outcomes.count(Outcome.SUCCESS.name.lower()) / len(episodes.outcomes)


def failure_rate(episodes: Episodes) -> float:
    """Share of episodes with any other outcome."""
    return 1.0 - success_rate(episodes)


def mean_of(episodes: Episodes, name: str) -> float | None:
    """Mean of a metric over the episodes that have it; None if none does."""
    values = episodes.metrics.get(name)
    if values is None or np.isnan(values).all():
        return None
    return float(np.nanmean(values))
