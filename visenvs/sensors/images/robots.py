"""Ground robots of the arena as polygons: a dark disc with a bumper in front and a coloured plate.

An obstacle robot carries a pole. Everything is given in the robot's own frame (forward, right,
down) and projected at once.
"""

from __future__ import annotations

import math
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from visenvs.sensors.images.optics import Values

RADIUS, HEIGHT, POLE_RADIUS = 0.17, 0.092, 0.05  # m
GREEN, RED, NO_PLATE = range(3)
ROBOT = np.dtype(
    [
        ("place", "f8", (2,)),  # north, east, m
        ("heading", "f8"),  # clockwise from north, rad
        ("plate", "i8"),  # GREEN, RED, NO_PLATE
        ("pole", "f8"),  # height, m; 0 for none
    ]
)
NEAREST = 0.1  # nothing nearer along the optical axis is drawn, m
GREY = np.array([0.299, 0.587, 0.114])
RING = 24
SIDE_COLOUR, TOP, BUMPER, BUTTON, POLE = (
    (38, 38, 42),
    (205, 205, 200),
    (52, 52, 56),
    (30, 30, 30),
    (228, 228, 224),
)
PLATES = ((40, 165, 70), (200, 45, 50), (150, 150, 150))


def _ring(radius: float, z: float, first: float = 0.0, last: float = 2.0 * math.pi) -> Values:
    angles = np.linspace(first, last, RING, endpoint=last - first < 6.0)
    if last - first > 6.0:
        angles = np.linspace(first, last, RING, endpoint=False)
    points = np.stack([np.cos(angles), np.sin(angles), np.full(RING, z / radius)], axis=1)
    return radius * points


def _template() -> tuple[Values, dict[str, slice]]:
    """All vertices of a robot (n, 3), m, and which of them are which part."""
    top = -HEIGHT
    outer = _ring(RADIUS, top, -1.25, 1.25)
    inner = _ring(0.72 * RADIUS, top, -1.25, 1.25)
    plate = np.array(
        [[0.05, -0.07, top], [0.05, 0.07, top], [-0.11, 0.07, top], [-0.11, -0.07, top]]
    )
    parts = {
        "bottom": _ring(RADIUS, 0.0),
        "top": _ring(RADIUS, top),
        "bumper": np.concatenate([outer, inner[::-1]]),
        "plate": plate,
        "button": _ring(0.022, top) + np.array([0.075, 0.0, 0.0]),
        "pole_bottom": _ring(POLE_RADIUS, top),
        "pole_top": _ring(POLE_RADIUS, 0.0),
    }
    slices: dict[str, slice] = {}
    start = 0
    for name, points in parts.items():
        slices[name] = slice(start, start + len(points))
        start += len(points)
    return np.concatenate(list(parts.values())), slices


TEMPLATE, PARTS = _template()


def draw_robots(
    frame: Any, project: Values, r_V_N: Values, robots: NDArray[Any], colour: bool
) -> None:
    """Draw all robots that are in view, far ones first, in place.

    Args:
        frame: grey or RGB.
        project: maps a position relative to the camera in N to (u, v, 1) times its depth, (3, 3).
        r_V_N: position of the camera, m, (3,).
        robots: records of ROBOT.
        colour: whether the frame is RGB.
    """
    if not len(robots):
        return
    homogeneous = corners(robots, r_V_N) @ project.T
    depth = homogeneous[..., 2]
    solid = depth[:, : PARTS["pole_bottom"].start].min(axis=1) > NEAREST
    pixels = homogeneous[..., :2] / np.maximum(depth, NEAREST)[..., None]
    height, width = frame.shape[:2]
    low, high = pixels.min(axis=1), pixels.max(axis=1)
    seen = (high > 0.0).all(axis=1) & (low[:, 0] < width) & (low[:, 1] < height) & solid
    grid = np.rint(np.clip(pixels, -2e4, 2e4) * 16.0).astype(np.int32)
    for i in np.argsort(-depth[:, 0]):
        if seen[i]:
            plate, pole = int(robots["plate"][i]), float(robots["pole"][i]) > 0.0
            _draw_one(frame, grid[i], plate, pole, colour)


def corners(robots: NDArray[Any], r_V_N: Values) -> Values:
    """All vertices of all robots relative to the camera in N, m, (n, vertices, 3)."""
    c, s = np.cos(robots["heading"]), np.sin(robots["heading"])
    zero, one = np.zeros_like(c), np.ones_like(c)
    turn = np.array([[c, -s, zero], [s, c, zero], [zero, zero, one]]).transpose(2, 0, 1)
    out = TEMPLATE @ turn.transpose(0, 2, 1)
    out[:, PARTS["pole_top"], 2] -= robots["pole"][:, None]
    out[..., :2] += robots["place"][:, None] - r_V_N[:2]
    out[..., 2] -= r_V_N[2]
    return out


def _draw_one(frame: Any, grid: NDArray[np.int32], plate: int, pole: bool, colour: bool) -> None:
    wall = cv2.convexHull(np.concatenate([grid[PARTS["top"]], grid[PARTS["bottom"]]]))
    _fill(frame, wall, SIDE_COLOUR, colour)
    _fill(frame, grid[PARTS["top"]], TOP, colour)
    bumper = grid[PARTS["bumper"]]
    cv2.fillPoly(frame, [bumper], _shade(BUMPER, colour), cv2.LINE_AA, 4)
    _fill(frame, grid[PARTS["plate"]], PLATES[plate], colour)
    _fill(frame, grid[PARTS["button"]], BUTTON, colour)
    if pole:
        ends = np.concatenate([grid[PARTS["pole_top"]], grid[PARTS["pole_bottom"]]])
        _fill(frame, cv2.convexHull(ends), POLE, colour)


def _fill(frame: Any, polygon: Any, paint: tuple[int, int, int], colour: bool) -> None:
    cv2.fillConvexPoly(frame, polygon, _shade(paint, colour), cv2.LINE_AA, 4)


def _shade(paint: tuple[int, int, int], colour: bool) -> tuple[float, ...]:
    return tuple(map(float, paint)) if colour else (float(GREY @ paint),)
