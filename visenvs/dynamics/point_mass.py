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


@kernel
def fly(lane, action, cfg, moved):
    """Obey a command for one step; `moved` receives the displacement in N, m, shape (D,).

    Args:
        lane: record with r_V_N, r_TV_N (own position; a fixed target relative to it), v_V_N and
            a_V_N, (D,), SI; changed in place.
        action: acceleration over the largest one, (D,).
        cfg: record with a_max (m/s^2), dt (s).
    """
    a = lane["a_V_N"]
    for i in range(a.shape[0]):
        a[i] = cfg["a_max"] * action[i]
        moved[i] = 0.0
    saturate(a, cfg["a_max"], a)
    move(moved, lane["v_V_N"], a, cfg["dt"])
    for i in range(a.shape[0]):
        lane["r_V_N"][i] += moved[i]
        lane["r_TV_N"][i] -= moved[i]
