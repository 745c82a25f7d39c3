"""One-step-ahead (OSA) guidance: the terminal law plus a push that makes the next image tell more.

Thesis 4.2.1-4.2.3: the push maximises the expected decrease in cost that one more image brings,
linearised at the estimate that the terminal law alone would reach (4.35).
"""

from __future__ import annotations

import numpy as np

from visenvs.core.compile import kernel
from visenvs.core.frames import camera_towards, identity, rotate
from visenvs.core.pinhole import jacobian, pixel_variance, project
from visenvs.core.registry import Law
from visenvs.guidance import lq

SCRATCH = np.dtype(
    [("P", "f8", (3, 3)), ("C", "f8", (3, 3)), ("H", "f8", (2, 3)), ("N", "f8", (3, 2)), ("x", "f8", (3,)), ("g", "f8", (3,))]
)


@kernel
def information_gradient(x, P, C, nearest, sigma_range, sigma_angle, scratch, gradient):
    """Value and gradient of f(x) = tr H' (H P H' + R)^-1 H P P, dimensionless, at a predicted position.

    With G = X H = [-h I] C_CN and rho = X^2 R, f = tr (G P G' + rho I)^-1 G P P G'. The depth cancels,
    so that only h and rho vary: dG = -dh c', where c is the optical axis.

    Args:
        x: predicted relative position in N, m, (3,), deeper than `nearest` (m).
        P: predicted covariance, m^2, (3, 3).
        C: camera attitude C_CN, (3, 3), held fixed.
        gradient: receives df/dx, 1/m, (3,).
    """
    H, N = scratch["H"], scratch["N"]
    X, y, z = project(C, x, nearest)
    jacobian(C, X, y, z, H)
    rho = X * X * pixel_variance(X, sigma_range, sigma_angle)
    for a in range(3):
        for i in range(2):
            N[a, i] = X * (P[a, 0] * H[i, 0] + P[a, 1] * H[i, 1] + P[a, 2] * H[i, 2])
    s00, s01, s11 = rho, 0.0, rho
    w00, w01, w11 = 0.0, 0.0, 0.0
    for a in range(3):
        s00 += X * H[0, a] * N[a, 0]
        s01 += X * H[0, a] * N[a, 1]
        s11 += X * H[1, a] * N[a, 1]
        w00 += N[a, 0] * N[a, 0]
        w01 += N[a, 0] * N[a, 1]
        w11 += N[a, 1] * N[a, 1]
    det = s00 * s11 - s01 * s01
    i00, i01, i11 = s11 / det, -s01 / det, s00 / det  # S^-1
    v00, v01 = i00 * w00 + i01 * w01, i00 * w01 + i01 * w11  # S^-1 W
    v10, v11 = i01 * w00 + i11 * w01, i01 * w01 + i11 * w11
    z00, z01, z11 = v00 * i00 + v01 * i01, v00 * i01 + v01 * i11, v10 * i01 + v11 * i11  # S^-1 W S^-1
    along0, along1 = 0.0, 0.0  # c' (P N S^-1 - N Z), how f falls with h
    for a in range(3):
        pc = P[a, 0] * C[0, 0] + P[a, 1] * C[0, 1] + P[a, 2] * C[0, 2]
        along0 += pc * (N[a, 0] * i00 + N[a, 1] * i01) - C[0, a] * (N[a, 0] * z00 + N[a, 1] * z01)
        along1 += pc * (N[a, 0] * i01 + N[a, 1] * i11) - C[0, a] * (N[a, 0] * z01 + N[a, 1] * z11)
    slope = 2.0 * sigma_angle * sigma_angle * X * (z00 + z11)  # of f with depth, through rho
    for a in range(3):
        gradient[a] = -2.0 * (along0 * H[0, a] + along1 * H[1, a]) - slope * C[0, a]
    return v00 + v11


@kernel
def push(X, V, P, C, T, settings, scratch, a):
    """Add the OSA push to the terminal law's acceleration `a` (3,), m/s^2 (4.35) with its H^T restored.

    Args:
        X, V, P: estimated relative position (m), own velocity (m/s), covariance (m^2).
        C: camera attitude at the next image, C_CN.
        T: time to go, s.
        settings: record with dt, s_x, s_v, sigma_range, sigma_angle.
    """
    dt = settings["dt"]
    after = max(T - dt, 0.0)
    m11, m12, m22 = lq.terminal_weight(after, settings["s_x"], settings["s_v"])
    value = settings["s_x"] - m11  # position block of calS (4.30), 1/s^3
    reach = dt * (0.5 * dt + after)
    price = m11 * reach * reach + 2.0 * m12 * reach * dt + m22 * dt * dt + dt  # calB (4.31), s
    x, gradient = scratch["x"], scratch["g"]
    for i in range(3):
        x[i] = X[i] - dt * (V[i] + 0.5 * dt * a[i])
    nearest = settings["min_range"]
    if not rotate(C, x)[0] > nearest:
        return  # no image to be had there
    information_gradient(x, P, C, nearest, settings["sigma_range"], settings["sigma_angle"], scratch, gradient)
    for i in range(3):
        a[i] -= 0.25 * dt * dt * value / price * gradient[i]


@kernel
def covariance(factor, P):
    """Write P = L L' from the packed lower Cholesky factor L (6,) of the row."""
    for i in range(3):
        for j in range(i + 1):
            total = 0.0
            for k in range(j + 1):
                total += factor[i * (i + 1) // 2 + k] * factor[j * (j + 1) // 2 + k]
            P[i, j] = total
            P[j, i] = total


@kernel
def decide(beliefs, settings, commands):
    """The law for a batch of beliefs."""
    work = np.zeros(1, SCRATCH)[0]
    s = settings[0]
    for i in range(beliefs.shape[0]):
        b = beliefs[i]
        X, V, T = b["rhat_TV_N"], b["v_V_N"], max(b["t_go"], s["dt"])
        lq.command(X, V, T, s["s_x"], s["s_v"], commands[i])
        covariance(b["chol"], work["P"])
        if s["camera"] == 1:
            camera_towards(X, work["C"])
        else:
            identity(work["C"])
        push(X, V, work["P"], work["C"], T, s, work, commands[i])


LAWS = (
    Law(
        name="osa",
        summary="terminal guidance plus the push that makes the next image tell more (one step ahead)",
        source="thesis (4.35) with its H^T, exact gradient",
        needs=("rhat_TV_N", "chol", "v_V_N", "t_go"),
        settings=("dt", "s_x", "s_v", "camera", "min_range", "sigma_range", "sigma_angle"),
        decide=decide,
    ),
)
