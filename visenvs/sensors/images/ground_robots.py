"""Finds the ground robots of a picture: where one is expected, and anywhere.

An expected robot is sought by its template, in the prediction's gate and at a few headings, with
the plate's colour that the picture shows there; where that registers nothing, by the cascade in the
region that the prediction's covariance leaves. What nobody expects is found by the cascade in the
whole picture. One window is enough, as a robot also has to show a plate: obstacles have none.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import cv2
import numpy as np

from visenvs.sensors.images import haar, templates
from visenvs.sensors.images.cascade_file import shipped_cascade
from visenvs.sensors.images.optics import Image, Optics, Values
from visenvs.sensors.images.prior import Prior, Region, search_region
from visenvs.sensors.images.robots import GREEN, HEIGHT, RADIUS, RED
from visenvs.sensors.images.scenes import WINDOW

LEAST_DEPTH = 0.4  # from which robots' tops are made out, m
SMALLER, LARGER = 0.975, 1.04  # windows tried, of the expected one
UNLIKE = 0.03  # difference of size at the edges, in parts, from which on windows differ by place
VOTES = 1  # windows of the cascade that make a robot, which has a plate too
VIVID = 25  # by how much the plate's colour outshines the two others, grey levels
SHARE = 0.2  # of the middle of a robot that its plate covers
GATE = 4.0  # pixels around a prediction that are always searched by template,
MOST = 14.0  # and at most
SURE, VAGUE = 0.12, 0.3  # standard deviations up to which a few headings are tried, rad:
FINE = 0.15 * np.array([-1.0, 0.0, 1.0])  # so many about the predicted one where it is sure,
BROAD = 0.15 * np.array([-3.0, -2.0, -1.0, 0.0, 1.0, 2.0, 3.0])  # or vague,
COARSE = 2.0 * math.pi / 16 * np.arange(16)  # else all
HEADING_SD, COARSE_SD = 0.04, 0.25  # standard deviations of a heading found by either, rad
APART = 0.2  # findings nearer to each other than this are one robot, m


@dataclass(frozen=True)
class View:
    """A picture and the camera as its aircraft believes it to be.

    Attributes:
        image: RGB, (height, width, 3).
        optics: the camera.
        C, r_V_N: attitude C_CN, (3, 3), and position, m, (3,).
    """

    image: Image
    optics: Optics
    C: Values
    r_V_N: Values

    @property
    def depth(self) -> float:
        """How far below the camera the robots' tops are, m."""
        return float(-self.r_V_N[2]) - HEIGHT

    @cached_property
    def grey(self) -> Image:
        """The picture without colour."""
        return np.asarray(cv2.cvtColor(self.image, cv2.COLOR_RGB2GRAY), np.uint8)

    @cached_property
    def sizes(self) -> haar.SizeWindow | tuple[float, float]:
        """How large a robot looks, pixels: least and most where all look alike, else by place.

        All look alike to a camera that looks straight down.
        """
        model = haar.floor_sizes(self.optics, self.C, self.depth, WINDOW)
        size = float(model.at((self.optics.cx, self.optics.cy)))
        edge = abs(model.b) * self.optics.cx + abs(model.c) * self.optics.cy
        return model if edge > UNLIKE * size else (SMALLER * size, LARGER * size)

    def place(self, pixel: Sequence[float]) -> Values:
        """Where on the plane of the robots' tops a pixel looks, north and east, m, (2,)."""
        ray = np.concatenate([[1.0], self.optics.points(pixel)]) @ self.C
        return self.r_V_N[:2] + self.depth / ray[2] * ray[:2]

    def pixel(self, place: Sequence[float]) -> Values:
        """Where a robot's top is in the picture, (2,)."""
        top = np.array([place[0], place[1], -HEIGHT])
        return self.optics.project(self.C, top - self.r_V_N)[0]


@dataclass(frozen=True)
class Expected:
    """A robot as a filter predicts it.

    Attributes:
        place: north and east, m.
        deviation: standard deviation along either axis, m.
        heading, heading_deviation: rad.
    """

    place: tuple[float, float]
    deviation: float
    heading: float
    heading_deviation: float


