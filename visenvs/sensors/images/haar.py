"""A cascade of boosted stumps on Haar features, and the scan of a picture with it.

Viola and Jones (2001), "Rapid object detection using a boosted cascade of simple features", with
the conventions of OpenCV's files: a feature is the weighted sum of up to three rectangles of the 24
by 24 window, over the standard deviation of its inner 22 by 22 pixels times their number; windows
flatter than 10 grey levels are no objects; a stump gives `left` below its threshold.

Where the camera is known, so is how large a robot on the floor looks, and only windows of about
that size are tried (IARC (7)). That needs the depth at the window's place in the picture, not the
altitude as printed, once the camera tilts.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from visenvs.core.compile import kernel
from visenvs.sensors.images.optics import Image, Optics, Values
from visenvs.sensors.images.prior import Region, whole

SIDE = 24  # of the window, pixels
INNER = SIDE - 2
FLATTEST = 10.0  # standard deviation of a window that is looked at, grey levels
SLACK = 1e-5  # by which OpenCV lowers a stage's threshold
STEP = 2  # from window to window, pixels of the resized picture
RATIO = 1.07  # from one size to the next
TOLERANCE = 0.2  # a window is tried where its size is off by no more than this part
LEAST_SIZE, MOST_SIZE = 0.66 * SIDE, 8.0 * SIDE  # of the windows tried, pixels
SPREAD = 0.1  # sizes beyond the least and largest expected, in parts
VOTES = 2  # windows that must agree
MOST = 4000  # hits of one size at most


@dataclass(frozen=True)
class Cascade:
    """Stumps one after the other, each on a feature of its own, and where the stages end.

    Attributes:
        rects: up to three rectangles x, y, width, height of every stump, (n, 3, 4), int32.
        weights: of the rectangles, 0 for none, (n, 3), float32.
        thresholds, left, right: of the stumps, and what they give below it and above, (n,).
        ends: index behind the last stump of every stage, (m,).
        limits: what a stage's sum must reach, (m,).
    """

    rects: NDArray[np.int32]
    weights: NDArray[np.float32]
    thresholds: NDArray[np.float32]
    left: NDArray[np.float32]
    right: NDArray[np.float32]
    ends: NDArray[np.int64]
    limits: NDArray[np.float32]

    @property
    def parts(self) -> tuple[NDArray[Any], ...]:
        """All arrays, as kernels take them."""
        stumps = self.rects, self.weights, self.thresholds, self.left, self.right
        return *stumps, self.ends, self.limits


@dataclass(frozen=True)
class Detection:
    """One object.

    Attributes:
        pixel: of its centre, (u, v).
        size: side of its window, pixels.
        score: sum by which its windows passed the last stage.
        votes: how many windows agreed.
    """

    pixel: tuple[float, float]
    size: float
    score: float
    votes: int


@dataclass(frozen=True)
class SizeWindow:
    """How large an object on the floor looks: size = scale (a + b u + c v), pixels.

    1 / depth of the floor's points is linear in the pixel, so that this is exact for a flat object.
    """

    a: float
    b: float
    c: float

    def at(self, pixels: Any) -> Values:
        """Expected size at pixels (u, v), (..., 2)."""
        pixels = np.asarray(pixels, float)
        return self.a + self.b * pixels[..., 0] + self.c * pixels[..., 1]


def floor_sizes(optics: Optics, C: Values, height: float, side: float) -> SizeWindow:
    """How large windows of `side` m look on a plane `height` m below the camera (IARC (7)).

    Depth X = height / (downward part of the ray with unit depth).
    """
    scale = side * optics.focal / height
    b, c = scale * C[1, 2] / optics.focal, scale * C[2, 2] / optics.focal
    return SizeWindow(scale * C[0, 2] - b * optics.cx - c * optics.cy, b, c)


def detect(
    image: Image,
    cascade: Cascade,
    sizes: SizeWindow | tuple[float, float],
    region: Region | None = None,
) -> list[Detection]:
    """All objects in a region of a grey picture, best first; none is an empty list.

    Args:
        image: (height, width).
        cascade: what to look for.
        sizes: expected size by place, or least and largest size anywhere, pixels.
        region: where centres may be; None for the whole picture.
    """
    hits = raw_hits(image, cascade, sizes, region)
    return group(hits)


def raw_hits(
    image: Image,
    cascade: Cascade,
    sizes: SizeWindow | tuple[float, float],
    region: Region | None = None,
) -> Values:
    """All windows that pass: centre u, v, size, score, shape (n, 4)."""
    height, width = image.shape
    region = region or whole(Optics(width, height))
    model = sizes if isinstance(sizes, SizeWindow) else SizeWindow(0.0, 0.0, 0.0)
    plane = np.array([model.a, model.b, model.c])
    found = [np.empty((0, 4))]
    for size in _ladder(sizes, region):
        scale = SIDE / size
        # the part of the picture that windows of this size can have their centres in
        box = _grown(_band(plane, size, region), size, width, height)
        if box.width < size or box.height < size:
            continue
        shape = round(box.width * scale), round(box.height * scale)
        part = image[box.top : box.bottom, box.left : box.right]
        mode = cv2.INTER_AREA if scale < 1.0 else cv2.INTER_LINEAR
        small = cv2.resize(part, shape, interpolation=mode)
        sums, squares = cv2.integral2(small, sdepth=cv2.CV_32S, sqdepth=cv2.CV_64F)
        hits = np.empty((MOST, 3))
        across, down = box.width / shape[0], box.height / shape[1]
        place = np.array([box.left, box.top, across, down])
        count = scan(sums, squares, cascade.parts, STEP, plane, size, place, hits)
        rows = np.empty((count, 4))
        rows[:, :2] = hits[:count, :2]
        rows[:, 2], rows[:, 3] = SIDE * across, hits[:count, 2]
        found.append(rows)
    return np.concatenate(found)


def _ladder(sizes: SizeWindow | tuple[float, float], region: Region) -> Values:
    """The sizes to try, each RATIO times the last."""
    if isinstance(sizes, SizeWindow):
        right, bottom = region.right - 1, region.bottom - 1
        ends = [(region.left, region.top), (right, region.top), (region.left, bottom)]
        expected = sizes.at([*ends, (right, bottom)])
        low, high = float(expected.min()) / (1 + SPREAD), float(expected.max()) * (1 + SPREAD)
    else:
        low, high = sizes
    low, high = max(low, LEAST_SIZE), min(high, MOST_SIZE)
    if not low <= high:
        return np.empty(0)
    steps = max(math.ceil(math.log(high / low) / math.log(RATIO)), 1)
    return np.geomspace(low, high, steps + 1)


def _band(plane: Values, size: float, region: Region) -> Region:
    """The rows of a region in which this size may be expected somewhere."""
    if not plane.any():
        return region
    rows = np.arange(region.top, region.bottom)
    ends = plane[0] + plane[2] * rows[:, None] + plane[1] * np.array([region.left, region.right])
    low, high = ends.min(axis=1), ends.max(axis=1)
    able = np.flatnonzero((low * (1 - TOLERANCE) <= size) & (size <= high * (1 + TOLERANCE)))
    if not len(able):
        return Region(region.left, region.top, region.left, region.top)
    return Region(region.left, int(rows[able[0]]), region.right, int(rows[able[-1]]) + 1)


def _grown(band: Region, size: float, width: int, height: int) -> Region:
    """A region and half a window around it."""
    half = math.ceil(0.5 * size) + 1
    if band.width <= 0 or band.height <= 0:
        return band
    return Region(
        max(band.left - half, 0),
        max(band.top - half, 0),
        min(band.right + half, width),
        min(band.bottom + half, height),
    )


@kernel
def box_sum(sums, x, y, w, h):
    """Sum of a rectangle from an integral image."""
    return sums[y + h, x + w] - sums[y, x + w] - sums[y + h, x] + sums[y, x]


@kernel
def spread(sums, squares, x, y):
    """Standard deviation times the number of pixels, of the window's inner part."""
    total = float(box_sum(sums, x + 1, y + 1, INNER, INNER))
    square = box_sum(squares, x + 1, y + 1, INNER, INNER)
    return math.sqrt(max(INNER * INNER * square - total * total, 0.0))


