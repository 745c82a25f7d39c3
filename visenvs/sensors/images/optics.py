"""Where image points (y, z), in focal lengths, lie in a picture, in pixels."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

Values = NDArray[np.float64]
Image = NDArray[np.uint8]  # grey (height, width), or RGB (height, width, 3)
Fields = NDArray[Any]


@dataclass(frozen=True)
class Optics:
    """A pinhole camera with square pixels and the optical axis through the middle.

    Pixel (u, v) counts from the centre of the top left one: u = cx + focal y, v = cy + focal z.

    Attributes:
        width, height: of the picture, pixels.
        focal: focal length, pixels.
    """

    width: int = 320
    height: int = 240
    focal: float = 277.0

    def __post_init__(self) -> None:
        if self.width < 8 or self.height < 8 or not 0.0 < self.focal < np.inf:
            raise ValueError(
                f"a picture has at least 8 x 8 pixels and a positive focal length, got {self}; "
                "write `Optics(320, 240, 277.0)`"
            )

    @property
    def cx(self) -> float:
        """Column of the optical axis, pixels."""
        return 0.5 * (self.width - 1)

    @property
    def cy(self) -> float:
        """Row of the optical axis, pixels."""
        return 0.5 * (self.height - 1)

    @cached_property
    def matrix(self) -> Values:
        """Maps a position in C to (u, v, 1) times its depth, shape (3, 3)."""
        return np.array([[self.cx, self.focal, 0.0], [self.cy, 0.0, self.focal], [1.0, 0.0, 0.0]])

    def pixels(self, points: ArrayLike) -> Values:
        """Pixels (u, v) of image points (y, z), shape (..., 2)."""
        return np.asarray(points, float) * self.focal + (self.cx, self.cy)

    def points(self, pixels: ArrayLike) -> Values:
        """Image points (y, z) of pixels (u, v), shape (..., 2)."""
        return (np.asarray(pixels, float) - (self.cx, self.cy)) / self.focal

    def project(self, C: ArrayLike, r: ArrayLike) -> tuple[Values, Values]:
        """Pixels (..., 2) and depths (...,), m, of positions relative to the camera in N, (..., 3).

        Pixels of what is not ahead of the camera are NaN.
        """
        homogeneous = np.asarray(r, float) @ (self.matrix @ np.asarray(C, float)).T
        depth = homogeneous[..., 2]
        ahead = np.where(depth > 1e-9, depth, np.nan)
        return homogeneous[..., :2] / ahead[..., None], depth

    def shows(self, pixels: Values, border: float = 0.0) -> NDArray[np.bool_]:
        """Which pixels (..., 2) lie in the picture, at least `border` pixels from its edge."""
        u, v = pixels[..., 0], pixels[..., 1]
        across = (u >= border) & (u <= self.width - 1 - border)
        return across & (v >= border) & (v <= self.height - 1 - border)
