"""The bearing of a point in a horizontal plane: clockwise positive from the first axis."""

from __future__ import annotations

import math

from visenvs.core.compile import kernel


@kernel
def bearing(r):
    """Angle of a point, m, such as (north, east), in [-pi, pi], rad."""
    return math.atan2(r[1], r[0])


@kernel
def bearing_slope(ahead, right, min_range):
    """Derivatives of the bearing by the position, rad/m; a nearer one counts as at `min_range`."""
    square = max(ahead * ahead + right * right, min_range * min_range)
    return -right / square, ahead / square
