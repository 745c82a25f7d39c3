"""Figure 19 of the thesis (2.4.4): the map of grid terrain, every 50 s; in feet.

It is flat at the start, since new lines are taken to lie at zero altitude.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from . import Row
from ._mapping import draw_lines, median
from ._terrain import MOMENTS, moments, point_errors

CASE = "fig19"
SHOWN = (0, 50, 100, 150, 200)  # s


def rows(episodes: int) -> list[Row]:
    """Median error of the points seen so far, ft, and how many these are, as time goes by."""
    out: list[Row] = []
    rooms = moments("four", episodes)
    for moment in SHOWN:
        errors = np.array([point_errors(room) for room in rooms[MOMENTS.index(moment)]])
        at, high = f"{CASE}/t={moment}", 0.03 if moment == SHOWN[-1] else None
        out.append(median(f"{at}/points", np.sum(np.isfinite(errors), axis=1)))
        out.append(median(f"{at}/median_ft", np.nanmedian(errors, axis=1), None, high))
    return out


def plot(folder: Path, episodes: int) -> Path:
    """Truth and map at the five moments, first seed; returns the file."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(16, 3.8), layout="constrained")
    FigureCanvasAgg(figure)
    rooms = moments("four", episodes)
    for k, moment in enumerate(SHOWN):
        axes: Any = figure.add_subplot(1, len(SHOWN), k + 1, projection="3d")
        draw_lines(axes, rooms[MOMENTS.index(moment)][0])
        wide = (-160.0, 160.0)
        axes.set(title=f"t = {moment} s", xlim=wide, ylim=wide, zlim=(0.0, 60.0))
        axes.set_box_aspect((1.0, 1.0, 0.3), zoom=1.1)
    file = folder / f"{CASE}.png"
    figure.savefig(file, dpi=110)
    return file
