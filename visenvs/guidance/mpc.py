"""Receding-horizon control with a potential around every obstacle (IISc 2.1, (2.1)-(2.6)).

At every step the law plans the accelerations of a horizon, flies the first, and starts the next
plan from the rest. The cost is 1/2 |a|^2 and the potential (2.5) along the way, and after it what
the terminal law to the waypoint still costs. Obstacles move on with their estimated velocities
(2.6). Speed is kept: as the time left follows from it, braking would seem to cost nothing.

The report leaves the weights open. Here the potential is enabled inside the safety sphere, begins
at zero there, and weighs a hundred times what the acceleration of a turn about the sphere costs.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from visenvs.core.compile import kernel
from visenvs.core.registry import Law
from visenvs.guidance import pn
from visenvs.guidance.avoidance import waypoint
from visenvs.guidance.collision_cone import dot
from visenvs.guidance.lq import terminal_weight

STEPS = 25  # of a plan
SHARE = 0.8  # of the time left to the waypoint that a plan covers at most
SOFT, WEIGHT = 0.1, 100.0  # epsilon of (2.5), and the potential's weight
ITERATIONS, HALVINGS = 20, 10
TOLERANCE = 1e-4  # share of the cost that a step promises to save when a plan is finished


@kernel
def potential(q):
    """(2.5) less its value on the sphere, and its slope, inside of the sphere.

    q: squared distance over squared radius, which is what G of (2.5) gives here.
    """
    if q >= 1.0:
        return 0.0, 0.0
    p = 1.0 / (q + SOFT)
    return p - 1.0 / (1.0 + SOFT), -p * p


@kernel
def weight(V, d):
    """Weight of the potential, m^2/s^4, from the speed V, m/s, and the radius d, m."""
    turn = dot(V, V) / d
    return 0.5 * WEIGHT * turn * turn


@kernel
def cost(plan, b, s, h, rest, path):
    """What a plan (STEPS, 3), m/s^2, costs, m^2/s^3, leaving its path for `gradient`.

    Args:
        b, s: belief and settings.
        h, rest: time of a step and time left to the waypoint after the plan, s.
        path: position relative to here (m) and velocity (m/s) after each step, (STEPS + 1, 6).
    """
    total = 0.0
    for i in range(3):
        path[0, i], path[0, 3 + i] = 0.0, b["v_V_N"][i]
    for k in range(plan.shape[0]):
        for i in range(3):
            a = plan[k, i]
            path[k + 1, i] = path[k, i] + h * (path[k, 3 + i] + 0.5 * h * a)
            path[k + 1, 3 + i] = path[k, 3 + i] + h * a
            total += 0.5 * h * a * a
        for j in range(b["valid_O"].shape[0]):
            if b["valid_O"][j] > 0.5:
                d, q = b["radius_O"][j], nearness(b, j, (k + 1) * h, path[k + 1])
                total += h * weight(b["v_V_N"], d) * potential(q)[0]
    m11, end = terminal_weight(rest, s["s_x"], 0.0)[0], path[plan.shape[0]]
    for i in range(3):
        miss = b["rhat_WV_N"][i] - end[i] - rest * end[3 + i]
        total += 0.5 * m11 * miss * miss
    return total


@kernel
def nearness(b, j, t, at):
    """Squared distance from obstacle j after t s, over its squared radius."""
    square = 0.0
    for i in range(3):
        gap = at[i] - b["rhat_OV_N"][3 * j + i] - t * b["vhat_O_N"][3 * j + i]
        square += gap * gap
    return square / b["radius_O"][j] ** 2


@kernel
def gradient(plan, b, s, h, rest, path, adjoint, out):
    """Write the gradient of `cost` (STEPS, 3), m/s, from its path. adjoint: scratch (6,)."""
    n, L = plan.shape[0], adjoint
    m11, end = terminal_weight(rest, s["s_x"], 0.0)[0], path[n]
    for i in range(3):
        L[i] = -m11 * (b["rhat_WV_N"][i] - end[i] - rest * end[3 + i])
        L[3 + i] = rest * L[i]
    for k in range(n - 1, -1, -1):
        for j in range(b["valid_O"].shape[0]):
            if b["valid_O"][j] > 0.5:
                d, t = b["radius_O"][j], (k + 1) * h
                slope = potential(nearness(b, j, t, path[k + 1]))[1]
                push = 2.0 * h * weight(b["v_V_N"], d) * slope / (d * d)
                for i in range(3):
                    place = b["rhat_OV_N"][3 * j + i] + t * b["vhat_O_N"][3 * j + i]
                    L[i] += push * (path[k + 1, i] - place)
        for i in range(3):
            out[k, i] = h * plan[k, i] + 0.5 * h * h * L[i] + h * L[3 + i]
            L[3 + i] += h * L[i]


@kernel
def forward(b, s, f):
    """Write the axis (3,) along which nothing is commanded: north, or the velocity's direction."""
    V = b["v_V_N"]
    speed = math.sqrt(dot(V, V))
    for i in range(3):
        f[i] = V[i] / speed if speed > 0.0 else 0.0
    if s["lateral"] != 0:
        f[0], f[1], f[2] = 1.0, 0.0, 0.0