@kernel
def feature(sums, rect, weight, x, y):
    """A feature's weighted sum for the window at (x, y)."""
    value = 0.0
    for k in range(3):
        if weight[k] != 0.0:
            part = box_sum(sums, x + rect[k, 0], y + rect[k, 1], rect[k, 2], rect[k, 3])
            value += weight[k] * part
    return value


@kernel
def judge(sums, squares, parts, x, y):
    """How far the window at (x, y) passed the last stage; -1 where it fails any."""
    rects, weights, thresholds, left, right, ends, limits = parts
    sigma = spread(sums, squares, x, y)
    if sigma <= FLATTEST * INNER * INNER:
        return -1.0
    n, score = 0, 0.0
    for stage in range(ends.shape[0]):
        total = 0.0
        while n < ends[stage]:
            value = feature(sums, rects[n], weights[n], x, y) / sigma
            total += left[n] if value < thresholds[n] else right[n]
            n += 1
        score = total - limits[stage] + SLACK
        if score < 0.0:
            return -1.0
    return score


@kernel
def scan(sums, squares, parts, step, plane, size, place, hits):
    """Write centre (pixels of the picture) and score of every window that passes; returns how many.

    Args:
        sums, squares: integral images of the resized part.
        parts: of the cascade.
        step: from window to window.
        plane: expected size is plane[0] + plane[1] u + plane[2] v; all 0 to try every window.
        size: of these windows in the picture, pixels.
        place: left, top of the part, and its pixels per pixel of the resized one, across and down.
        hits: written, (MOST, 3).
    """
    count, filtered = 0, plane[0] != 0.0 or plane[1] != 0.0 or plane[2] != 0.0
    half = 0.5 * SIDE
    for y in range(0, sums.shape[0] - SIDE, step):
        v = place[1] + (y + half) * place[3] - 0.5
        for x in range(0, sums.shape[1] - SIDE, step):
            u = place[0] + (x + half) * place[2] - 0.5
            if filtered:
                expected = plane[0] + plane[1] * u + plane[2] * v
                if abs(size - expected) > TOLERANCE * expected:
                    continue
            score = judge(sums, squares, parts, x, y)
            if score >= 0.0 and count < hits.shape[0]:
                hits[count, 0], hits[count, 1], hits[count, 2] = u, v, score
                count += 1
    return count


def group(hits: Values, votes: int = VOTES) -> list[Detection]:
    """Hits whose centres lie within half a window of one another, as one object each.

    Args:
        hits: centre u, v, size, score, (n, 4).
        votes: fewer windows are no object.
    """
    left, out = hits[np.argsort(-hits[:, 3], kind="stable")], []
    while len(left):
        near = np.hypot(*(left[:, :2] - left[0, :2]).T) < 0.5 * left[0, 2]
        members, left = left[near], left[~near]
        if len(members) >= votes:
            weight = members[:, 3] + 0.1
            u, v, size = (float(weight @ members[:, k] / weight.sum()) for k in range(3))
            out.append(Detection((u, v), size, float(members[:, 3].sum()), len(members)))
    return sorted(out, key=lambda found: -found.score)
