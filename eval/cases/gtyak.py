"""Figures 12 and 13 of the thesis: the GTYak behind the circling GTEdge, as `gtmax`."""

from __future__ import annotations

from pathlib import Path

from . import Row
from ._formation import circling_rows, compare_plot

CASE = "gtyak"


def rows(episodes: int) -> list[Row]:
    """RMSE with the lateral acceleration estimated, and the failures without."""
    return circling_rows(CASE, 7.5, (0.70, 0.17, 0.22), episodes)


def plot(folder: Path, episodes: int) -> Path:
    """Truth against estimate, as in figures 12 and 13."""
    return compare_plot(folder, CASE, ("ekf", "ekf-natural"))
