"""A vehicle as a point mass in N, in a plane or in space: a double integrator (thesis (2.1))."""

from __future__ import annotations

import math

from visenvs.core.compile import kernel


@kernel
def saturate(a, limit, out):
    """Write `a`, shortened to length `limit` where it is longer. Directions are kept. m/s^2."""
    square = 0.0
    for i in range(a.shape[0]):
        square += a[i] * a[i]
    norm = math.sqrt(square)
    gain = limit / norm if norm > limit else 1.0
    for i in range(a.shape[0]):
        out[i] = gain * a[i]


@kernel
def move(r, v, a, dt):
    """Advance position (m) and velocity (m/s) under an acceleration held for `dt` s; exact."""
    for i in range(r.shape[0]):
        r[i] += dt * (v[i] + 0.5 * dt * a[i])
        v[i] += dt * a[i]
