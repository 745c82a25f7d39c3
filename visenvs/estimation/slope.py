"""The velocity of something seen a few times: a straight line by least squares, no model needed.

A window (SIGHTS, 3) holds time (s), north and east (m) of the last sights, the oldest first.
"""

from __future__ import annotations

import math

from visenvs.core.compile import kernel

SIGHTS = 8  # that a window holds


@kernel
def push(window, filled, t, place):
    """Add a sight to a window of which `filled` rows are in use; returns how many are now."""
    if filled == SIGHTS:
        for i in range(SIGHTS - 1):
            for k in range(3):
                window[i, k] = window[i + 1, k]
        filled -= 1
    window[filled, 0], window[filled, 1], window[filled, 2] = t, place[0], place[1]
    return filled + 1


@kernel
def velocity(window, filled):
    """North and east (m/s) of the line, and the sum of squared times about their mean, s^2.

    The variance of either is that of a place over the sum. Without any spread in time: zeros.
    """
    t, north, east = 0.0, 0.0, 0.0
    for i in range(filled):
        t += window[i, 0] / filled
        north += window[i, 1] / filled
        east += window[i, 2] / filled
    spread, along_north, along_east = 0.0, 0.0, 0.0
    for i in range(filled):
        lever = window[i, 0] - t
        spread += lever * lever
        along_north += lever * (window[i, 1] - north)
        along_east += lever * (window[i, 2] - east)
    if spread <= 0.0:
        return 0.0, 0.0, 0.0
    return along_north / spread, along_east / spread, spread


@kernel
def course(window, filled, variance):
    """Heading (rad), speed (m/s) and standard deviation of the speed of the line.

    variance: of either coordinate of a sight, m^2.
    """
    north, east, spread = velocity(window, filled)
    deviation = math.sqrt(variance / spread) if spread > 0.0 else math.inf
    return math.atan2(east, north), math.sqrt(north * north + east * east), deviation
