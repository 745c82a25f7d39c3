"""Figure 7 of the thesis: behind a leader that flies straight, with a wingspan told right or wrong.

The picture shows a bias in range that shrinks after lateral motion: the wingspan was told wrong.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from visenvs.core.units import FOOT

from . import Row
from ._formation import compare_plot, errors, figure, fly, kept, lost_row, record, rmse_rows
from ._formation import root_mean as root

CASE, SCENARIO = "fig7", "straight"
MOST = (0.65, 0.18, 0.17)  # ft
BEFORE, AFTER = slice(200, 300), slice(1000, 1300)  # steps before and after the lateral motion


def rows(episodes: int) -> list[Row]:
    """RMSE, then the wrong wingspan, then no wing-tip angle."""
    out: list[Row] = []
    for filter_ in ("ekf", "ekf-log", "ekf-natural"):
        flown = fly(SCENARIO, episodes, estimator=filter_)
        best = filter_ == "ekf"
        out += rmse_rows(f"{CASE}/{filter_}", flown, MOST if best else (None, None, None))
        out.append(lost_row(f"{CASE}/{filter_}", flown, high=0.0 if best else None))
    for filter_ in ("ekf-log", "ekf-natural"):
        out += bias_rows(f"{CASE}/{filter_}/b0+5%", filter_, episodes)
    blind = fly(SCENARIO, episodes, wings="none", range_bias=0.2)
    square = kept(blind)["square_r"][:, 0] / FOOT**2
    return [
        *out,
        figure(f"{CASE}/no-alpha/X_ft", square, root, low=10.0),
        lost_row(f"{CASE}/no-alpha", blind),
    ]


def bias_rows(at: str, estimator: str, episodes: int) -> list[Row]:
    """Mean error of X before and after the lateral motion, and how much it has shrunk, ft."""
    log = record(SCENARIO, episodes, estimator=estimator, size_bias=0.05)
    whole = log["outcome"][AFTER.start] == 0
    x = errors(log)[:, whole, 0]
    before, after = np.mean(x[BEFORE], axis=0), np.mean(x[AFTER], axis=0)
    return [
        figure(f"{at}/X_bias_before_ft", before),
        figure(f"{at}/X_bias_after_ft", after),
        figure(f"{at}/X_bias_shrinks_ft", before - after, low=0.5),
    ]


def plot(folder: Path, episodes: int) -> Path:
    """Truth against estimate, as in figure 7."""
    return compare_plot(folder, SCENARIO, ("ekf", "ekf-natural"), CASE)
