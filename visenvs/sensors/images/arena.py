"""Pictures of the arena of the International Aerial Robotics Competition's mission 7.

The floor is one perspective warp of a texture, from the copy whose texels are about as large as the
picture's pixels; everything that stands on it is projected in one product and filled as polygons,
far ones first. The arena is a square about the origin of N: 1 m grid, red line in the south, green
line in the north.
"""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from visenvs.core.noise import uniform_pair
from visenvs.sensors.images.optics import Image, Optics, Values
from visenvs.sensors.images.robots import draw_robots
from visenvs.sensors.images.textures import fractal, pyramid

FLOOR, SIDE = 32.0, 20.0  # sides of floor texture and arena, m
TEXELS = 100  # per metre
LEVELS = 6
LINE = 0.08  # width of a line, m
SCUFFS, SCUFF_STREAM = 900, 100
GREY = np.array([0.299, 0.587, 0.114])
WHITE, RED, GREEN = (235, 235, 232), (190, 40, 40), (40, 150, 60)
WALL = (168, 172, 178)  # what is above the floor's horizon
HORIZON = 0.02  # least downward part of a ray that ends on the floor


class Arena:
    """The floor of one arena, from which any camera's pictures are made.

    Args:
        seed: of the floor's texture.
        colour: RGB pictures, or grey ones.
    """

    def __init__(self, seed: int = 0, colour: bool = False) -> None:
        self.colour = colour
        floor = draw_floor(seed)
        if not colour:
            floor = cv2.cvtColor(floor, cv2.COLOR_RGB2GRAY)
        self._floors = pyramid(np.asarray(floor, np.uint8), LEVELS)

    def render(self, optics: Optics, C: Values, r_V_N: Values, robots: NDArray[Any]) -> Image:
        """The picture through a perfect lens, (height, width) or (height, width, 3).

        Args:
            optics: the camera.
            C: its attitude C_CN, (3, 3).
            r_V_N: its position, m, (3,), above the floor.
            robots: records of `robots.ROBOT`, those that are out of view too.
        """
        project = optics.matrix @ C
        level = self._level(optics, C, -r_V_N[2])
        cell = 2.0**level / TEXELS
        # texel (column, row) -> (north, east, 1) -> relative to the camera
        place = np.array(
            [
                [0.0, -cell, FLOOR / 2 - 0.5 * cell - r_V_N[0]],
                [cell, 0.0, -FLOOR / 2 + 0.5 * cell - r_V_N[1]],
                [0.0, 0.0, -r_V_N[2]],
            ]
        )
        size = optics.width, optics.height
        wall = shade(WALL, self.colour)
        frame = cv2.warpPerspective(
            self._floors[level], project @ place, size, flags=cv2.INTER_LINEAR, borderValue=wall
        )
        above = half_plane(optics, C)
        if len(above):
            cv2.fillConvexPoly(frame, np.rint(above * 16).astype(np.int32), wall, cv2.LINE_AA, 4)
        return self.place(np.asarray(frame, np.uint8), optics, C, r_V_N, robots)

    def place(
        self, frame: Image, optics: Optics, C: Values, r_V_N: Values, robots: NDArray[Any]
    ) -> Image:
        """Draw robots on a picture of the floor, in place, and return it."""
        draw_robots(frame, optics.matrix @ C, r_V_N, robots, self.colour)
        return frame

    def _level(self, optics: Optics, C: Values, altitude: float) -> int:
        """The copy whose texels are about as large as the pixels in the middle.

        Larger pixels than texels would make corners of the floor jump from picture to picture.
        """
        texels = TEXELS * altitude / (optics.focal * max(C[0, 2], 0.25))
        return min(round(math.log2(max(texels, 1.0))), LEVELS - 1)


@cache
def shared_arena(seed: int, colour: bool) -> Arena:
    """The arena of a seed, made once in a process and shared by all lanes."""
    return Arena(seed, colour)


def shade(colour: tuple[int, int, int], in_colour: bool) -> tuple[float, ...]:
    """A colour as OpenCV takes it, or its grey."""
    return tuple(map(float, colour)) if in_colour else (float(GREY @ colour),)


def half_plane(optics: Optics, C: Values) -> Values:
    """The part of the picture whose rays miss the floor, as a polygon of pixels (n, 2)."""
    right, bottom = optics.width - 0.5, optics.height - 0.5
    corners = np.array([[-0.5, -0.5], [right, -0.5], [right, bottom], [-0.5, bottom]])
    rays = np.concatenate([np.ones((4, 1)), optics.points(corners)], axis=1)
    over = HORIZON - rays @ C[:, 2]
    kept: list[Values] = []
    for i in range(4):
        j = (i + 1) % 4
        if over[i] >= 0.0:
            kept.append(corners[i])
        if over[i] * over[j] < 0.0:
            share = over[i] / (over[i] - over[j])
            kept.append(corners[i] + share * (corners[j] - corners[i]))
    return np.array(kept).reshape(-1, 2)


def draw_floor(seed: int) -> Image:
    """The floor from above, north up, RGB, (FLOOR * TEXELS, FLOOR * TEXELS, 3)."""
    size = int(FLOOR * TEXELS)
    shades = np.clip(118.0 + 17.0 * fractal(size, 25, 7, seed, 0), 0.0, 255.0).astype(np.uint8)
    floor = cv2.merge([shades, shades, np.clip(shades * np.float32(0.96), 0, 255).astype(np.uint8)])
    for k in range(SCUFFS):
        u, v = uniform_pair(seed, 0, SCUFF_STREAM, k, 0)
        length, angle = uniform_pair(seed, 0, SCUFF_STREAM, k, 1)
        tone, width = uniform_pair(seed, 0, SCUFF_STREAM, k, 2)
        half = (4 + 26 * length) * np.array([math.cos(6.3 * angle), math.sin(6.3 * angle)])
        start, end = (
            tuple(int(16 * x) for x in size * np.array([u, v]) + sign * half) for sign in (-1, 1)
        )
        grey = int(60 + 130 * tone)
        cv2.line(floor, start, end, (grey, grey, grey), 1 + int(3 * width), cv2.LINE_AA, 4)
    _draw_lines(floor)
    return np.asarray(floor, np.uint8)


def _draw_lines(floor: Any) -> None:
    """The 1 m grid and the coloured ends."""
    low, high = ((FLOOR + sign * SIDE) / 2 for sign in (-1, 1))
    near, far = (round((edge + sign * LINE / 2) * TEXELS) for edge, sign in ((low, -1), (high, 1)))
    for k in range(int(SIDE) + 1):
        first = round((low + k - LINE / 2) * TEXELS)
        last = round((low + k + LINE / 2) * TEXELS)
        floor[first:last, near:far] = WHITE
        floor[near:far, first:last] = WHITE
    wide = round(LINE * TEXELS)
    floor[near : near + wide, near:far] = GREEN
    floor[far - wide : far, near:far] = RED
