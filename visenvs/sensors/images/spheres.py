"""Finds red balls in a picture: image points of their centres, and the angles of their radii.

The image processor of the thesis's simulation (3.5.2). Red areas are connected; one that is small,
whole and round gives its moments, corrected for what a ball off the axis looks like; one that is
large, that the border cuts, or that several balls make together, gives its outline, which is a
circle of directions: d' c = cos alpha for the unit vectors d to the outline, c to the centre, and
alpha the radius's angle. That is linear in c / cos alpha, and the circle that most of the outline
lies on is taken first.
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
from visenvs.sensors.images.prior import Prior, Region, search_region

RED = 28  # least excess of red over green and blue, grey levels
LEAST = 7  # pixels of an area
SMALL = 28  # an area no wider gives its moments, pixels
AROUND = 4  # of the background, pixels on all sides
ROUND = 0.02  # how much an area may miss of its ellipse
LARGEST = 8  # circles of one area at most
NEAR = 1.1  # a point of the outline lies on a circle that passes so near, pixels
LEAST_ARC = 0.3  # of a circle must be seen
TRIES = 24  # places on the outline where a circle is tried, at each of SPREADS
SPREADS = (0.06, 0.12, 0.2, 0.33)  # between the three points of a try, in outlines


@dataclass(frozen=True)
class Ball:
    """One ball as seen.

    Attributes:
        point: image point of its centre (y, z), focal lengths.
        angle: between the directions to its centre and to its edge, rad.
        whole: whether all of it was seen.
    """

    point: tuple[float, float]
    angle: float
    whole: bool

    def depth(self, radius: float) -> float:
        """Of the centre along the optical axis, m, for a radius in m."""
        y, z = self.point
        return radius / math.sin(self.angle) / math.sqrt(1.0 + y * y + z * z)


def detect(image: Image, optics: Optics, prior: Prior | None = None) -> list[Ball]:
    """All red balls in the search region, large ones first; none is an empty list.

    Args:
        image: RGB, (height, width, 3).
        optics: the camera.
        prior: where to search; None for the whole picture.
    """
    region = search_region(optics, prior)
    if region is None:
        return []
    mask = np.empty((region.height, region.width), np.uint8)
    part = image[region.top : region.bottom, region.left : region.right]
    mark_red(part, mask)
    count, labels, stats, _ = cv2.connectedComponentsWithStats(mask, connectivity=8)
    found: list[Ball] = []
    for k in range(1, count):
        left, top, width, height, area = (int(value) for value in stats[k])
        if area >= LEAST:
            box = Region(left, top, left + width, top + height)
            found += _balls(part, labels, k, box, region, optics)
    return sorted(found, key=lambda ball: -ball.angle)


@kernel
def mark_red(part, mask):
    """Write which pixels of a picture (rows, columns, 3) are red."""
    for v in range(mask.shape[0]):
        for u in range(mask.shape[1]):
            other = float(max(part[v, u, 1], part[v, u, 2]))
            mask[v, u] = 1 if float(part[v, u, 0]) - other > RED else 0


def _balls(
    part: Image, labels: NDArray[Any], k: int, box: Region, region: Region, optics: Optics
) -> list[Ball]:
    """The balls of one connected area."""
    shape = labels.shape
    cut = box.left <= 0 or box.top <= 0 or box.right >= shape[1] or box.bottom >= shape[0]
    if not cut and max(box.width, box.height) <= SMALL:
        moments = np.empty(6)
        top, left = max(box.top - AROUND, 0), max(box.left - AROUND, 0)
        near = slice(top, box.bottom + AROUND), slice(left, box.right + AROUND)
        sum_up(part[near], labels[near], k, moments)
        corner = region.left + left, region.top + top
        ball = _from_moments(moments, corner, optics)
        if ball is not None:
            return [ball]
    inside = np.ascontiguousarray(labels[box.top : box.bottom, box.left : box.right] == k)
    outlines, _ = cv2.findContours(
        inside.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE
    )
    outline = max(outlines, key=len).reshape(-1, 2) + np.array([box.left, box.top])
    edge = np.array([shape[1] - 1, shape[0] - 1])
    free = outline[((outline > 0) & (outline < edge)).all(axis=1)] + (region.left, region.top)
    return _from_outline(optics.points(free), optics)


@kernel
def sum_up(part, labels, k, out):
    """Write weight, mean (column, row) and second moments (uu, vv, uv) of an area, (6,).

    A pixel counts with the part of it that is covered, whatever the ball's shade there: it is a
    mixture a F + b B of the area's colour and the background's, and 1 - b is covered.

    Args:
        part: RGB, (rows, columns, 3), the area and a border around it.
        labels: number of the area that every pixel belongs to, 0 for none, (rows, columns).
    """
    F, B, inside, around = np.zeros(3), np.zeros(3), 0, 0
    for v in range(labels.shape[0]):
        for u in range(labels.shape[1]):
            if labels[v, u] == k:
                inside += 1
                for i in range(3):
                    F[i] += part[v, u, i]
            elif labels[v, u] == 0 and not beside(labels, v, u, k):
                around += 1
                for i in range(3):
                    B[i] += part[v, u, i]
    scale, square = 0.0, 0.0
    for i in range(3):
        B[i] /= max(around, 1)
        scale += F[i] * B[i]
        square += F[i] * F[i]
    for i in range(3):
        F[i] = B[i] - scale / square * F[i]  # the background's part that the ball has not
    scale = F[0] * B[0] + F[1] * B[1] + F[2] * B[2]
    out[:] = 0.0
    for v in range(labels.shape[0]):
        for u in range(labels.shape[1]):
            if labels[v, u] == k or (labels[v, u] == 0 and beside(labels, v, u, k)):
                w = F[0] * part[v, u, 0] + F[1] * part[v, u, 1] + F[2] * part[v, u, 2]
                w = min(max(1.0 - w / scale, 0.0), 1.0)
                out[0] += w
                out[1] += w * u
                out[2] += w * v
                out[3] += w * u * u
                out[4] += w * v * v
                out[5] += w * u * v
    for i in range(1, 6):
        out[i] /= out[0]
    out[3] -= out[1] * out[1]
    out[4] -= out[2] * out[2]
    out[5] -= out[1] * out[2]


@kernel
def beside(labels, v, u, k):
    """Whether a pixel is within two of an area."""
    rows, columns = labels.shape
    for i in range(max(v - 2, 0), min(v + 3, rows)):
        for j in range(max(u - 2, 0), min(u + 3, columns)):
            if labels[i, j] == k:
                return True
    return False


def _from_moments(moments: Values, corner: tuple[int, int], optics: Optics) -> Ball | None:
    """A ball whose image is the ellipse of these moments; None where they are of no ellipse."""
    area, mean_u, mean_v, uu, vv, uv = moments
    y, z = optics.points((mean_u + corner[0], mean_v + corner[1]))
    square = float(y * y + z * z)
    # a ball's ellipse points away from the axis: semi-axes `long`, b with long / b from its place
    b2, long = area / (math.pi * optics.focal**2), 1.0
    for _ in range(4):
        cosine = 1.0 / (1.0 + square / (1.0 + b2) ** 2)
        sine = b2 * cosine / (1.0 + b2)
        long = math.sqrt((1.0 - sine) * (1.0 + b2) / cosine)
        b2 = area / (math.pi * optics.focal**2 * long)
    # the ellipse of this area and place has these second moments
    spread = b2 * optics.focal**2 / 4.0 * (1.0 + long * long) + 2.0 / 12.0
    root = math.sqrt(b2) * optics.focal
    if abs(uu + vv - spread) > (ROUND + 0.25 / root + 0.5 / root**2) * spread:
        return None
    if 8.0 * math.hypot(0.5 * (uu - vv), uv) > (long**2 - 1.0 + 2.0 * ROUND + 1.5 / root) * root**2:
        return None
    cosine = 1.0 / (1.0 + square / (1.0 + b2) ** 2)
    angle = math.asin(math.sqrt(b2 * cosine / (1.0 + b2)))
    return Ball((float(y / (1.0 + b2)), float(z / (1.0 + b2))), angle, True)


def _from_outline(points: Values, optics: Optics) -> list[Ball]:
    """Balls whose outlines together are these image points, in order, (n, 2)."""
    rays = np.concatenate([np.ones((len(points), 1)), points], axis=1)
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    left, found = np.ones(len(rays), np.uint8), []
    normal, near = np.empty(3), NEAR / optics.focal
    for _ in range(LARGEST):
        if fit_circle(rays, left, near, normal) < 6:
            break
        length = float(np.linalg.norm(normal))
        angle, centre = math.acos(min(1.0 / length, 1.0)), normal / length
        off = np.arccos(np.clip(rays @ centre, -1.0, 1.0)) - angle
        on = (np.abs(off) < near) & (left > 0)
        arc = on.sum() / optics.focal / max(2.0 * math.pi * math.sin(angle), 1e-9)
        left[off < 2.5 * near] = 0
        angle += 0.5 / optics.focal  # the outline's pixels lie inside by half a pixel
        if arc >= LEAST_ARC and centre[0] > 0.0 and angle * optics.focal > 1.5:
            y, z = centre[1] / centre[0], centre[2] / centre[0]
            found.append(Ball((float(y), float(z)), angle, arc > 0.9))
    return found


@kernel
def fit_circle(rays, left, near, normal):
    """Find the circle that most of the remaining rays lie on; returns how many do.

    Args:
        rays: unit vectors along an outline, in order, (n, 3).
        left: 1 for those that belong to no circle yet, (n,).
        near: how near a ray must pass, rad.
        normal: receives n with d' n = 1 for the rays d of the circle, (3,), by least squares.
    """
    count, best, most = rays.shape[0], np.zeros(3), 0
    index = np.zeros(count, np.int64)
    n = 0
    for i in range(count):
        if left[i] > 0:
            index[n] = i
            n += 1
    if n < 6:
        return 0
    A, b = np.zeros((3, 3)), np.zeros(3)
    for spread in SPREADS:
        for k in range(TRIES):
            for j in range(3):
                place = int((k / TRIES + j * spread) * n) % n
                for m in range(3):
                    A[j, m] = rays[index[place], m]
                b[j] = 1.0
            if solve(A, b, normal):
                on = supporters(rays, left, normal, near)
                if on > most:
                    most = on
                    for m in range(3):
                        best[m] = normal[m]
    for m in range(3):
        normal[m] = best[m]
    for _ in range(3):
        if most < 6 or not refit(rays, left, near, normal, A, b):
            return 0
    return supporters(rays, left, normal, near)


@kernel
def supporters(rays, left, normal, near):
    """How many of the remaining rays pass within `near` (rad) of a circle."""
    length = math.sqrt(normal[0] ** 2 + normal[1] ** 2 + normal[2] ** 2)
    if length <= 1.0:
        return 0
    cosine, total = 1.0 / length, 0
    band = near * math.sqrt(1.0 - cosine * cosine)
    for i in range(rays.shape[0]):
        along = rays[i, 0] * normal[0] + rays[i, 1] * normal[1] + rays[i, 2] * normal[2]
        if left[i] > 0 and abs(along / length - cosine) < band:
            total += 1
    return total


@kernel
def refit(rays, left, near, normal, A, b):
    """The circle through the rays near it by least squares, in place; False where there is none."""
    length = math.sqrt(normal[0] ** 2 + normal[1] ** 2 + normal[2] ** 2)
    cosine = 1.0 / max(length, 1.0)
    band = near * math.sqrt(1.0 - cosine * cosine)
    A[:] = 0.0
    b[:] = 0.0
    for i in range(rays.shape[0]):
        along = rays[i, 0] * normal[0] + rays[i, 1] * normal[1] + rays[i, 2] * normal[2]
        if left[i] > 0 and abs(along / length - cosine) < band:
            for j in range(3):
                b[j] += rays[i, j]
                for m in range(3):
                    A[j, m] += rays[i, j] * rays[i, m]
    return solve(A, b, normal)


@kernel
def solve(A, b, x):
    """Solve a 3 by 3 system by Cramer's rule; False where it is singular."""
    c0 = A[1, 1] * A[2, 2] - A[1, 2] * A[2, 1]
    c1 = A[1, 2] * A[2, 0] - A[1, 0] * A[2, 2]
    c2 = A[1, 0] * A[2, 1] - A[1, 1] * A[2, 0]
    det = A[0, 0] * c0 + A[0, 1] * c1 + A[0, 2] * c2
    if abs(det) < 1e-13:
        return False
    x[0] = (b[0] * c0 + A[0, 1] * (A[1, 2] * b[2] - b[1] * A[2, 2])) / det
    x[0] += A[0, 2] * (b[1] * A[2, 1] - A[1, 1] * b[2]) / det
    x[1] = (A[0, 0] * (b[1] * A[2, 2] - A[1, 2] * b[2]) + b[0] * c1) / det
    x[1] += A[0, 2] * (A[1, 0] * b[2] - b[1] * A[2, 0]) / det
    x[2] = (A[0, 0] * (A[1, 1] * b[2] - b[1] * A[2, 1]) + b[0] * c2) / det
    x[2] += A[0, 1] * (b[1] * A[2, 0] - A[1, 0] * b[2]) / det
    return True
