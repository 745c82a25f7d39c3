"""What figures 15 to 19 of the thesis share: prescribed flights over a scene, in its feet.

The thesis gives the sampling time, angular and flight speeds and the camera's mount angle. Sizes,
altitudes, image noise and everything about the filter are ours: 2 mrad of noise (in focal lengths),
a picture of +-30 degrees.
"""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from visenvs.core.compile import kernel
from visenvs.core.config import override, to_record
from visenvs.core.frames import camera_towards
from visenvs.core.registry import load_task
from visenvs.core.units import FOOT
from visenvs.envs._mapping_world import build
from visenvs.estimation.line_map import map_dtype, use_image, work_dtype
from visenvs.sensors import segments

from . import Row, standard_error

Values = NDArray[np.float64]
EDGES, SLOTS, ROWS = 480, 512, 600  # of 16 x 16 points; lines of a map; segments of an image
SAMPLES = 200  # points of an edge at which coverage is taken
NEAR_BY = 0.5 * FOOT  # an edge's point this near to a line is covered

ROOM = np.dtype([*segments.scene_columns(EDGES, 1), ("map", map_dtype(SLOTS))])
WORK = np.dtype(
    [
        ("map", work_dtype(SLOTS, ROWS)),
        ("camera", segments.SCRATCH),
        ("segment", "f8", (ROWS, 4)),
        ("cut", "f8", (ROWS, 2)),
        ("label", "f8", (ROWS,)),
        ("C", "f8", (3, 3)),
    ]
)


@kernel
def construct(rooms, seeds, config):
    """Build the scene of every seed."""
    for i in range(rooms.shape[0]):
        build(rooms[i], config[0], seeds[i], 0, 0)


@kernel
def fly(rooms, seeds, path, gaze, first, config, works):
    """Take an image at every place of a path (n, 3), m, N, looking along `gaze`, in every room."""
    cfg, work = config[0], works[0]
    C, seen, cut, label = work["C"], work["segment"], work["cut"], work["label"]
    for i in range(rooms.shape[0]):
        room = rooms[i]
        for k in range(path.shape[0]):
            camera_towards(gaze[k], C)
            count = segments.take_segments(
                room, C, path[k], cfg, seeds[i], 0, first + k, 1, seen, cut, label, work["camera"]
            )
            use_image(room["map"], C, path[k], seen, cut, label, count, cfg, work["map"])


def settings(scenario: str, estimator: str, points: int = 0, **changes: Any) -> NDArray[Any]:
    """The record of a scenario of the environment with some changes; more points than it allows."""
    config = load_task("visenvs/Mapping-v0").scenarios[scenario]
    record = to_record(override(config, {"estimator": estimator, **changes}))
    if points:
        record["points"] = points
    return record


def start(config: NDArray[Any], seeds: NDArray[np.uint64]) -> NDArray[Any]:
    """One record for each seed, with its scene and an empty map."""
    rooms = np.zeros(len(seeds), ROOM)
    construct(rooms, seeds, config)
    return rooms


@cache
def work() -> NDArray[Any]:
    """Scratch for `fly`."""
    return np.zeros(1, WORK)


def down(path: Values) -> Values:
    """Directions of a camera that looks straight down, (n, 3)."""
    return np.tile([0.0, 0.0, 1.0], (len(path), 1))


def circle(radius: float, altitude: float, angles: Values) -> Values:
    """Places on a circle about the origin, m, N, (n, 3)."""
    level = np.full(len(angles), -altitude)
    return np.stack([radius * np.cos(angles), radius * np.sin(angles), level], axis=1)


def line_errors(room: np.void) -> tuple[Values, Values]:
    """Of every edge with a line: RMS error of its ends, and of these across it, ft, each (n,).

    Of several lines of an edge the one that most images showed counts.
    """
    m, ends, across = room["map"], [], []
    for e in range(int(room["edges"])):
        own = np.flatnonzero((m["alive"] > 0) & (m["owner"] == e))
        if not len(own):
            continue
        x = m["x"][own[np.argmax(m["hits"][own])]].reshape(2, 3)
        a, b = room["edge"][e].reshape(2, 3)
        errors = min((x - (a, b), x - (b, a)), key=lambda d: float(np.sum(d**2)))
        u = (b - a) / np.linalg.norm(b - a)
        off = (x - a) - np.outer((x - a) @ u, u)
        ends.append(math.sqrt(np.sum(errors**2) / 2))
        across.append(math.sqrt(np.sum(off**2) / 2))
    return np.array(ends) / FOOT, np.array(across) / FOOT


def coverage(room: np.void) -> float:
    """Share of the edges' length that a line is near to."""
    m, found = room["map"], []
    lines = m["x"][m["alive"] > 0].reshape(-1, 2, 3)
    for e in range(int(room["edges"])):
        a, b = room["edge"][e].reshape(2, 3)
        points = a + np.outer((np.arange(SAMPLES) + 0.5) / SAMPLES, b - a)
        gap = np.full(SAMPLES, np.inf)
        for first, last in lines:
            d = last - first
            t = np.clip((points - first) @ d / (d @ d), 0.0, 1.0)
            gap = np.minimum(gap, np.linalg.norm(points - first - np.outer(t, d), axis=1))
        found.append(np.mean(gap < NEAR_BY))
    return float(np.mean(found))


def rms(values: Values) -> float:
    """Root of the mean square; NaN of nothing."""
    return float(np.sqrt(np.mean(values**2))) if len(values) else math.nan


def median(at: str, values: Any, low: float | None = None, high: float | None = None) -> Row:
    """The median over the seeds; the thesis has pictures, no numbers."""
    array = np.asarray(values, float)
    error = standard_error(array, np.median)
    return Row(at, None, float(np.median(array)), error, len(array), low, high)


def draw_lines(axes: Any, room: np.void) -> None:
    """Draw the true edges and the map's lines into 3-D axes, east, north, up, ft."""
    m = room["map"]
    for lines, colour, width in (
        (room["edge"][: int(room["edges"])], "tab:green", 2.0),
        (m["x"][m["alive"] > 0], "tab:blue", 0.9),
    ):
        for line in lines:
            (n, e, d) = line.reshape(2, 3).T / FOOT
            axes.plot(e, n, -d, color=colour, linewidth=width)
    axes.set(xlabel="east (ft)", ylabel="north (ft)", zlabel="height (ft)")
    axes.set_box_aspect(None, zoom=0.85)
