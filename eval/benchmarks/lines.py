"""A map of 500 lines and an image of 300 segments of them: predicted, associated and updated.

The lines lie anywhere in an image from 100 m above, as long as a house; the map knows them with
small errors and the covariances that these were drawn from. Every portion starts from the same map.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from visenvs.core.config import to_record
from visenvs.core.frames import camera_towards
from visenvs.core.registry import load_task
from visenvs.estimation.line_map import map_dtype, use_image, work_dtype
from visenvs.sensors import segments

from . import Budget, Portion, Row, race, row

GROUP = "lines"
WANTS = "500 lines and 300 segments in at most 5 ms of CPU time: at least 200 images per CPU second"
UNIT = "images/CPU s"
LINES, SEGMENTS = 500, 300
ALTITUDE, HALF, LENGTH = 100.0, 52.0, 15.0  # m
ERROR = 0.1  # standard deviation of the map, m
AT_LEAST = 0.98  # of the segments must find a line, and no more than the rest a wrong one


def rows(budget: Budget) -> list[Row]:
    """Images per CPU second."""
    side = f"{GROUP}/{LINES}x{SEGMENTS}"
    return [row(side, UNIT, race({side: images()}, budget))]


def images() -> Portion:
    """One image for the map as it is, again and again."""
    config = to_record(load_task("visenvs/Mapping-v0").scenarios["pyramid"])
    config["near"], config["min_length"] = 1.0, 0.0
    scene, work = draw_scene(), np.zeros(1, work_dtype(LINES, LINES))
    start = draw_map(scene[0]["edge"])
    lines_map, C, r_V = start.copy(), np.zeros((3, 3)), np.array([0.0, 0.0, -ALTITUDE])
    camera_towards(np.array([0.0, 0.0, 1.0]), C)
    seen, cut, labels = np.zeros((LINES, 4)), np.zeros((LINES, 2)), np.zeros(LINES)
    camera = np.zeros(1, segments.SCRATCH)
    segments.take_segments(scene[0], C, r_V, config[0], 0, 0, 0, 0, seen, cut, labels, camera[0])

    def portion() -> int:
        lines_map[:] = start
        use_image(lines_map[0], C, r_V, seen, cut, labels, SEGMENTS, config[0], work[0])
        return 1

    portion()
    check(lines_map[0])
    return portion


def check(lines_map: Any) -> None:
    """Raise a ValueError unless nearly every segment updated the line that it is of."""
    found = float(np.sum(lines_map["hits"] > 1.0))
    if found - lines_map["wrong"] < AT_LEAST * SEGMENTS:
        raise ValueError(
            f"{GROUP}: only {found:.0f} of {SEGMENTS} segments found a line, "
            f"{lines_map['wrong']:.0f} a wrong one: there is nothing to time"
        )


def draw_scene() -> NDArray[Any]:
    """Edges in the picture, of any direction, up to 20 m above ground."""
    rng, scene = np.random.default_rng(0), np.zeros(1, segments.scene_columns(LINES, 1))
    middle = rng.uniform(
        (-HALF + 8.0, -HALF + 8.0, -20.0), (HALF - 8.0, HALF - 8.0, 0.0), (LINES, 3)
    )
    along = rng.normal(size=(LINES, 3))
    along[:, 2] = 0.3 * along[:, 2]
    along *= 0.5 * LENGTH / np.linalg.norm(along, axis=1, keepdims=True)
    scene["edge"][0] = np.hstack([middle - along, middle + along])
    scene["edges"], scene["solid"], scene["face"] = LINES, -1, -1
    return scene


def draw_map(edges: NDArray[np.float64]) -> NDArray[Any]:
    """A map of all edges, with drawn errors."""
    rng, out = np.random.default_rng(1), np.zeros(1, map_dtype(LINES))
    out["x"][0] = edges + ERROR * rng.normal(size=edges.shape)
    out["P"][0] = ERROR**2 * np.eye(6)
    out["owner"][0] = np.arange(LINES)
    for name in ("alive", "hits", "closed"):
        out[name] = 1.0
    out["used"] = LINES
    return out
