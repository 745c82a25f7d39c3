"""Filters of a target at constant velocity that is seen by bearing only, in the horizontal plane.

State: r_TV_N, position relative to the observer, m, and v_T_N, the target's own velocity, m/s, both
(north, east): shape (4,), covariance (4, 4).
"""

from __future__ import annotations

import math

import numpy as np

from visenvs.core.bearing import bearing, bearing_slope
from visenvs.core.compile import kernel
from visenvs.core.frames import wrap_angle
from visenvs.estimation.ekf import factorise, pack_lower, update_scalar
from visenvs.estimation.ukf import sigma_points, update_angle

SCRATCH = np.dtype(
    [
        ("y", "f8", (4,)),  # the state and its covariance along the line of sight
        ("W", "f8", (4, 4)),
        ("factor", "f8", (10,)),
        ("points", "f8", (9, 4)),
        ("angles", "f8", (9,)),
        ("cross", "f8", (4,)),
        ("H", "f8", (1, 4)),
    ]
)


@kernel
def predict(x, P, moved, dt):
    """Let the target fly on for `dt` s and the observer move by `moved` (m, (2,)), in place; exact.

    It does not accelerate: there is no process noise.
    """
    for i in range(2):
        x[i] += dt * x[i + 2] - moved[i]
        for j in range(2):
            P[i, j] += dt * (P[i, j + 2] + P[i + 2, j] + dt * P[i + 2, j + 2])
    for i in range(2):
        for j in range(2):
            P[i, j + 2] += dt * P[i + 2, j + 2]
            P[j + 2, i] = P[i, j + 2]


@kernel
def turn_axes(angle, x, P, y, W):
    """Write state and covariance in axes turned clockwise by an angle (rad): y (4,), W (4, 4)."""
    c, s = math.cos(angle), math.sin(angle)
    for k in range(0, 4, 2):
        y[k], y[k + 1] = c * x[k] + s * x[k + 1], c * x[k + 1] - s * x[k]
        for j in range(4):
            W[j, k] = c * P[j, k] + s * P[j, k + 1]
            W[j, k + 1] = c * P[j, k + 1] - s * P[j, k]
    for k in range(0, 4, 2):
        for j in range(4):
            a, b = W[k, j], W[k + 1, j]
            W[k, j], W[k + 1, j] = c * a + s * b, c * b - s * a
    for i in range(4):
        for j in range(i):
            W[j, i] = W[i, j]


@kernel
def update_unscented(x, P, measured, settings, scratch):
    """Use a bearing (rad), in place; returns the innovation (rad).

    The points lie along the estimated line of sight and across it: a Cholesky factor depends on the
    axes, and in fixed ones so would the result.

    Args:
        settings: record with sigma_bearing (rad) and kappa; 0 is the cubature filter.
        scratch: a SCRATCH record.
    """
    factor, points, angles = scratch["factor"], scratch["points"], scratch["angles"]
    y, W, spread, sight = scratch["y"], scratch["W"], 4.0 + settings["kappa"], bearing(x)
    turn_axes(sight, x, P, y, W)
    pack_lower(W, factor)
    factorise(factor, 4)
    sigma_points(y, factor, spread, points)
    for j in range(9):
        angles[j] = bearing(points[j])
    seen, variance = wrap_angle(measured - sight), settings["sigma_bearing"] ** 2
    innovation, _ = update_angle(y, W, points, spread, angles, seen, variance, scratch["cross"])
    turn_axes(-sight, y, W, x, P)
    return innovation


@kernel
def update_extended(x, P, measured, settings, scratch):
    """Use a bearing (rad), linearised at the estimate, in place; returns the innovation (rad).

    Args:
        settings: record with sigma_bearing (rad) and min_range (m).
        scratch: a SCRATCH record.
    """
    H = scratch["H"]
    H[0, 0], H[0, 1] = bearing_slope(x[0], x[1], settings["min_range"])
    H[0, 2] = H[0, 3] = 0.0
    innovation = wrap_angle(measured - bearing(x))
    update_scalar(x, P, H, 0, innovation, settings["sigma_bearing"] ** 2, scratch["cross"])
    return innovation
