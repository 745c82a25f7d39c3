"""A vehicle as a point mass in N: a double integrator under an acceleration (thesis (2.1))."""

from __future__ import annotations

import math

from visenvs.core.compile import kernel


@kernel
def saturate(a, limit, out):
    """Write `a`, shortened to length `limit` where it is longer. Directions are kept. m/s^2."""
    norm = math.sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2])
    gain = limit / norm if norm > limit else 1.0
    for i in range(3):
        out[i] = gain * a[i]


@kernel
def move(r, v, a, dt):
    """Advance position (m) and velocity (m/s) under an acceleration held for `dt` s; exact."""
    for i in range(3):
        r[i] += dt * (v[i] + 0.5 * dt * a[i])
        v[i] += dt * a[i]
