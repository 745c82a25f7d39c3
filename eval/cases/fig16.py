"""Figure 16 of the thesis (2.4.4): a square frame from a zig-zag, of which the camera sees parts.

The frame has sides of 60 ft, 10 ft above ground; the aircraft flies at 40 ft and 15 ft/s, with an
image every 0.02 s, and looks straight down. Lines grow as more of their edges comes into view. The
thesis's map lacks parts of one edge; without any extension a third of the length would be missing.

The thesis gives no path. Of zig-zags in four legs that reach 30 to 38 ft to the sides, 34 ft stays
farthest below both bands on seeds 50000 to 50059; 38 ft leaves parts of the frame unseen.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from visenvs.core.units import FOOT

from ..rollout import PUBLIC_SEEDS
from . import Row
from ._mapping import coverage, down, draw_lines, fly, median, settings, start, work
from .fig15 import counted, errors

CASE = "fig16"
ALTITUDE, HALF, LEGS, STEP = 40 * FOOT, 34 * FOOT, 4, 15 * FOOT * 0.02
DRAWN = (1, 400, 2000)  # images after which the picture is made
BANDS = {"d-only": 0.11, "four": 0.03}  # ends, ft


def rows(episodes: int) -> list[Row]:
    """Coverage, edges found, lines beyond four, and median errors of ends and lines, ft."""
    out: list[Row] = []
    for estimator, end in BANDS.items():
        at, rooms = f"{CASE}/{estimator}", flight(estimator, 0.5, episodes)
        found, ends, lines = errors(rooms)
        out.append(median(f"{at}/coverage", [coverage(room) for room in rooms], 0.99, None))
        out.append(Row(f"{at}/edges_least", 4, found.min(), 0.0, episodes, 4, 4))
        out.append(Row(f"{at}/lines_mean", 4, counted(rooms).mean(), 0.0, episodes))
        out.append(median(f"{at}/end_ft", ends, None, end))
        out.append(median(f"{at}/line_ft", lines))
    rooms = flight("four", 0.0, episodes)
    at = f"{CASE}/no-extension"
    out.append(median(f"{at}/coverage", [coverage(room) for room in rooms]))
    out.append(Row(f"{at}/lines_mean", 4, counted(rooms).mean(), 0.0, episodes))
    return out


@cache
def flight(estimator: str, extend_max: float, episodes: int) -> NDArray[Any]:
    """The rooms of all seeds after the zig-zag."""
    config = settings("frame", estimator, extend_max=extend_max)
    seeds = np.array(PUBLIC_SEEDS[:episodes], np.uint64)
    rooms, path = start(config, seeds), zigzag()
    fly(rooms, seeds, path, down(path), 0, config, work())
    return rooms


def zigzag() -> NDArray[np.float64]:
    """Places of all images, m, N, (n, 3): to and fro, 4 ft beyond the edges."""
    corners = [(HALF * (2 * k / LEGS - 1), HALF if k % 2 else -HALF) for k in range(LEGS + 1)]
    length = np.hypot(2 * HALF, 2 * HALF / LEGS)
    along = np.arange(0.0, LEGS * length, STEP) / length
    north, east = (np.interp(along, np.arange(LEGS + 1), axis) for axis in np.transpose(corners))
    return np.stack([north, east, np.full(len(along), -ALTITUDE)], axis=1)


def plot(folder: Path, episodes: int) -> Path:
    """The map of the first seed after 1, 400 and all images; returns the file."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(13, 4.6), layout="constrained")
    FigureCanvasAgg(figure)
    config, seeds = settings("frame", "four"), np.array(PUBLIC_SEEDS[:1], np.uint64)
    for k, images in enumerate(DRAWN):
        rooms, path = start(config, seeds), zigzag()[:images]
        fly(rooms, seeds, path, down(path), 0, config, work())
        axes: Any = figure.add_subplot(1, len(DRAWN), k + 1, projection="3d")
        draw_lines(axes, rooms[0])
        north, east, below = path.T / FOOT
        axes.plot(east, north, -below, color="tab:red", linewidth=1.0)
        axes.set_title(f"after {len(path)} images")
    file = folder / f"{CASE}.png"
    figure.savefig(file, dpi=110)
    return file
