"""A vehicle that flies level at constant speed and turns: exact circular arcs."""

from __future__ import annotations

import math

from visenvs.core.compile import kernel


@kernel
def turn(v, rate, dt, moved):
    """Advance by one step of constant turn rate; exact.

    Args:
        v: velocity (north, east), m/s, shape (2,); turned in place.
        rate: turn rate, clockwise positive, rad/s.
        dt: length of the step, s.
        moved: receives the displacement, m, shape (2,): the arc's chord, at half the turn.
    """
    half = 0.5 * rate * dt
    c, s = math.cos(half), math.sin(half)
    chord = dt * s / half if half != 0.0 else dt
    north, east = c * v[0] - s * v[1], s * v[0] + c * v[1]
    moved[0], moved[1] = chord * north, chord * east
    v[0], v[1] = c * north - s * east, s * north + c * east
