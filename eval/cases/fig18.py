"""Figure 18 of the thesis (2.4.4): errors of points of grid terrain, and of three of them; in feet.

The thesis numbers 256 points and draws the errors of 73, 139 and 227, which it picked at random;
its numbering is not given, here it is row by row from the south-west, from 1. At the rim of the
camera's reach edges are seen rarely and from one side, so that few points make the mean square:
medians and 95th percentiles are told.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from visenvs.core.units import FOOT

from . import Row
from ._mapping import median
from ._terrain import MOMENTS, POINTS, moments, point_errors, true_points

CASE = "fig18"
SAMPLES = (73, 139, 227)
BANDS = {"d-only": 0.15, "four": 0.03}  # median error, ft


def rows(episodes: int) -> list[Row]:
    """Points seen, median and 95th percentile of their errors at the end, three of them, ft."""
    out: list[Row] = []
    for estimator, most in BANDS.items():
        at = f"{CASE}/{estimator}"
        errors = np.array([point_errors(room) for room in moments(estimator, episodes)[-1]])
        seen = np.sum(np.isfinite(errors), axis=1)
        out.append(Row(f"{at}/points_least", None, seen.min(), 0.0, len(errors), 210, None))
        out.append(median(f"{at}/median_ft", np.nanmedian(errors, axis=1), None, most))
        out.append(median(f"{at}/p95_ft", np.nanpercentile(errors, 95, axis=1)))
        for number in SAMPLES:
            of_point = errors[:, number - 1]
            out.append(median(f"{at}/point_{number}_ft", of_point[np.isfinite(of_point)]))
    return out


def plot(folder: Path, episodes: int) -> Path:
    """Where the three points are, and their errors against time, first seed; returns the file."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11, 4.4), layout="constrained")
    FigureCanvasAgg(figure)
    places, curves = figure.subplots(1, 2)
    flown = {estimator: moments(estimator, episodes) for estimator in BANDS}
    grid = true_points(flown["four"][0][0])[:, 2].reshape(POINTS, POINTS)
    heights: Any = places.imshow(-grid / FOOT, origin="lower", cmap="terrain")
    figure.colorbar(heights, ax=places, label="height (ft)")
    for estimator, style in zip(BANDS, ("--", "-"), strict=True):
        errors = np.array([point_errors(rooms[0]) for rooms in flown[estimator]])
        for colour, number in enumerate(SAMPLES):
            label = f"point {number}, {estimator}"
            curves.semilogy(MOMENTS, errors[:, number - 1], f"C{colour}{style}", label=label)
    for number in SAMPLES:
        row, column = divmod(number - 1, POINTS)
        places.plot(column, row, "k.")
        places.annotate(str(number), (column, row), (4, 4), textcoords="offset points")
    curves.set(xlabel="time (s)", ylabel="error (ft)", title="three points, first seed")
    curves.legend(fontsize=8)
    curves.grid(alpha=0.3)
    file = folder / f"{CASE}.png"
    figure.savefig(file, dpi=110)
    return file
