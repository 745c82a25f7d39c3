"""Drawing helpers that every picture shares: panels with metric axes, marks, ellipses.

OpenCV draws, anti-aliased and with 1/16 pixel resolution. Marks with a coordinate that is not
finite are left out, so that the last record of a diverged lane can still be drawn.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from visenvs.render.style import FRAME, GREY, GRID, WHITE, Colour, Image, paint, write

Points = NDArray[np.float64]

SHIFT = 4  # fractional bits of OpenCV's pixel coordinates
FAR = 20_000.0  # nothing is drawn further out than this, pixels
CORNERS = 72  # of the polygon that stands for an ellipse or an arc
ANGLES = np.linspace(0.0, 2.0 * math.pi, CORNERS, endpoint=False)
CIRCLE = np.stack([np.cos(ANGLES), np.sin(ANGLES)], axis=1)
NOTHING = np.zeros((0, 2))
NO_PIXELS = np.zeros((0, 2), np.int32)


def ellipse_points(
    mean: ArrayLike, covariance: ArrayLike, sigmas: float, longest: float = math.inf
) -> Points:
    """Points x with (x - mean)' covariance^-1 (x - mean) = sigmas^2, shape (CORNERS, 2).

    A singular covariance gives the flat ellipse that it stands for. No semi-axis is longer than
    `longest`.
    """
    values, axes = np.linalg.eigh(np.asarray(covariance, float))
    semi_axes = np.minimum(sigmas * np.sqrt(np.maximum(values, 0.0)), longest)
    return np.asarray(mean, float) + (CIRCLE * semi_axes) @ axes.T


def nice_step(least: float) -> float:
    """The smallest of 1, 2, 5 times a power of ten that is not below `least`."""
    power = 10.0 ** math.floor(math.log10(least))
    return next(m * power for m in (1.0, 2.0, 5.0, 10.0) if m * power >= least * (1.0 - 1e-12))


@dataclass(frozen=True)
class Panel:
    """A rectangle of a picture that shows a plane at one scale in both directions.

    Points are (right, up) in the plane's own unit, shape (..., 2); what lies outside is cut off.

    Attributes:
        image: the whole picture.
        left, top, width, height: the rectangle, pixels.
        centre: the point (right, up) in its middle.
        scale: pixels per unit.
    """

    image: Image
    left: int
    top: int
    width: int
    height: int
    centre: tuple[float, float] = (0.0, 0.0)
    scale: float = 1.0

    @property
    def view(self) -> Image:
        """The part of the picture inside the rectangle; drawing on it draws on the picture."""
        return self.image[self.top : self.top + self.height, self.left : self.left + self.width]

    @cached_property
    def gain(self) -> Points:
        """Pixels (right, down) per unit (right, up), shape (2,)."""
        return np.array([self.scale, -self.scale])

    @cached_property
    def origin(self) -> Points:
        """Pixel coordinates of the point (0, 0), shape (2,)."""
        return np.array([self.width / 2, self.height / 2]) - self.gain * self.centre

    def pixels(self, points: ArrayLike) -> Points:
        """Pixel coordinates (right, down) from the rectangle's corner, shape (..., 2)."""
        return self.origin + self.gain * np.asarray(points, float)

    def shows(self, point: ArrayLike) -> bool:
        """Whether a point lies inside the rectangle."""
        x, y = self.pixels(point)
        return bool(0 <= x <= self.width and 0 <= y <= self.height)

    def clear(self, colour: Colour = WHITE) -> None:
        """Paint the rectangle."""
        paint(self.view, colour)

    def border(self, colour: Colour = FRAME) -> None:
        """Draw the rectangle's edge."""
        cv2.rectangle(self.view, (0, 0), (self.width - 1, self.height - 1), colour, 1)

    def show(self, frame: Image, low: ArrayLike, high: ArrayLike) -> None:
        """Draw a picture between its lower left and upper right corner, (right, up)."""
        (left, bottom), (right, top) = np.rint(self.pixels(np.array((low, high)))).astype(int)
        shown = cv2.resize(frame, (right - left, bottom - top), interpolation=cv2.INTER_AREA)
        x, y = max(left, 0), max(top, 0)
        part = self.view[y : max(bottom, 0), x : max(right, 0)]
        part[:] = shown[y - top :, x - left :][: part.shape[0], : part.shape[1]]

    def fill(self, points: ArrayLike, colour: Colour) -> None:
        """Fill a polygon, points (n, 2)."""
        grid = self._grid(points)
        if len(grid) > 2:
            cv2.fillPoly(self.view, [grid], colour, cv2.LINE_AA, SHIFT)

    def line(
        self, points: ArrayLike, colour: Colour, thickness: int = 1, closed: bool = False
    ) -> None:
        """Draw a line through points (n, 2)."""
        grid = self._grid(points)
        if len(grid) > 1:
            cv2.polylines(self.view, [grid], closed, colour, thickness, cv2.LINE_AA, SHIFT)

    def disc(self, point: ArrayLike, radius: float, colour: Colour, thickness: int = -1) -> None:
        """Draw a circle of a radius in pixels about a point; thickness -1 fills it."""
        grid = self._grid(np.asarray(point, float)[None])
        if len(grid) and math.isfinite(radius):
            size = round(min(radius, FAR) * (1 << SHIFT))
            centre = (int(grid[0, 0]), int(grid[0, 1]))
            cv2.circle(self.view, centre, size, colour, thickness, cv2.LINE_AA, SHIFT)

    def reticle(self, point: ArrayLike, colour: Colour, thickness: int = 2) -> None:
        """Draw an upright cross that leaves its middle open."""
        self._spokes(point, (1.0, 0.0), (5.0, 10.0), colour, thickness)

    def cross(self, point: ArrayLike, colour: Colour, thickness: int = 1) -> None:
        """Draw a diagonal cross."""
        self._spokes(point, (math.sqrt(0.5), math.sqrt(0.5)), (0.0, 5.5), colour, thickness)

    def arrow(
        self, start: ArrayLike, vector: ArrayLike, colour: Colour, thickness: int = 2
    ) -> None:
        """Draw a vector of the plane's unit; one under three pixels long is left out."""
        tail, span = np.asarray(start, float), np.asarray(vector, float)
        length = float(np.hypot(*span)) * self.scale
        if not 3.0 <= length < math.inf:
            return
        if length > self.width / 2:
            span, length = span * (self.width / 2 / length), self.width / 2
        head = min(8.0, 0.6 * length) / length * span
        side = 0.45 * np.array([-head[1], head[0]])
        tip = tail + span
        self.line([tail, tip - 0.7 * head], colour, thickness)
        self.fill([tip, tip - head + side, tip - head - side], colour)

    def dart(self, point: ArrayLike, towards: ArrayLike, colour: Colour, size: float = 9.0) -> None:
        """Draw a vehicle: a dart that flies along `towards`, or a disc if that is 0."""
        length = float(np.hypot(*np.asarray(towards, float)))
        if not 1e-9 < length < math.inf:
            self.disc(point, 0.7 * size, WHITE)
            self.disc(point, 0.55 * size, colour)
            return
        ahead = np.asarray(towards, float) / length * (size / self.scale)
        left = np.array([-ahead[1], ahead[0]])
        shape = [ahead, -0.8 * ahead + 0.7 * left, -0.4 * ahead, -0.8 * ahead - 0.7 * left]
        corners = np.asarray(point, float) + np.array(shape)
        self.line(corners, WHITE, 4, closed=True)
        self.fill(corners, colour)

    def sector(self, apex: ArrayLike, middle: ArrayLike, side: ArrayLike, reach: float) -> Points:
        """Outline of the circle sector about direction `middle` that has `side` on its edge.

        `reach` is its radius, pixels. Empty where `middle` has no direction.
        """
        (mx, my), (sx, sy) = np.asarray(middle, float), np.asarray(side, float)
        if not math.hypot(mx, my) > 1e-6:
            return NOTHING
        half = abs(math.atan2(mx * sy - my * sx, mx * sx + my * sy))
        angle = math.atan2(my, mx) + np.linspace(-half, half, CORNERS)
        arc = np.stack([np.cos(angle), np.sin(angle)], axis=1) * (reach / self.scale)
        return np.asarray(apex, float) + np.vstack([np.zeros(2), arc])

    def ellipse(self, mean: ArrayLike, covariance: ArrayLike, sigmas: float) -> Points:
        """Points of `ellipse_points`; empty where it is smaller than a pixel."""
        if not np.isfinite(covariance).all():
            return NOTHING
        points = ellipse_points((0.0, 0.0), covariance, sigmas, FAR / 2 / self.scale)
        if float(np.abs(points).max()) * self.scale < 1.0:
            return NOTHING
        return np.asarray(mean, float) + points

    def pointer(self, point: ArrayLike, colour: Colour) -> None:
        """At a point outside the rectangle, point to it from the edge."""
        offset = self.pixels(point) - (self.width / 2, self.height / 2)
        if self.shows(point) or not np.isfinite(offset).all():
            return
        room = np.array([self.width / 2 - 9.0, self.height / 2 - 9.0])
        with np.errstate(divide="ignore"):
            place = offset * float(np.min(room / np.abs(offset)))
        ahead = offset / float(np.hypot(*offset))
        left = np.array([-ahead[1], ahead[0]])
        shape = np.array([7.0 * ahead, -4.0 * ahead + 6.0 * left, -4.0 * ahead - 6.0 * left])
        corners = np.array(self.centre) + (place + shape) * (1.0, -1.0) / self.scale
        self.line(corners, WHITE, 3, closed=True)
        self.fill(corners, colour)

    def ticks(self) -> tuple[list[float], list[float]]:
        """Round values along both axes inside the rectangle, at least 48 pixels apart."""
        step = nice_step(48.0 / self.scale)
        out = []
        for middle, pixels in zip(self.centre, (self.width, self.height), strict=True):
            first = math.ceil((middle - pixels / 2 / self.scale) / step)
            last = math.floor((middle + pixels / 2 / self.scale) / step)
            out.append([k * step for k in range(first, last + 1)])
        return out[0], out[1]

    def path(self, points: Points, colour: Colour) -> None:
        """Draw a track through points (n, 2), thinned so that close points make no beads."""
        if len(points) > 1 and np.isfinite(points).all():
            steps = np.hypot(*np.diff(points, axis=0).T) * self.scale
            stride = np.append(0.0, np.cumsum(steps)) // 6.0
            kept = np.diff(stride, prepend=-1.0) > 0.0
            kept[-1] = True
            self.line(points[kept], colour, 2)

    def grid(self) -> None:
        """Draw a line at every tick."""
        across, up = self.ticks()
        for x in across:
            column = int(self.pixels((x, 0.0))[0])
            cv2.line(self.view, (column, 0), (column, self.height), GRID, 1)
        for y in up:
            row = int(self.pixels((0.0, y))[1])
            cv2.line(self.view, (0, row), (self.width, row), GRID, 1)

    def labels(self, right: str, upward: str) -> None:
        """Write tick values outside the rectangle and the axes' names inside."""
        across, up = self.ticks()
        bottom = self.top + self.height
        for x in across:
            at = (self.left + self.pixels((x, 0.0))[0], bottom + 15)
            write(self.image, _plain(x), at, 12, GREY, "middle")
        for y in up:
            at = (self.left - 6, self.top + self.pixels((0.0, y))[1] + 4)
            write(self.image, _plain(y), at, 12, GREY, "right")
        write(self.image, right, (self.left + self.width - 6, bottom - 7), 12, GREY, "right")
        write(self.image, upward, (self.left + 7, self.top + 15), 12, GREY)

    def _spokes(
        self,
        point: ArrayLike,
        ahead: tuple[float, float],
        radii: tuple[float, float],
        colour: Colour,
        thickness: int,
    ) -> None:
        x, y = ahead
        spokes = np.array([[x, y], [-y, x], [-x, -y], [y, -x]]) / self.scale
        ends = np.asarray(point, float) + spokes[:, None] * np.array(radii)[:, None]
        pixels = self._grid(ends.reshape(8, 2))
        if len(pixels):
            lines = list(pixels.reshape(4, 2, 2))
            cv2.polylines(self.view, lines, False, colour, thickness, cv2.LINE_AA, SHIFT)

    def _grid(self, points: ArrayLike) -> NDArray[np.int32]:
        at = np.minimum(np.maximum(self.pixels(points), -FAR), FAR)
        if not np.isfinite(at).all():
            return NO_PIXELS
        return np.rint((at - 0.5) * (1 << SHIFT)).astype(np.int32)


def _plain(value: float) -> str:
    return f"{value:g}".replace("-", "\N{MINUS SIGN}")
