"""Figure 10 of the thesis: the GTMax behind the circling GTEdge, position and velocity."""

from __future__ import annotations

from pathlib import Path

from . import Row
from ._formation import circling_rows, compare_plot

CASE = "gtmax"


def rows(episodes: int) -> list[Row]:
    """RMSE with the lateral acceleration estimated, and the failures without."""
    return circling_rows(CASE, 6.5, (0.95, 0.24, 0.24), episodes)


def plot(folder: Path, episodes: int) -> Path:
    """Truth against estimate, as in figure 10."""
    return compare_plot(folder, CASE, ("ekf", "ekf-natural"))
