"""Where to fly sideways so that bearings tell the range of a leader that keeps its course.

Y is the lateral position of the leader relative to the follower, m, and Y'' = -a its follower's
acceleration, m/s^2. Both kernels give the wanted Y, its rate and its acceleration.

The optimal path (tracking paper, section 4) makes the integral of -(Y / sigma)^2 + (K a)^2 least
between given ends. Its Euler-Lagrange equation (25) is Y'''' = w^4 Y, w = (sigma K)^(-1/2) (27), so
that (26) is, with other constants, Y = p sin wt + q cos wt + r exp(w(t - T)) + s exp(-wt).

The paper calls Y "u_y", and by its "du_y/dt" it means the follower's own velocity, -dY/dt: read as
the derivative of Y, (23) and (26) contradict each other. The cost is indefinite: the path is a
minimum only as long as w T is less than the first root of cos z cosh z = 1, and beyond that there
is none. Between ends at rest on the wanted offset the optimal path is to stay there, so the ends
have to be put apart.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from visenvs.core.compile import kernel

CONJUGATE = 4.730040744862704  # least positive root of cos z cosh z = 1


def check_segment(sigma: float, weight: float, duration: float) -> float:
    """The frequency w (27) of a segment, rad/s, or a ValueError where no optimal path exists.

    Args:
        sigma: standard deviation of the image noise, dimensionless.
        weight: K of the acceleration, s^2.
        duration: T, s.
    """
    if not (sigma > 0 and weight > 0 and duration > 0):
        raise ValueError(
            "an optimal path needs sigma, weight and duration above 0, "
            f"got {sigma}, {weight} and {duration}"
        )
    w = 1.0 / math.sqrt(sigma * weight)
    if not w * duration < CONJUGATE:
        least = (duration / CONJUGATE) ** 2 / sigma
        raise ValueError(
            f"beyond its conjugate point a path has no least cost: omega T must be below "
            f"{CONJUGATE:.4f}, got {w:.4g} rad/s x {duration:g} s = {w * duration:.4g}; "
            f"write a duration below {CONJUGATE / w:.4g} or a weight above {least:.5g}"
        )
    return w


def optimal_path(
    ends: tuple[float, float, float, float], duration: float, sigma: float, weight: float, t: float
) -> NDArray[np.float64]:
    """The wanted (Y, dY/dt, d2Y/dt2) at a time of an optimal segment, shape (3,).

    Args:
        ends: Y and dY/dt at the start, then at the end, m and m/s.
        duration, sigma, weight: see `check_segment`.
        t: s, from 0 to duration.
    """
    w = check_segment(sigma, weight, duration)
    out = np.zeros(3)
    follow_path(ends[0], ends[1], ends[2], ends[3], duration, w, t, np.zeros((4, 5)), out)
    return out


@kernel
def follow_path(Y_0, rate_0, Y_f, rate_f, duration, w, t, M, out):
    """Write the wanted (Y, dY/dt, d2Y/dt2) at time t of an optimal segment into `out` (26).

    Args:
        Y_0, rate_0, Y_f, rate_f: ends, m and m/s.
        duration: s; w: rad/s, with w duration below CONJUGATE.
        M: scratch, (4, 5).
    """
    z = w * duration
    s, c, decay = math.sin(z), math.cos(z), math.exp(-z)
    M[0, 0], M[0, 1], M[0, 2], M[0, 3], M[0, 4] = 0.0, 1.0, decay, 1.0, Y_0
    M[1, 0], M[1, 1], M[1, 2], M[1, 3], M[1, 4] = 1.0, 0.0, decay, -1.0, rate_0 / w
    M[2, 0], M[2, 1], M[2, 2], M[2, 3], M[2, 4] = s, c, 1.0, decay, Y_f
    M[3, 0], M[3, 1], M[3, 2], M[3, 3], M[3, 4] = c, -s, 1.0, -decay, rate_f / w
    solve_four(M)
    s, c = math.sin(w * t), math.cos(w * t)
    grow, fall = M[2, 4] * math.exp(w * (t - duration)), M[3, 4] * math.exp(-w * t)
    out[0] = M[0, 4] * s + M[1, 4] * c + grow + fall
    out[1] = w * (M[0, 4] * c - M[1, 4] * s + grow - fall)
    out[2] = w * w * (-M[0, 4] * s - M[1, 4] * c + grow + fall)


@kernel
def solve_four(M):
    """Solve four equations (4, 5) by elimination; the last column becomes the answer."""
    for k in range(4):
        best = k
        for i in range(k + 1, 4):
            if abs(M[i, k]) > abs(M[best, k]):
                best = i
        for j in range(5):
            M[k, j], M[best, j] = M[best, j], M[k, j]
        for i in range(4):
            if i != k:
                factor = M[i, k] / M[k, k]
                for j in range(k, 5):
                    M[i, j] -= factor * M[k, j]
    for k in range(4):
        M[k, 4] /= M[k, k]


@kernel
def follow_sine(amplitude, period, t, out):
    """Write the wanted (Y, dY/dt, d2Y/dt2) of a sine into `out`: amplitude m, period and t in s."""
    w = 2.0 * math.pi / period
    out[0] = amplitude * math.sin(w * t)
    out[1] = amplitude * w * math.cos(w * t)
    out[2] = -w * w * out[0]