@kernel
def allow(a, s, f):
    """Take from a command (3,) what is along the axis f, and shorten it to the longest one."""
    along = dot(a, f)
    for i in range(3):
        a[i] -= along * f[i]
    size = math.sqrt(dot(a, a))
    if size > s["a_max"]:
        for i in range(3):
            a[i] *= s["a_max"] / size


@kernel
def improve(plan, b, s, h, rest, path, adjoint, work):
    """Improve a plan in place by spectral projected gradients (Birgin, Martinez and Raydan 2000).

    work: (5, STEPS, 3), gradient, direction, trial, the trial's gradient, and the forward axis.
    """
    g, d, trial, new, f = work[0], work[1], work[2], work[3], work[4, 0]
    forward(b, s, f)
    for k in range(plan.shape[0]):
        allow(plan[k], s, f)
    value, stride = cost(plan, b, s, h, rest, path), 1.0 / h
    gradient(plan, b, s, h, rest, path, adjoint, g)
    for _ in range(ITERATIONS):
        slope = 0.0
        for k in range(plan.shape[0]):
            for i in range(3):
                d[k, i] = plan[k, i] - stride * g[k, i]
            allow(d[k], s, f)
            for i in range(3):
                d[k, i] -= plan[k, i]
                slope += d[k, i] * g[k, i]
        if -slope <= TOLERANCE * value:
            return
        step, found = 1.0, math.inf
        for _ in range(HALVINGS):
            for k in range(plan.shape[0]):
                for i in range(3):
                    trial[k, i] = plan[k, i] + step * d[k, i]
            found = cost(trial, b, s, h, rest, path)
            if found <= value + 1e-4 * step * slope:
                break
            step *= 0.5
        if found > value:
            return
        gradient(trial, b, s, h, rest, path, adjoint, new)
        value, stride = found, stretch(plan, trial, g, new, h)


@kernel
def stretch(plan, trial, g, new, h):
    """Move to the trial and its gradient; returns the next stride (Barzilai and Borwein), 1/s."""
    ss, sy = 0.0, 0.0
    for k in range(plan.shape[0]):
        for i in range(3):
            s = trial[k, i] - plan[k, i]
            ss += s * s
            sy += s * (new[k, i] - g[k, i])
            plan[k, i], g[k, i] = trial[k, i], new[k, i]
    return min(max(ss / sy, 1e-3 / h), 1.0 / h) if sy > 0.0 else 1.0 / h


@kernel
def decide(beliefs, settings, memory, commands):
    """The law for a batch of beliefs; a row's memory is its plan."""
    path, adjoint, work = np.zeros((STEPS + 1, 6)), np.zeros(6), np.zeros((5, STEPS, 3))
    s, point = settings[0], np.zeros(3)
    for i in range(beliefs.shape[0]):
        b, plan, a = beliefs[i], memory[i].reshape(STEPS, 3), commands[i]
        T = waypoint(b, s, point)
        span = min(s["t_critical"], SHARE * T)
        h = span / STEPS
        if h * STEPS <= 2.0 * s["dt"]:
            pn.command(point, b["v_V_N"], T, a)
        else:
            improve(plan, b, s, h, T - span, path, adjoint, work)
            onward = min(s["dt"] / h, 1.0)
            for j in range(3):
                a[j] = plan[0, j]
                for k in range(STEPS - 1):
                    plan[k, j] += onward * (plan[k + 1, j] - plan[k, j])
        if s["lateral"] != 0:
            a[0] = 0.0


def plan_size(settings: Any, D: int) -> int:
    """Numbers in a plan."""
    return STEPS * D


LAWS = (
    Law(
        name="mpc",
        summary="receding horizon with a potential around every obstacle",
        source="IISc (2.1)-(2.6), weights chosen here",
        needs=(
            "rhat_WV_N",
            "v_V_N",
            "t_go",
            "rhat_OV_N",
            "vhat_O_N",
            "radius_O",
            "valid_O",
        ),
        settings=("dt", "lateral", "a_max", "t_critical", "s_x"),
        decide=decide,
        memory=plan_size,
    ),
)
