"""Differential dynamic programming for a point mass: the plan of accelerations to a pose (IARC IV).

State: position (m) and velocity (m/s) in N, (6,); control: acceleration (m/s^2), (3,), held for a
step. Over n steps the plan minimises

    sum_k dt (1/2 |x_k - x*|^2_Q + 1/2 r |u_k|^2 + p(x_k, u_k)) + 1/2 |x_n - x*|^2_S + dt p(x_n, 0),

which is (34) with a final cost and the exterior quadratic penalty p of the limits on speed,
acceleration and depth (EQPF), each rho max(0, excess)^2 with its exact second derivatives.

The paper's recursion as derived: V at t_k comes from Q at t_k (36)-(42), where (41) ends in Q_ux
and takes Q_u rather than Q_x in front; (43), (44) have minus signs, without which the iteration
runs away. The dynamics are linear, so that the tensors in (38)-(40) are zero, and all matrices are
of 3 x 3 blocks: V = [P S; S' W], f_x = [1 dt; 0 1], f_u = [dt^2 / 2; dt].
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from visenvs.core.compile import kernel
from visenvs.core.config import require, validate

SHARE_V, SHARE_A = 0.98, 0.99  # of the limits that a plan may use, since it goes a little beyond
LEAST_RATE = 1e-3  # learning rate below which no improvement is to be had


@dataclass(frozen=True)
class DDPConfig:
    """Weights and limits of a plan; `to_record` makes the record that the kernels read."""

    dt: float = 0.05  # step, s
    rate: float = 0.8  # learning rate gamma (46)
    iterations: int = 40  # trajectories that are evaluated, N
    tolerance: float = 1e-4  # relative saving below which no further one is; 0 for never
    q_r: float = 0.0  # weight of the position on the way, 1/s^4, and
    q_v: float = 0.0  # of the velocity, 1/s^2
    r_a: float = 1.0  # weight of the acceleration
    s_r: float = 2000.0  # weight of the position at the end, 1/s^3, and
    s_v: float = 200.0  # of the velocity, 1/s
    rho: float = 200.0  # weight of the penalty
    v_max: float = SHARE_V * 2.13  # m/s; the limits in section V, less
    a_max: float = SHARE_A * 3.05  # m/s^2: what the penalty lets through
    deepest: float = 0.1  # largest down coordinate, m: under the floor, where landings aim

    def __post_init__(self) -> None:
        validate(self)
        require(
            self,
            dt=self.dt > 0,
            rate=0 < self.rate <= 1,
            iterations=self.iterations >= 1,
            tolerance=self.tolerance >= 0,
            q_r=self.q_r >= 0,
            q_v=self.q_v >= 0,
            r_a=self.r_a > 0,
            s_r=self.s_r >= 0,
            s_v=self.s_v >= 0,
            rho=self.rho >= 0,
            v_max=self.v_max > 0,
            a_max=self.a_max > 0,
        )


class Tape(NamedTuple):
    """Everything that plans of up to n steps need, allocated once.

    Attributes:
        u: the plan, (n, 3), m/s^2: the first guess before, the best found after.
        x: its states, (n + 1, 6).
        u_try, x_try: the trajectory of the iteration at hand, the same shapes.
        k, K: feedforward (n, 3) and feedback (n, 3, 6) of the policy (43), (44).
        V, V_x: second and first derivatives of the cost to go, (6, 6), (6,).
        Q_u, Q_uu, Q_ux, BV: scratch, (3,), (3, 3), (3, 6), (3, 6).
    """

    u: Any
    x: Any
    u_try: Any
    x_try: Any
    k: Any
    K: Any
    V: Any
    V_x: Any
    Q_u: Any
    Q_uu: Any
    Q_ux: Any
    BV: Any


def make_tape(n: int) -> Tape:
    """A Tape for plans of at most n steps."""
    if n < 1:
        raise ValueError(f"n={n}: a plan has at least one step; write `make_tape(60)`")
    shapes = ((n, 3), (n + 1, 6), (n, 3), (n + 1, 6), (n, 3), (n, 3, 6))
    scratch = ((6, 6), (6,), (3,), (3, 3), (3, 6), (3, 6))
    return Tape(*(np.zeros(shape) for shape in (*shapes, *scratch)))


@kernel
def excess(w, first, limit):
    """By how much w[first : first + 3] is longer than a limit, and its length."""
    length = math.sqrt(w[first] ** 2 + w[first + 1] ** 2 + w[first + 2] ** 2)
    return max(length - limit, 0.0), length


@kernel
def penalty(x, u, cfg):
    """rho times the squared excesses of speed, acceleration and depth."""
    speed, push = excess(x, 3, cfg["v_max"])[0], excess(u, 0, cfg["a_max"])[0]
    depth = max(x[2] - cfg["deepest"], 0.0)
    return cfg["rho"] * (speed * speed + push * push + depth * depth)


@kernel
def quadratic(x, aim, w_r, w_v):
    """1/2 |x - aim|^2 with a weight for the position and one for the velocity."""
    total = 0.0
    for i in range(3):
        total += 0.5 * w_r * (x[i] - aim[i]) ** 2 + 0.5 * w_v * (x[3 + i] - aim[3 + i]) ** 2
    return total


@kernel
def stage(x, u, aim, cfg):
    """Cost of one step (34), its penalty included."""
    push = 0.5 * cfg["r_a"] * (u[0] * u[0] + u[1] * u[1] + u[2] * u[2])
    return cfg["dt"] * (quadratic(x, aim, cfg["q_r"], cfg["q_v"]) + push + penalty(x, u, cfg))


@kernel
def fly(x, u, y, dt):
    """Write the state after one step of an acceleration: y (6,); exact."""
    for i in range(3):
        y[i] = x[i] + dt * (x[3 + i] + 0.5 * dt * u[i])
        y[3 + i] = x[3 + i] + dt * u[i]


@kernel
def add_excess(value, length, w, first, weight, gradient, hessian):
    """Add the derivatives of weight excess^2 of w[first : first + 3] at [first...] of both."""
    if value <= 0.0:
        return
    bend = value / length
    for i in range(3):
        gradient[first + i] += 2.0 * weight * bend * w[first + i]
        for j in range(3):
            along = w[first + i] * w[first + j] / (length * length)
            hessian[first + i, first + j] += 2.0 * weight * along * (1.0 - bend)
        hessian[first + i, first + i] += 2.0 * weight * bend


@kernel
def add_state_cost(x, aim, w_r, w_v, weight, cfg, V_x, V):
    """Add the derivatives by x of `quadratic`, and of the penalty times weight / rho, to V_x, V."""
    for i in range(3):
        V_x[i] += w_r * (x[i] - aim[i])
        V_x[3 + i] += w_v * (x[3 + i] - aim[3 + i])
        V[i, i] += w_r
        V[3 + i, 3 + i] += w_v
    value, length = excess(x, 3, cfg["v_max"])
    add_excess(value, length, x, 3, weight, V_x, V)
    depth = x[2] - cfg["deepest"]
    if depth > 0.0:
        V_x[2] += 2.0 * weight * depth
        V[2, 2] += 2.0 * weight


@kernel
def backward(aim, n, cfg, tape):
    """Write the policy k, K of every step about the plan tape.u, tape.x, (36)-(44)."""
    V, V_x, dt = tape.V, tape.V_x, cfg["dt"]
    V[:] = 0.0
    V_x[:] = 0.0
    add_state_cost(tape.x[n], aim, cfg["s_r"], cfg["s_v"], dt * cfg["rho"], cfg, V_x, V)
    for step in range(n - 1, -1, -1):
        expand_control(tape.u[step], cfg, tape)
        policy(tape, tape.k[step], tape.K[step])
        for i in range(6):
            for j in range(3):
                V[i, 3 + j] += dt * V[i, j]
        for i in range(3):
            V_x[3 + i] += dt * V_x[i]
            for j in range(6):
                V[3 + i, j] += dt * V[i, j]
        q_r, q_v = dt * cfg["q_r"], dt * cfg["q_v"]
        add_state_cost(tape.x[step], aim, q_r, q_v, dt * cfg["rho"], cfg, V_x, V)
        for i in range(6):
            for m in range(3):
                V_x[i] += tape.Q_ux[m, i] * tape.k[step, m]
            for j in range(i + 1):
                total = V[i, j]
                for m in range(3):
                    total += tape.Q_ux[m, i] * tape.K[step, m, j]
                V[i, j] = V[j, i] = total


@kernel
def expand_control(u, cfg, tape):
    """Write Q_u (37), Q_ux (39) and Q_uu (40) from V and V_x after the step."""
    V, V_x, BV, dt = tape.V, tape.V_x, tape.BV, cfg["dt"]
    half = 0.5 * dt * dt
    for i in range(3):
        for j in range(6):
            BV[i, j] = half * V[i, j] + dt * V[3 + i, j]
        for j in range(3):
            tape.Q_ux[i, j] = BV[i, j]
            tape.Q_ux[i, 3 + j] = dt * BV[i, j] + BV[i, 3 + j]
            tape.Q_uu[i, j] = half * BV[i, j] + dt * BV[i, 3 + j]
        tape.Q_uu[i, i] += dt * cfg["r_a"]
        tape.Q_u[i] = dt * cfg["r_a"] * u[i] + half * V_x[i] + dt * V_x[3 + i]
    value, length = excess(u, 0, cfg["a_max"])
    add_excess(value, length, u, 0, dt * cfg["rho"], tape.Q_u, tape.Q_uu)


@kernel
def policy(tape, k, K):
    """Write k = -Q_uu^-1 Q_u (44) and K = -Q_uu^-1 Q_ux (43), by the adjugate."""
    A = tape.Q_uu
    a = A[1, 1] * A[2, 2] - A[1, 2] * A[1, 2]
    b = A[0, 2] * A[1, 2] - A[0, 1] * A[2, 2]
    c = A[0, 1] * A[1, 2] - A[0, 2] * A[1, 1]
    d = A[0, 0] * A[2, 2] - A[0, 2] * A[0, 2]
    e = A[0, 1] * A[0, 2] - A[0, 0] * A[1, 2]
    f = A[0, 0] * A[1, 1] - A[0, 1] * A[0, 1]
    scale = -1.0 / (A[0, 0] * a + A[0, 1] * b + A[0, 2] * c)
    p, q, r = tape.Q_u[0], tape.Q_u[1], tape.Q_u[2]
    k[0] = scale * (a * p + b * q + c * r)
    k[1] = scale * (b * p + d * q + e * r)
    k[2] = scale * (c * p + e * q + f * r)
    for j in range(6):
        p, q, r = tape.Q_ux[0, j], tape.Q_ux[1, j], tape.Q_ux[2, j]
        K[0, j] = scale * (a * p + b * q + c * r)
        K[1, j] = scale * (b * p + d * q + e * r)
        K[2, j] = scale * (c * p + e * q + f * r)


@kernel
def forward(aim, n, rate, cfg, tape):
    """Fly the plan changed by `rate` times the policy (45), (46); returns what it costs."""
    x, y, total = tape.x, tape.x_try, 0.0
    for i in range(6):
        y[0, i] = x[0, i]
    for step in range(n):
        u = tape.u_try[step]
        for i in range(3):
            change = tape.k[step, i]
            for j in range(6):
                change += tape.K[step, i, j] * (y[step, j] - x[step, j])
            u[i] = tape.u[step, i] + rate * change
        total += stage(y[step], u, aim, cfg)
        fly(y[step], u, y[step + 1], cfg["dt"])
    return total + final(y[n], aim, cfg)


@kernel
def final(x, aim, cfg):
    """Cost of the last state."""
    over = excess(x, 3, cfg["v_max"])[0] ** 2 + max(x[2] - cfg["deepest"], 0.0) ** 2
    return quadratic(x, aim, cfg["s_r"], cfg["s_v"]) + cfg["dt"] * cfg["rho"] * over


@kernel
def improve(x0, aim, n, cfg, tape):
    """Improve the plan tape.u from state x0 (6,) towards x* (6,), in place; returns its cost.

    It keeps the best of at most cfg["iterations"] trajectories. A step that makes the plan dearer
    is taken again at half the rate: the penalty bends where a limit begins.
    """
    for i in range(6):
        tape.x[0, i] = x0[i]
    tape.k[:n] = 0.0
    tape.K[:n] = 0.0
    best = forward(aim, n, 0.0, cfg, tape)
    keep(n, tape)
    rate = cfg["rate"]
    for _ in range(cfg["iterations"] - 1):
        if rate == cfg["rate"]:
            backward(aim, n, cfg, tape)
        cost = forward(aim, n, rate, cfg, tape)
        if not cost < best:
            rate *= 0.5
            if rate < LEAST_RATE:
                break
            continue
        saved, best, rate = best - cost, cost, cfg["rate"]
        keep(n, tape)
        if saved <= cfg["tolerance"] * best:
            break
    return best


@kernel
def keep(n, tape):
    """Take the trajectory at hand for the plan."""
    for step in range(n):
        for i in range(3):
            tape.u[step, i] = tape.u_try[step, i]
    for step in range(n + 1):
        for i in range(6):
            tape.x[step, i] = tape.x_try[step, i]


@kernel
def shift(n, tape):
    """Turn the plan just made into the first guess of the next: one step on, the last one twice."""
    for step in range(n - 1):
        for i in range(3):
            tape.u[step, i] = tape.u[step + 1, i]
