"""Finds a robot by what it must look like from above where a filter expects it (IARC, NCC).

The view from above is warped by the homography of the plane of the robots' tops to the predicted
place and to a few headings, and correlated with the picture nearby, normalised. There is one view
for each colour of plate. What correlates too little is not registered.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import cv2
import numpy as np

from visenvs.sensors.images.optics import Image, Optics, Values
from visenvs.sensors.images.robots import HEIGHT, RADIUS, ROBOT, draw_robots

SIDE, METRES = 96, 0.40  # of the view from above: pixels, m
FLOOR = 118.0  # grey of the floor around
LEAST_SCORE = 0.5  # correlation that registers
LEAST_SIZE = 7  # pixels of the warped view


@dataclass(frozen=True)
class Match:
    """A robot as matched.

    Attributes:
        pixel: of the middle of its top, (u, v).
        heading: the best of those tried, rad, between its neighbours by a parabola.
        score: normalised correlation, at most 1.
    """

    pixel: tuple[float, float]
    heading: float
    score: float


@cache
def view_from_above(plate: int) -> Image:
    """A robot that heads up, grey, (SIDE, SIDE)."""
    robot = np.zeros(1, ROBOT)
    robot["plate"] = plate
    high = 1000.0
    lens = Optics(SIDE, SIDE, (high - HEIGHT) * SIDE / METRES)
    down = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
    frame = np.full((SIDE, SIDE), FLOOR, np.uint8)
    draw_robots(frame, lens.matrix @ down, np.array([0.0, 0.0, -high]), robot, False)
    return np.asarray(cv2.GaussianBlur(frame, (3, 3), 0.6), np.uint8)


def detect(
    image: Image,
    optics: Optics,
    C: Values,
    r_V_N: Values,
    place: Sequence[float],
    headings: Sequence[float],
    plate: int,
    gate: float = 14.0,
) -> Match | None:
    """The robot near a predicted place, or None where nothing there looks like it.

    Args:
        image: grey, (height, width).
        optics, C, r_V_N: the camera, its attitude C_CN (3, 3), and position, m, (3,).
        place: predicted, north and east, m.
        headings: that are tried, rad, at equal distances.
        plate: colour code of `robots`.
        gate: how far from the prediction it may be, pixels.
    """
    top = np.array([place[0], place[1], -HEIGHT])
    pixel, depth = optics.project(C, top - r_V_N)
    if not depth > 0.1 or not optics.shows(pixel, 4.0):
        return None
    half = 1.1 * RADIUS * optics.focal / float(depth)
    reach = math.ceil(half)
    middle = np.rint(pixel).astype(int)
    low, high = middle - reach, middle + reach + 1
    near = math.ceil(gate)
    left, upper = np.maximum(low - near, 0)
    right, lower = np.minimum(high + near, (optics.width, optics.height))
    part = image[upper:lower, left:right]
    side = 2 * reach + 1
    if side < LEAST_SIZE or part.shape[0] < side or part.shape[1] < side:
        return None
    peaks: list[tuple[float, float, float]] = []
    view = view_from_above(plate)
    for heading in headings:
        warp = _homography(optics, C, r_V_N, place, heading)
        warp = np.array([[1.0, 0.0, -low[0]], [0.0, 1.0, -low[1]], [0.0, 0.0, 1.0]]) @ warp
        patch = cv2.warpPerspective(
            view, warp, (side, side), flags=cv2.INTER_AREA, borderValue=FLOOR
        )
        peaks.append(_peak(cv2.matchTemplate(part, patch, cv2.TM_CCOEFF_NORMED)))
    best = max(range(len(peaks)), key=lambda k: peaks[k][0])
    score, x, y = peaks[best]
    if score < LEAST_SCORE:
        return None
    at = float(pixel[0] - low[0] + left + x), float(pixel[1] - low[1] + upper + y)
    return Match(at, _between(headings, [peak[0] for peak in peaks], best), score)


def _homography(
    optics: Optics, C: Values, r_V_N: Values, place: Sequence[float], heading: float
) -> Values:
    """From pixels of the view from above to pixels of the picture, (3, 3)."""
    c, s, cell, middle = math.cos(heading), math.sin(heading), METRES / SIDE, 0.5 * (SIDE - 1)
    # forward is up in the view: forward = (middle - row) cell, right = (column - middle) cell
    forward, right = np.array([c, s]), np.array([-s, c])
    plane = np.zeros((3, 3))
    plane[:2, 0], plane[:2, 1] = cell * right, -cell * forward
    plane[:2, 2] = np.asarray(place) - r_V_N[:2] + cell * middle * (forward - right)
    plane[2, 2] = -HEIGHT - r_V_N[2]
    return optics.matrix @ C @ plane


def _peak(scores: Any) -> tuple[float, float, float]:
    """The highest correlation and where it is, (x, y), by a parabola through its neighbours."""
    _, score, _, (x, y) = cv2.minMaxLoc(scores)
    out = [float(x), float(y)]
    for k, (dx, dy) in enumerate(((1, 0), (0, 1))):
        if 0 < (x, y)[k] < scores.shape[1 - k] - 1:
            out[k] += _top(float(scores[y - dy, x - dx]), score, float(scores[y + dy, x + dx]))
    return float(score), out[0], out[1]


def _between(headings: Sequence[float], scores: Sequence[float], best: int) -> float:
    """The heading at the top of the parabola through the best score and its neighbours', rad."""
    if not 0 < best < len(scores) - 1:
        return float(headings[best])
    step = headings[best + 1] - headings[best]
    return float(headings[best] + step * _top(*scores[best - 1 : best + 2]))


def _top(before: float, middle: float, after: float) -> float:
    """Where the parabola through three values is highest, in steps from the middle one."""
    bend = before - 2.0 * middle + after
    return 0.5 * (before - after) / bend if bend < 0.0 else 0.0
