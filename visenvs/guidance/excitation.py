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
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from visenvs.core.compile import kernel
from visenvs.core.registry import Law
from visenvs.guidance.formation import GENTLE, NEEDS, track_path

CONJUGATE = 4.730040744862704  # least positive root of cos z cosh z = 1
# relative uncertainty of the range that is worth the whole manoeuvre, and the least share of it
FULL, LEAST = 0.1, 0.1
# places in a row's memory: time, s; when the segment began, s; its ends, m; its frequency, rad/s
CLOCK, BEGAN, START, END, FREQUENCY, MEMORY = range(6)


def check_segment(sigma: float, weight: float, duration: float) -> float:
    """The frequency w (27) of a segment, rad/s, or a ValueError where no optimal path exists.

    Args:
        sigma: standard deviation of the image noise, dimensionless.
        weight: K of the acceleration, s^2.
        duration: T, s.
    """
    if not (sigma > 0 and duration > 0 and sigma * weight > 0):
        raise ValueError(
            "an optimal path needs sigma, weight and duration above 0, "
            f"got {sigma}, {weight} and {duration}"
        )
    w = 1.0 / math.sqrt(sigma * weight)
    if not w * duration < CONJUGATE:
        least = duration / CONJUGATE * (duration / CONJUGATE) / sigma
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


@kernel
def next_segment(memory, belief, settings, scheduled):
    """Choose the end of a new segment and its frequency, from where the last one ended.

    The ends lie in turn to the left and right of the offset, and on it outside the window. A
    schedule shortens them and lightens the manoeuvre where the range is well known already.
    """
    share = 1.0
    if scheduled:
        share = min(max(belief["sd_log_range"] / FULL, LEAST), 1.0)
    began = memory[CLOCK]
    memory[BEGAN], memory[START] = began, memory[END]
    memory[END] = 0.0
    window, rest = settings["meander_window"], 0.5 * settings["dt"]
    if began > window[0] - rest and began < window[1] - settings["meander_segment"] - rest:
        side = -1.0 if memory[START] > 0.0 else 1.0
        memory[END] = side * share * settings["meander_reach"]
    weight = settings["meander_weight"] / (share * share)
    memory[FREQUENCY] = 1.0 / math.sqrt(settings["sigma_image"] * weight)


@kernel
def meander(scheduled, beliefs, settings, memory, commands):
    """Track optimal segments from one side of the offset to the other."""
    M, path, w = np.zeros((4, 5)), np.zeros(3), np.zeros((3, 3))
    s = settings[0]
    for i in range(beliefs.shape[0]):
        m = memory[i]
        if m[FREQUENCY] == 0.0 or m[CLOCK] - m[BEGAN] > s["meander_segment"] - 0.5 * s["dt"]:
            next_segment(m, beliefs[i], s, scheduled)
        t = m[CLOCK] - m[BEGAN]
        follow_path(m[START], 0.0, m[END], 0.0, s["meander_segment"], m[FREQUENCY], t, M, path)
        track_beside(beliefs[i], path, w, commands[i])
        m[CLOCK] += s["dt"]


@kernel
def weave(beliefs, settings, memory, commands):
    """Track a sine about the offset, whose half period is a segment."""
    path, w, s = np.zeros(3), np.zeros((3, 3)), settings[0]
    window = s["meander_window"]
    for i in range(beliefs.shape[0]):
        m, rest = memory[i], 0.5 * s["dt"]
        t = m[CLOCK] - window[0]
        if t > -rest and m[CLOCK] < window[1] - rest:
            follow_sine(s["meander_reach"], 2.0 * s["meander_segment"], t, path)
        else:
            path[0] = path[1] = path[2] = 0.0
        track_beside(beliefs[i], path, w, commands[i])
        m[CLOCK] += s["dt"]


@kernel
def track_beside(belief, path, w, out):
    """Track the offset moved to the right by path = (Y, dY/dt, d2Y/dt2); w is scratch, (3, 3)."""
    for j in range(3):
        w[0, j] = belief["offset_F"][j]
        w[1, j] = w[2, j] = 0.0
    w[0, 1] += path[0]
    w[1, 1], w[2, 1] = path[1], path[2]
    track_path(belief, belief["ahat_L_F"], GENTLE[0], GENTLE[1], w[0], w[1], w[2], out)


def _remembers(_settings: Any, _size: int) -> int:
    return MEMORY


SETTINGS = ("a_max", "dt", "meander_reach", "meander_segment", "meander_window")
LAWS = (
    Law(
        name="follow-optimal",
        summary="follow, meandering along paths that are optimal for the range",
        source="tracking paper (20)-(27)",
        needs=NEEDS,
        settings=(*SETTINGS, "meander_weight", "sigma_image"),
        decide=partial(meander, False),
        memory=_remembers,
    ),
    Law(
        name="follow-scheduled",
        summary="the same, as much as the range's uncertainty asks for",
        source="tracking paper, section 4: K_y scheduled on the range variance",
        needs=(*NEEDS, "sd_log_range"),
        settings=(*SETTINGS, "meander_weight", "sigma_image"),
        decide=partial(meander, True),
        memory=_remembers,
    ),
    Law(
        name="follow-sine",
        summary="follow, on a sine about the offset",
        source="baseline to the tracking paper's section 4",
        needs=NEEDS,
        settings=SETTINGS,
        decide=weave,
        memory=_remembers,
    ),
)
