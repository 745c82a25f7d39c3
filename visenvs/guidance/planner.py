"""What a plan of extra pushes is expected to cost, with its exact gradient.

A plan adds da_j to the terminal law's command at steps k + j, j = 0..n-1, of a vehicle that sees a
stationary target. With zero residuals, no process noise and no image after step k + n, the part of
the expected cost that depends on the plan is (thesis (4.59))

    sum_j  1/2 calB_j |da_j|^2  -  1/2 calS_j tr(P_j^- - P_j),

P_j^- and P_j being the covariance before and after the image at step k + j + 1. The gradient is the
adjoint of the closed loop and of the filter. P = A P^- A' + K r K', with A = I - K g', is
stationary in an optimal gain K, so that with M the adjoint of P:

    adjoint of P^- = A' M A,    of g = -2 P M K,    of r = K' M K.

Typed once for D = 2 or 3 axes: the filter's state is the relative position, the own velocity is
known. Rows g are depth x Jacobian, g_i = c_i - h_i c_0 with c the camera's axes, which keeps r
constant where the noise is that of a fixed size at the target. A gimbal that follows the estimate
only turns the rows about the line of sight and has h = 0, so that the gradient for a held attitude
is also its own. In a plane the camera is fixed.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from visenvs.core.compile import kernel
from visenvs.core.frames import camera_towards, identity
from visenvs.guidance.lq import gains, terminal_weight

GIMBAL = 1  # code of `camera="gimbal"` in a configuration's record; 0 is "fixed"
PLANE, SPACE = (0.0, 0.0), (0.0, 0.0, 0.0)  # the `axes` of a task in two and in three dimensions

BLIND = 0.03  # share of the least range below which no image counts
MEMORY = 8  # pairs that the search for the best plan keeps


class Tape(NamedTuple):
    """Everything that one plan of n steps along D axes needs, allocated once.

    Attributes:
        table: per step K_X, K_V, calS, calB, (n, 4).
        states: position, own velocity, and 1 where there is an image, (n + 1, 2 D + 1).
        P: covariance before each scalar of each image, (n + 1, D - 1, D, D).
        G, K: rows g and their gains, (n, D - 1, D).
        axis: the camera's optical axis at each image, (n, D).
        C: camera attitude, (D, D).
        M, L: adjoints of P, (D, D), and of the state with scratch behind, (3 D,).
        pairs: L-BFGS steps, then gradient changes, (2 MEMORY, n D).
        work: scratch of the search, (4, n D); dots: its inner products, (2, MEMORY).
    """

    table: Any
    states: Any
    P: Any
    G: Any
    K: Any
    axis: Any
    C: Any
    M: Any
    L: Any
    pairs: Any
    work: Any
    dots: Any


@kernel
def make_tape(n, D):
    """A Tape for n steps along D axes."""
    return Tape(
        np.zeros((n, 4)),
        np.zeros((n + 1, 2 * D + 1)),
        np.zeros((n + 1, D - 1, D, D)),
        np.zeros((n, D - 1, D)),
        np.zeros((n, D - 1, D)),
        np.zeros((n, D)),
        np.zeros((D, D)),
        np.zeros((D, D)),
        np.zeros(3 * D),
        np.zeros((2 * MEMORY, n * D)),
        np.zeros((4, n * D)),
        np.zeros((2, MEMORY)),
    )


@kernel
def prices(T, dt, s_x, s_v):
    """calS (1/s^3) and calB (s) of one axis for a step that ends with time to go T (4.30), (4.31).

    calS is what a unit of position variance goes on to cost if no later image removes it; calB is
    the price of a unit of squared push during the step.
    """
    m11, m12, m22 = terminal_weight(T, s_x, s_v)
    reach = dt * (0.5 * dt + T)
    return s_x - m11, m11 * reach * reach + 2.0 * m12 * reach * dt + m22 * dt * dt + dt


@kernel
def covariance(factor, P):
    """Write P = L L' (D, D) from the packed lower Cholesky factor L of the observation row."""
    for i in range(P.shape[0]):
        for j in range(i + 1):
            total = 0.0
            for k in range(j + 1):
                total += factor[i * (i + 1) // 2 + k] * factor[j * (j + 1) // 2 + k]
            P[i, j] = P[j, i] = total


@kernel
def begin(X, V, factor, T, settings, n, tape):
    """Enter a belief at time to go T, and the gains and prices of n steps from there.

    Args:
        X, V: estimated relative position (m) and own velocity (m/s), (D,).
        factor: packed lower Cholesky factor of the covariance of X, m.
        T: s. settings: record with dt, s_x, s_v.
    """
    D = X.shape[0]
    covariance(factor, tape.P[0, 0])
    for i in range(D):
        tape.states[0, i], tape.states[0, D + i] = X[i], V[i]
    for j in range(n):
        left = max(T - j * settings["dt"], settings["dt"])
        after = max(left - settings["dt"], 0.0)
        tape.table[j, 0], tape.table[j, 1] = gains(left, settings["s_x"], settings["s_v"])
        tape.table[j, 2], tape.table[j, 3] = prices(
            after, settings["dt"], settings["s_x"], settings["s_v"]
        )


@kernel
def cost(axes, plan, settings, tape):
    """Predicted cost of a plan, m^2/s^3, leaving on the tape what `gradient` needs.

    Args:
        axes: a tuple of D numbers; its length fixes D when this is compiled.
        plan: (n, D), m/s^2.
        settings: record with dt, camera, min_range, sigma_range, sigma_angle.
        tape: after `begin`.
    """
    D, dt, total = len(axes), settings["dt"], 0.0
    for j in range(plan.shape[0]):
        now, new, C = tape.states[j], tape.states[j + 1], tape.C
        for i in range(D):
            a = tape.table[j, 0] * now[i] - tape.table[j, 1] * now[D + i] + plan[j, i]
            total += 0.5 * tape.table[j, 3] * plan[j, i] * plan[j, i]
            new[i] = now[i] - dt * (now[D + i] + 0.5 * dt * a)
            new[D + i] = now[D + i] + dt * a
        depth = point(axes, settings, new, C, tape.axis[j])
        new[2 * D] = 1.0 if depth > BLIND * settings["min_range"] else 0.0
        for m in range(D - 1):
            before = tape.P[j, m]
            after = tape.P[j, m + 1] if m + 2 < D else tape.P[j + 1, 0]
            if new[2 * D] > 0.0:
                h = 0.0
                for i in range(D):
                    h += C[m + 1, i] * new[i]
                for i in range(D):
                    tape.G[j, m, i] = C[m + 1, i] - h / depth * C[0, i]
                r = row_variance(depth, settings)[0]
                lost = take(before, after, tape.G[j, m], r, tape.K[j, m], D)
                total -= 0.5 * tape.table[j, 2] * lost
            else:
                for i in range(D):
                    for k in range(D):
                        after[i, k] = before[i, k]
    return total


@kernel
def point(axes, settings, new, C, axis):
    """Turn the camera for an image of `new`: writes its attitude and axis; returns the depth, m."""
    D = len(axes)
    if D == 3 and settings["camera"] == GIMBAL:
        camera_towards(new, C)
    else:
        identity(C)
    depth = 0.0
    for i in range(D):
        depth += C[0, i] * new[i]
        axis[i] = C[0, i]
    return depth


@kernel
def row_variance(depth, settings):
    """Noise variance of a row g, m^2, and its derivative with depth, m.

    The sensor has a least range. Here the noise grows as depth^-4 below it instead of the image
    breaking off: a cost with jumps cannot be descended.
    """
    fade = (settings["min_range"] / depth) ** 4
    angle = settings["sigma_angle"] ** 2
    r = settings["sigma_range"] ** 2 + angle * depth * depth
    return r * (1.0 + fade), 2.0 * angle * depth * (1.0 + fade) - 4.0 * r * fade / depth


@kernel
def take(before, after, g, r, gain, D):
    """Write the covariance after one scalar of an image, and its gain; returns the trace's loss."""
    S, lost = r, 0.0
    for i in range(D):
        gain[i] = 0.0
        for k in range(D):
            gain[i] += before[i, k] * g[k]
        S += gain[i] * g[i]
    for i in range(D):
        lost += gain[i] * gain[i]
        for k in range(D):
            after[i, k] = before[i, k] - gain[i] * gain[k] / S
    for i in range(D):
        gain[i] /= S
    return lost / S


@kernel
def gradient(axes, plan, settings, tape, out):
    """Write the gradient of the predicted cost, (n, D), from the tape of `cost` for this plan."""
    D, n, dt, M, L = len(axes), plan.shape[0], settings["dt"], tape.M, tape.L
    for i in range(D):
        L[i] = L[D + i] = 0.0
        for k in range(D):
            M[i, k] = 0.0
    for j in range(n - 1, -1, -1):
        half = 0.5 * tape.table[j, 2]
        for i in range(D):
            M[i, i] += half
        if tape.states[j + 1, 2 * D] > 0.0:
            untake(axes, settings, tape, j)
        for i in range(D):
            M[i, i] -= half
        for i in range(D):
            pull = dt * L[D + i] - 0.5 * dt * dt * L[i]  # adjoint of the command
            out[j, i] = pull + tape.table[j, 3] * plan[j, i]
            L[D + i] -= dt * L[i] + tape.table[j, 1] * pull
            L[i] += tape.table[j, 0] * pull


@kernel
def untake(axes, settings, tape, j):
    """Carry the adjoints back through the image that follows step j."""
    D, M, L, new, c = len(axes), tape.M, tape.L, tape.states[j + 1], tape.axis[j]
    depth = 0.0
    for i in range(D):
        depth += c[i] * new[i]
    for m in range(D - 2, -1, -1):
        after = tape.P[j, m + 1] if m + 2 < D else tape.P[j + 1, 0]
        g, gain = tape.G[j, m], tape.K[j, m]
        noise, along = 0.0, 0.0
        for i in range(D):
            v = 0.0
            for k in range(D):
                v += M[i, k] * gain[k]
            L[2 * D + i] = v
            noise += v * gain[i]
        for i in range(D):
            v = 0.0
            for k in range(D):
                v += after[i, k] * L[2 * D + k]
            along -= 2.0 * v * c[i]
        slope = noise * row_variance(depth, settings)[1]
        for i in range(D):
            L[i] += slope * c[i] - along / depth * g[i]
            for k in range(D):
                M[i, k] += noise * g[i] * g[k] - g[i] * L[2 * D + k] - L[2 * D + i] * g[k]
