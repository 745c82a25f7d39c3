"""What is known before a picture is looked at, and the part of it that is left to search."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from visenvs.core.pinhole import jacobian, project
from visenvs.sensors.images.optics import Optics, Values

GATE = 3.0  # standard deviations that a search region reaches
WHOLE = 0.5  # a region of more than this part of the picture is the whole picture


@dataclass(frozen=True)
class Region:
    """A rectangle of a picture, pixels; `right` and `bottom` are not in it any more."""

    left: int
    top: int
    right: int
    bottom: int

    @property
    def width(self) -> int:
        """Columns."""
        return self.right - self.left

    @property
    def height(self) -> int:
        """Rows."""
        return self.bottom - self.top


@dataclass(frozen=True)
class Prior:
    """A filter's prediction of where something will be seen.

    Attributes:
        point: predicted image point (y, z), focal lengths.
        deviation: its standard deviations, focal lengths.
        size: half of what it measures in the picture, focal lengths.
    """

    point: tuple[float, float]
    deviation: tuple[float, float]
    size: float


def predicted(C: Values, r: Values, P: Values, half: float, nearest: float) -> Prior:
    """Where an estimate says that something will be seen.

    Args:
        C: attitude C_CN of the camera, (3, 3).
        r: estimated position relative to it in N, m, (3,).
        P: covariance of that, m^2, (3, 3).
        half: half of what it measures, m.
        nearest: a depth below this counts as this, m.
    """
    H = np.zeros((2, 3))
    X, y, z = project(C, r, nearest)
    jacobian(C, X, y, z, H)
    across, down = np.sqrt(np.maximum(np.einsum("ij,jk,ik->i", H, P, H), 0.0))
    return Prior((y, z), (float(across), float(down)), half / X)


def whole(optics: Optics) -> Region:
    """The whole picture."""
    return Region(0, 0, optics.width, optics.height)


def search_region(optics: Optics, prior: Prior | None, margin: float = 10.0) -> Region | None:
    """Where to search: the prediction, GATE deviations, half the size and a margin (pixels).

    The whole picture for no prediction, or one that says little; None where it says that nothing
    is in view.
    """
    if prior is None or not all(map(math.isfinite, (*prior.point, *prior.deviation, prior.size))):
        return whole(optics)
    u, v = optics.pixels(prior.point)
    across, down = (
        optics.focal * (GATE * deviation + prior.size) + margin for deviation in prior.deviation
    )
    if 4.0 * across * down > WHOLE * optics.width * optics.height:
        return whole(optics)
    region = Region(
        max(int(u - across), 0),
        max(int(v - down), 0),
        min(math.ceil(u + across) + 1, optics.width),
        min(math.ceil(v + down) + 1, optics.height),
    )
    return region if region.width > 2 and region.height > 2 else None
