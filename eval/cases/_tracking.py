"""What tables 2 to 5 and figures 47 and 50 of the thesis share: its 2-D tracking example."""

from __future__ import annotations

import time
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.progress import track

from agents.registry import load
from visenvs.core.config import Config
from visenvs.core.lanes import Lanes, Task
from visenvs.core.registry import load_task
from visenvs.core.units import FOOT

from ..rollout import PUBLIC_SEEDS, rollout
from . import Row, standard_error

CHUNK = 50  # seeds between two updates of the progress bar
TIMED = 20  # episodes that are timed one by one
SOLVERS = {"exact": "", "gauss_seidel": "-gs"}
PARTS = {"Jf": "terminal_cost", "Jc": "control_cost", "J": "total_cost"}
Published = dict[str, float]
Bands = dict[str, dict[int, dict[str, tuple[float, float]]]]  # by solver, horizon, part


def scene() -> tuple[Task, Config]:
    """The thesis's scenario."""
    task = load_task("visenvs/Tracking2D-v0")
    return task, task.scenarios["thesis"]


@cache
def fly(law: str, episodes: int) -> NDArray[Any]:
    """Final lane records of the thesis's scenario under a law, on the first public seeds."""
    task, config = scene()
    policy = load(law, task, config).policy
    parts = [PUBLIC_SEEDS[i : i + CHUNK] for i in range(0, episodes, CHUNK)]
    seeds = [part[: episodes - i * CHUNK] for i, part in enumerate(parts)]
    shown = track(seeds, law, transient=True, console=Console(stderr=True))
    return np.concatenate([rollout(policy, task, config, part).records for part in shown])


@cache
def seconds(law: str, episodes: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """CPU time of a law's first decision and of all decisions of an episode, per seed, s."""
    task, config = scene()
    policy = load(law, task, config).policy
    first, total = np.zeros(episodes), np.zeros(episodes)
    rollout(policy, task, config, PUBLIC_SEEDS[:1])  # compile
    for i in track(range(episodes), law, transient=True, console=Console(stderr=True)):
        lanes = Lanes(task, config, 1)
        lanes.reset([PUBLIC_SEEDS[i]])
        began = time.process_time()
        policy.predict(lanes.rows)
        first[i] = time.process_time() - began
        total[i] = rollout(policy, task, config, PUBLIC_SEEDS[i : i + 1]).decision_seconds
    return first, total


def timing_rows(at: str, law: str, episodes: int, step: float, whole: float) -> list[Row]:
    """Processing times beside the published ones (s), and the first step's as two ratios.

    `share_of_period` is over the control period, `over_thesis` over the published time.
    """
    first, total = seconds(law, min(episodes, TIMED))
    n, period = len(first), vars(scene()[1])["dt"]
    shares, times = first / period, first / step
    return [
        Row(f"{at}/step_s", step, first.mean(), standard_error(first), n),
        Row(f"{at}/total_s", whole, total.mean(), standard_error(total), n),
        Row(f"{at}/share_of_period", step / period, shares.mean(), standard_error(shares), n),
        Row(f"{at}/over_thesis", 1.0, times.mean(), standard_error(times), n),
    ]


def costs(law: str, episodes: int) -> dict[str, NDArray[np.float64]]:
    """Tracking error, control effort and total cost per seed, ft^2/s^3."""
    return {part: fly(law, episodes)[field] / FOOT**2 for part, field in PARTS.items()}


def cost_rows(
    case: str, family: str, letter: str, episodes: int, paper: dict[int, Published], bands: Bands
) -> list[Row]:
    """Both solvers for every published horizon, `CASE/SOLVER/LETTER=HORIZON/PART`."""
    return [
        row
        for solver, suffix in SOLVERS.items()
        for ahead, published in paper.items()
        for row in mean_costs(
            f"{case}/{solver}/{letter}={ahead}",
            f"{family}-{ahead}{suffix}",
            episodes,
            published,
            bands[solver].get(ahead, {}),
        )
    ]


def time_rows(
    case: str, family: str, letter: str, episodes: int, paper: dict[int, tuple[float, float]]
) -> list[Row]:
    """Both solvers for every published horizon with its times of the first step and a flight, s."""
    return [
        row
        for solver, suffix in SOLVERS.items()
        for ahead, (step, whole) in paper.items()
        for row in timing_rows(
            f"{case}/{solver}/{letter}={ahead}", f"{family}-{ahead}{suffix}", episodes, step, whole
        )
    ]


def mean_costs(
    at: str, law: str, episodes: int, published: Published, bands: dict[str, tuple[float, float]]
) -> list[Row]:
    """Mean costs beside the published ones."""
    out: list[Row] = []
    for part, values in costs(law, episodes).items():
        low, high = bands.get(part, (None, None))
        mean, error = float(values.mean()), standard_error(values)
        out.append(Row(f"{at}/{part}", published[part], mean, error, episodes, low, high))
    return out