@dataclass(frozen=True)
class Finding:
    """A robot that was found.

    Attributes:
        place: of the middle of its top, north and east, m.
        heading, heading_deviation: rad; the deviation is 0 where no heading was found.
    """

    place: tuple[float, float]
    heading: float = 0.0
    heading_deviation: float = 0.0


def track(view: View, expected: Expected, hits: Sequence[Finding] | None = None) -> Finding | None:
    """The robot that is expected, or None where it is not registered.

    Args:
        view: the picture.
        expected: the prediction at its time.
        hits: what the cascade finds in the whole picture, if it has been searched.
    """
    focal = view.optics.focal
    found = match(view, expected, 3.0 * expected.deviation * focal / view.depth + GATE)
    if found is not None:
        return found
    if hits is None:
        region = search_region(view.optics, prior_of(view, expected))
        hits = cascade(view, region) if region is not None else []
    reach = 3.0 * expected.deviation + APART
    near = [hit for hit in hits if math.dist(hit.place, expected.place) < reach]
    if not near:
        return None
    nearest = min(near, key=lambda hit: math.dist(hit.place, expected.place))
    at_hit = replace(expected, place=nearest.place)
    return match(view, at_hit, GATE) or nearest


def match(view: View, expected: Expected, gate: float) -> Finding | None:
    """The robot that looks like the template of its plate near a prediction; gate in pixels."""
    plate = plate_of(view, view.pixel(expected.place), 0.5 * gate)
    if plate is None:
        return None
    sd = expected.heading_deviation
    around = FINE if sd < SURE else BROAD if sd < VAGUE else COARSE
    headings = [expected.heading + float(turn) for turn in around]
    camera = view.grey, view.optics, view.C, view.r_V_N
    found = templates.detect(*camera, expected.place, headings, plate, min(gate, MOST))
    if found is None or plate_of(view, found.pixel) != plate:
        return None
    north, east = view.place(found.pixel)
    deviation = HEADING_SD if sd < VAGUE else COARSE_SD
    return Finding((float(north), float(east)), found.heading, deviation)


def prior_of(view: View, expected: Expected) -> Prior:
    """A prediction as an image point with its deviations, focal lengths."""
    y, z = view.optics.points(view.pixel(expected.place)).tolist()
    spread = expected.deviation / view.depth
    return Prior((y, z), (spread, spread), 0.0)


def others(hits: Sequence[Finding], known: Sequence[Finding]) -> list[Finding]:
    """The hits that are not among the known robots, nor two of one robot."""
    out = list(known)
    for hit in hits:
        if all(math.dist(hit.place, other.place) > APART for other in out):
            out.append(hit)
    return out[len(known) :]


def cascade(view: View, region: Region | None = None) -> list[Finding]:
    """What passes the cascade in a region, None for the whole picture, and has a plate.

    Best first, and without headings.
    """
    hits = haar.raw_hits(view.grey, shipped_cascade(), view.sizes, region)
    out: list[Finding] = []
    for hit in haar.group(hits, VOTES):
        if plate_of(view, hit.pixel) is not None:
            north, east = view.place(hit.pixel)
            out.append(Finding((float(north), float(east))))
    return out


def plate_of(view: View, pixel: Any, around: float = 0.0) -> int | None:
    """Colour of the plate in the middle of a robot at a pixel, and so many more around; or None."""
    half = max(0.5 * RADIUS * view.optics.focal / view.depth, 1.0)
    reach = round(half + around)
    u, v = (round(float(x)) for x in pixel)
    part = view.image[max(v - reach, 0) : v + reach + 1, max(u - reach, 0) : u + reach + 1]
    if not part.size:
        return None
    red, green, blue = (part[..., k].astype(np.int16) for k in range(3))
    counts = {
        GREEN: int(np.count_nonzero(green - np.maximum(red, blue) > VIVID)),
        RED: int(np.count_nonzero(red - np.maximum(green, blue) > VIVID)),
    }
    plate = max(counts, key=lambda colour: counts[colour])
    return plate if counts[plate] > SHARE * (2.0 * half + 1.0) ** 2 else None
