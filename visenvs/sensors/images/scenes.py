"""Drawn scenes of the arena for training and testing detectors: cameras, robots, and clutter."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from visenvs.core.noise import uniform
from visenvs.sensors.images.arena import shared_arena
from visenvs.sensors.images.exposure import Exposure, expose
from visenvs.sensors.images.optics import Image, Optics, Values
from visenvs.sensors.images.robots import HEIGHT, RADIUS, RED, ROBOT

OPTICS = Optics(320, 240, 277.0)
WINDOW = 1.25 * 2 * RADIUS  # side of a robot's window, m
EXPOSURE = Exposure(blur=0.6, noise=3.0, gain_error=0.35)
NADIR, TILTED = (90.0, 90.0), (45.0, 75.0)  # how far the camera looks down, deg


class Draws:
    """Numbers drawn one after the other from one counter-based stream."""

    def __init__(self, seed: int, stream: int) -> None:
        self._seed, self._stream, self._k = seed, stream, 0

    def between(self, low: float, high: float) -> float:
        """A number uniform in [low, high]."""
        self._k += 1
        return low + (high - low) * uniform(self._seed, 0, self._stream, 0, self._k)

    def whole(self, count: int) -> int:
        """One of 0 to count - 1."""
        return min(int(self.between(0.0, count)), count - 1)


@dataclass(frozen=True)
class Scene:
    """A picture and what is in it.

    Attributes:
        image: grey, as the sensor gives it.
        C, r_V_N: attitude C_CN, (3, 3), and position of the camera, m, (3,).
        robots: records of ROBOT.
    """

    image: Image
    C: Values
    r_V_N: Values
    robots: NDArray[Any]

    @property
    def height(self) -> float:
        """Of the camera above the robots' tops, m."""
        return float(-self.r_V_N[2]) - HEIGHT

    def tops(self) -> tuple[Values, Values]:
        """Pixels (n, 2) of the middles of the robots' tops, and sides of their windows (n,)."""
        tops = np.concatenate(
            [self.robots["place"], np.full((len(self.robots), 1), -HEIGHT)], axis=1
        )
        pixels, depth = OPTICS.project(self.C, tops - self.r_V_N)
        return pixels, WINDOW * OPTICS.focal / depth


def attitude(heading: float, down: float, roll: float) -> Values:
    """C_CN of a camera turned to a heading, then looking down, then rolled to the right, rad."""
    c, s = math.cos(heading), math.sin(heading)
    turn = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    c, s = math.cos(down), math.sin(down)
    lower = np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
    c, s = math.cos(roll), math.sin(roll)
    return np.array([[1.0, 0.0, 0.0], [0.0, c, s], [0.0, -s, c]]) @ lower @ turn


def draw_scene(
    seed: int, down: tuple[float, float], robots: int, clutter: int = 4, floor: int = 0
) -> Scene:
    """A camera 1 to 3.2 m above the floor, and so many robots, balls and boxes where it looks.

    Args:
        seed: names all draws.
        down: how far it looks down, between these, deg.
        robots: how many, not overlapping.
        clutter: how many balls and boxes.
        floor: seed of the arena.
    """
    draws = Draws(seed, 7)
    heading, roll = draws.between(-math.pi, math.pi), draws.between(-0.12, 0.12)
    C = attitude(heading, math.radians(draws.between(*down)), roll)
    altitude = draws.between(1.0, 3.2)
    r_V = np.array([draws.between(-6.0, 6.0), draws.between(-6.0, 6.0), -altitude])
    fleet = np.zeros(robots, ROBOT)
    for i in range(robots):
        for _ in range(50):
            fleet["place"][i] = _seen_place(draws, C, r_V)
            gaps = np.hypot(*(fleet["place"][:i] - fleet["place"][i]).T)
            if not (gaps < 2.4 * RADIUS).any():
                break
        fleet["heading"][i] = draws.between(-math.pi, math.pi)
        fleet["plate"][i] = draws.whole(RED + 1)
    frame = shared_arena(floor, False).render(OPTICS, C, r_V, np.zeros(0, ROBOT))
    for _ in range(clutter):
        _draw_clutter(frame, draws, C, r_V)
    frame = shared_arena(floor, False).place(frame, OPTICS, C, r_V, fleet)
    return Scene(expose(frame, EXPOSURE, seed, 0, 9, 0), C, r_V, fleet)


def _seen_place(draws: Draws, C: Values, r_V: Values) -> Values:
    """A place on the floor that the camera sees, north and east, m."""
    pixel = (draws.between(10.0, OPTICS.width - 11.0), draws.between(10.0, OPTICS.height - 11.0))
    ray = np.concatenate([[1.0], OPTICS.points(pixel)]) @ C
    return r_V[:2] + (-r_V[2] - HEIGHT) / max(ray[2], 0.2) * ray[:2]


def _draw_clutter(frame: Any, draws: Draws, C: Values, r_V: Values) -> None:
    """A ball, a box or a two-coloured disc of about a robot's size on the floor."""
    place = np.append(_seen_place(draws, C, r_V), 0.0)
    pixels, depth = OPTICS.project(C, place - r_V)
    size = draws.between(0.05, 0.25) * OPTICS.focal / float(depth)
    u, v = (int(16 * x) for x in pixels)
    first, second = draws.between(15.0, 245.0), draws.between(15.0, 245.0)
    kind, angle = draws.whole(3), draws.between(0.0, 180.0)
    if kind == 1:
        box = cv2.boxPoints(((u, v), (16 * size, 16 * size * draws.between(0.6, 1.6)), angle))
        cv2.fillConvexPoly(frame, box.astype(np.int32), first, cv2.LINE_AA, 4)
        return
    cv2.circle(frame, (u, v), int(16 * size * 0.6), first, -1, cv2.LINE_AA, 4)
    inner = int(16 * size * draws.between(0.15, 0.45))
    offset = int(16 * size * 0.15) if kind == 2 else 0
    cv2.circle(frame, (u + offset, v - offset), inner, second, -1, cv2.LINE_AA, 4)
