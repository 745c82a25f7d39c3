"""The leaderboard's rows, from results alone: one dictionary for each policy in a scenario."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from visenvs.core.lanes import Task

from .metrics import EFFORT, MISS, NEES, failure_rate, mean_of, success_rate
from .results import Result
from .stats import compare, interquartile_mean, mean_interval, percentile

TAIL = 95.0  # percentile of the cost that stands for the tail
FAR = 99.0  # percentile of the metrics that a task wants shown
TRUTH = "truth"  # the estimator that tells policies the truth
KEYS = (
    *("env", "scenario", "estimator", "perception", "policy", "label", "information", "episodes"),
    *("cost_mean", "cost_median", "cost_iqm", "cost_ci", "cost_p95"),
    *(
        "success_rate",
        "failure_rate",
        "lost_rate",
        "aside_mean",
        "miss_mean",
        "effort_mean",
        "nees_mean",
    ),
    *("diff_to", "diff_mean", "diff_ci", "prob_improvement", "us_per_decision", "reason"),
)
Row = dict[str, Any]  # SI; None where there is nothing to say


@dataclass(frozen=True)
class Board:
    """One scenario of one environment.

    Attributes:
        rows: best first: those under the scenario's estimator, those told the truth, those that
            cannot fly here.
        results: for every row its result, or None for a policy that cannot fly here.
    """

    task: Task
    scenario: str
    rows: tuple[Row, ...]
    results: tuple[Result | None, ...]


def make_board(task: Task, scenario: str, lines: Sequence[tuple[Row, Result | None]]) -> Board:
    """A board of rows with their results, put in order; labels that are not alone are as typed."""
    times = Counter(row["label"] for row, _ in lines)
    lines = [
        (row | {"label": row["policy" if times[row["label"]] > 1 else "label"]}, result)
        for row, result in lines
    ]
    ranked = sorted(lines, key=lambda line: _rank(line[0]))
    rows, results = tuple(row for row, _ in ranked), tuple(result for _, result in ranked)
    return Board(task, scenario, rows, results)


def result_row(
    task: Task, result: Result, reference: Result | None, beside: Result | None = None
) -> Row:
    """The row of a policy, compared with the reference on the same seeds if there is one.

    It has KEYS and, for each metric in `task.shown`, its mean by its name and `NAME_p99`. `beside`
    is what the policy came to in the scenario `task.aside`.
    """
    episodes = result.episodes
    cost = episodes.cost
    row: Row = dict.fromkeys(KEYS) | {key: vars(result)[key] for key in KEYS if key in vars(result)}
    row |= {
        "episodes": len(cost),
        "cost_mean": float(np.mean(cost)),
        "cost_median": float(np.median(cost)),
        "cost_iqm": interquartile_mean(cost),
        "cost_ci": mean_interval(cost),
        "cost_p95": percentile(cost, TAIL),
        "success_rate": success_rate(episodes),
        "failure_rate": failure_rate(episodes),
        "miss_mean": mean_of(episodes, MISS),
        "effort_mean": mean_of(episodes, EFFORT),
        "nees_mean": None if result.estimator == TRUTH else mean_of(episodes, NEES),
    }
    if math.isfinite(task.lost_above):
        row["lost_rate"] = float(np.mean(cost > task.lost_above))
    if beside is not None:
        row["aside_mean"] = float(np.mean(beside.episodes.cost))
    for name in task.shown:
        values = episodes.metrics[name]
        row |= {name: mean_of(episodes, name), far_end(name): percentile(values, FAR)}
    if reference is not None:
        against = compare(cost, reference.episodes.cost)
        row |= {
            "diff_to": reference.policy,
            "diff_mean": against.mean,
            "diff_ci": against.interval,
            "prob_improvement": against.better,
        }
    return row


def missing_row(
    env: str, scenario: str, estimator: str, perception: str, policy: str, reason: str
) -> Row:
    """The row of a policy that cannot fly here, with the reason."""
    return dict.fromkeys(KEYS) | {
        "env": env,
        "scenario": scenario,
        "estimator": estimator,
        "perception": perception,
        "policy": policy,
        "label": policy,
        "episodes": 0,
        "reason": reason,
    }


def far_end(metric: str) -> str:
    """The key of a shown metric's 99th percentile."""
    return f"{metric}_p{FAR:.0f}"


def is_reference(row: Row) -> bool:
    """Whether this row is the one that the others of its scenario are compared with."""
    return row["policy"] == row["diff_to"] and row["diff_mean"] == 0.0


def _rank(row: Row) -> tuple[int, float]:
    if row["reason"] is not None:
        return 2, 0.0
    return int(row["estimator"] == TRUTH), row["cost_mean"]
