"""Where to fly so that bearings tell more: straight, across the bearing, D-optimal.

The target's position and velocity, x = (r_TV, v_T), are estimated from bearings alone, here in L,
the frame of the estimated line of sight: first axis along it, second to its right. Courses are
measured from that line, clockwise positive, and every law commands a turn rate, rad/s.

The D-optimal laws choose the course for which the next n bearings shrink the volume of the
covariance most: they maximise log det(I + L' J L), with P = L L' the covariance now and J the
Fisher information of those bearings about x (Oshman and Davidson 1999, "Optimization of observer
trajectories for bearings-only target localization").
"""

from __future__ import annotations

import math
import re
from functools import partial

import numpy as np

from visenvs.core.bearing import bearing_slope
from visenvs.core.compile import kernel
from visenvs.core.frames import wrap_angle
from visenvs.core.registry import Law

COURSES = 36  # that a D-optimal law compares, evenly spaced


@kernel
def turn_towards(v, course, settings):
    """Turn rate (rad/s) that brings velocity v to a course (rad) in one step, or the largest."""
    off = wrap_angle(course - math.atan2(v[1], v[0]))
    return min(max(off / settings["dt"], -settings["turn_max"]), settings["turn_max"])


@kernel
def log_det(A):
    """Logarithm of the determinant of a positive definite matrix, which it overwrites."""
    total = 0.0
    n = A.shape[0]
    for k in range(n):
        total += math.log(A[k, k])
        for i in range(k + 1, n):
            factor = A[i, k] / A[k, k]
            for j in range(k + 1, n):
                A[i, j] -= factor * A[k, j]
    return total


@kernel
def information_gain(belief, course, steps, settings, M):
    """log det of the covariance now minus that after `steps` bearings, flying to a course.

    The observer turns as fast as it can, then flies straight. Bearings are linearised at the
    estimated target, each counted with its chance of being taken.

    Args:
        belief: record with range_hat, vhat_T_L, chol_r, chol_v and v_V_L.
        course: rad.
        settings: record with dt, turn_max, sigma_bearing, p_detect and min_range.
        M: scratch, (4, 4).
    """
    u, a, b = belief["vhat_T_L"], belief["chol_r"], belief["chol_v"]
    v, dt = belief["v_V_L"], settings["dt"]
    weight = settings["p_detect"] / settings["sigma_bearing"] ** 2
    for i in range(4):
        for j in range(4):
            M[i, j] = 1.0 if i == j else 0.0
    ahead, right = belief["range_hat"], 0.0
    speed, heading = math.hypot(v[0], v[1]), math.atan2(v[1], v[0])
    left = wrap_angle(course - heading)
    for k in range(1, steps + 1):
        bend = min(max(left, -settings["turn_max"] * dt), settings["turn_max"] * dt)
        middle = heading + 0.5 * bend  # the chord's direction
        heading += bend
        left -= bend
        ahead += dt * (u[0] - speed * math.cos(middle))
        right += dt * (u[1] - speed * math.sin(middle))
        g, h = bearing_slope(ahead, right, settings["min_range"])
        t = k * dt
        # L' times the gradient (g, h, t g, t h) of the bearing by the state now
        p = a[0] * g + a[1] * h + t * (b[0] * g + b[3] * h)
        q = a[2] * h + t * (b[1] * g + b[4] * h)
        s, w = t * (b[2] * g + b[5] * h), t * b[6] * h
        M[0, 0] += weight * p * p
        M[1, 0] += weight * q * p
        M[1, 1] += weight * q * q
        M[2, 0] += weight * s * p
        M[2, 1] += weight * s * q
        M[2, 2] += weight * s * s
        M[3, 0] += weight * w * p
        M[3, 1] += weight * w * q
        M[3, 2] += weight * w * s
        M[3, 3] += weight * w * w
    for i in range(4):
        for j in range(i):
            M[j, i] = M[i, j]
    return log_det(M)


@kernel
def fly_straight(beliefs, settings, commands):
    """No turn."""
    for i in range(beliefs.shape[0]):
        commands[i, 0] = 0.0


@kernel
def fly_across(beliefs, settings, commands):
    """Turn to the nearer of the two courses across the estimated bearing."""
    for i in range(beliefs.shape[0]):
        v = beliefs[i]["v_V_L"]
        side = 0.5 * math.pi if v[1] >= 0.0 else -0.5 * math.pi
        commands[i, 0] = turn_towards(v, side, settings[0])


@kernel
def fly_d_optimal(horizon, beliefs, settings, commands):
    """Turn to the best of evenly spaced courses, the present one among them."""
    M, s = np.zeros((4, 4)), settings[0]
    for i in range(beliefs.shape[0]):
        v = beliefs[i]["v_V_L"]
        left = int(beliefs[i]["t_go"] / s["dt"] + 0.5)
        steps = max(min(horizon, left), 1)
        heading = math.atan2(v[1], v[0])
        most, best = -1.0, heading
        for k in range(COURSES):
            course = heading + 2.0 * math.pi * k / COURSES
            gain = information_gain(beliefs[i], course, steps, s, M)
            if gain > most:
                most, best = gain, course
        commands[i, 0] = turn_towards(v, best, s)


def d_optimal(name: str, summary: str, horizon: int) -> Law:
    """The card of a D-optimal law that looks `horizon` steps ahead."""
    return Law(
        name=name,
        summary=summary,
        source="Oshman and Davidson 1999; the one-step baseline of arXiv 2605.02120",
        needs=("range_hat", "vhat_T_L", "chol_r", "chol_v", "v_V_L", "t_go"),
        settings=("dt", "turn_max", "sigma_bearing", "p_detect", "min_range"),
        decide=partial(fly_d_optimal, horizon),
        limit="turn_max",
    )


def member(name: str) -> Law | None:
    """`d-optimal-N` that looks N >= 1 steps ahead; None for other names."""
    found = re.fullmatch(r"d-optimal-(\d{1,9})", name)
    if found is None:
        return None
    if (horizon := int(found[1])) < 1:
        raise ValueError(f"{name}: looks at least 1 step ahead; write d-optimal-1")
    return d_optimal(name, f"the course whose next {horizon} bearings tell most", horizon)


LAWS = (
    Law(
        name="straight",
        summary="no turn",
        source="baseline",
        needs=(),
        settings=("turn_max",),
        decide=fly_straight,
        limit="turn_max",
    ),
    Law(
        name="perpendicular",
        summary="turns to fly across the estimated bearing",
        source="the perpendicular-to-bearing baseline of arXiv 2605.02120",
        needs=("v_V_L",),
        settings=("dt", "turn_max"),
        decide=fly_across,
        limit="turn_max",
    ),
    d_optimal("d-optimal", "the course whose next bearing tells most", 1),
    d_optimal("d-optimal-10", "the course whose next 10 bearings tell most", 10),
)
