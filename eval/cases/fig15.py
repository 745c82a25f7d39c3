"""Figure 15 of the thesis (2.4.4): a pyramid from one turn of a circle, 1000 images; in feet.

The camera is tilted 30 degrees from straight down. A wings-level aircraft with that mount angle
forwards would not keep the pyramid in view, so it is taken to look inwards: 100 ft above ground, on
a circle of radius 57.7 ft. Distances d alone leave the ends free to slide along their lines; with
d and e the ends are as good as the lines.

`split` sees half of the edges in two parts. The published update adds up the gains of both, each
from the same P^- (2.40)-(2.41), and its covariance is none any more. The errors at the end hardly
tell: a broken line is lost, deleted and begun again, which `lines_made` tells.
"""

from __future__ import annotations

import math
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from visenvs.core.units import FOOT

from ..rollout import PUBLIC_SEEDS
from . import Row, standard_error
from ._mapping import circle, draw_lines, fly, line_errors, median, rms, settings, start, work

CASE = "fig15"
ALTITUDE, TILT, IMAGES = 100 * FOOT, math.pi / 6, 1000
SPLIT = 0.5  # chance that an edge is seen in two parts
DRAWN = (1, 250, 1000)  # images after which the picture is made
BANDS = {"d-only": (0.45, 0.02), "four": (0.025, 0.02)}  # ends, lines, ft


def rows(episodes: int) -> list[Row]:
    """Edges found, wrong associations, and median errors of ends and lines, ft."""
    out: list[Row] = []
    for estimator, (end, line) in BANDS.items():
        at, rooms = f"{CASE}/{estimator}", flight(estimator, 0.0, episodes)
        found, ends, lines = errors(rooms)
        out.append(Row(f"{at}/edges_least", 8, found.min(), 0.0, episodes, 8, 8))
        out.append(Row(f"{at}/lines_most", 8, counted(rooms).max(), 0.0, episodes, 8, 8))
        wrong = rooms["map"]["wrong"]
        out.append(Row(f"{at}/seeds_with_wrong", None, int((wrong > 0).sum()), 0.0, episodes, 0, 0))
        out.append(Row(f"{at}/wrong_mean_of_8000", None, wrong.mean(), 0.0, episodes))
        out.append(median(f"{at}/end_ft", ends, None, end))
        out.append(median(f"{at}/line_ft", lines, None, line))
    for estimator in ("four", "d-only", "printed"):
        at, rooms = f"{CASE}/split/{estimator}", flight(estimator, SPLIT, episodes)
        _, ends, lines = errors(rooms)
        broken = rooms["map"]["indefinite"]
        low, high = (1.0, None) if estimator == "printed" else (0.0, 0.0)
        out.append(Row(f"{at}/indefinite_mean", None, broken.mean(), 0.0, episodes, low, high))
        for name, counts in (
            ("lines_made", rooms["map"]["made"]),
            ("wrong", rooms["map"]["wrong"]),
        ):
            out.append(
                Row(f"{at}/{name}_mean", None, counts.mean(), standard_error(counts), episodes)
            )
        out.append(median(f"{at}/end_ft", ends))
        out.append(median(f"{at}/line_ft", lines))
    return out


@cache
def flight(estimator: str, p_split: float, episodes: int) -> NDArray[Any]:
    """The rooms of all seeds after the turn."""
    config = settings("pyramid", estimator, p_split=p_split)
    seeds = np.array(PUBLIC_SEEDS[:episodes], np.uint64)
    rooms = start(config, seeds)
    path, gaze = turn(IMAGES)
    fly(rooms, seeds, path, gaze, 0, config, work())
    return rooms


def turn(images: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Places and gazes of the first images of the turn."""
    angles = 2.0 * math.pi * np.arange(images) / IMAGES
    path = circle(ALTITUDE * math.tan(TILT), ALTITUDE, angles)
    return path, path * (-1.0, -1.0, 0.0) + (0.0, 0.0, ALTITUDE)


def errors(rooms: NDArray[Any]) -> tuple[NDArray[Any], list[float], list[float]]:
    """Edges with a line, and RMS errors of their ends and lines, by seed."""
    found = [line_errors(room) for room in rooms]
    count = np.array([len(ends) for ends, _ in found])
    return count, [rms(ends) for ends, _ in found], [rms(lines) for _, lines in found]


def counted(rooms: NDArray[Any]) -> NDArray[Any]:
    """Lines of every map."""
    return np.sum(rooms["map"]["alive"] > 0, axis=1)


def plot(folder: Path, episodes: int) -> Path:
    """The map of the first seed after 1, 250 and 1000 images; returns the file."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(13, 4.6), layout="constrained")
    FigureCanvasAgg(figure)
    config, seeds = settings("pyramid", "four"), np.array(PUBLIC_SEEDS[:1], np.uint64)
    for k, images in enumerate(DRAWN):
        rooms = start(config, seeds)
        path, gaze = turn(images)
        fly(rooms, seeds, path, gaze, 0, config, work())
        axes: Any = figure.add_subplot(1, len(DRAWN), k + 1, projection="3d")
        draw_lines(axes, rooms[0])
        north, east, below = path.T / FOOT
        axes.plot(east, north, -below, color="tab:red", linewidth=1.0)
        axes.set_title(f"after {images} images")
    file = folder / f"{CASE}.png"
    figure.savefig(file, dpi=110)
    return file
