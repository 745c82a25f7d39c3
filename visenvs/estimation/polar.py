"""Filter of a leader in modified polar coordinates (thesis (2.20)-(2.33)).

State: u, the direction of the leader in N, and its rate; rho = 1/r; s = (dr/dt)/r; the wingspan b;
the leader's acceleration to the right of its course, a_lat. SI. With X the relative position and V
the leader's velocity, X = u / rho and V = (du/dt + u s) / rho + own velocity: thesis (2.30)-(2.31)
with 1/r in the denominators, where (dr/dt)/r is printed, and du/dt in the first term of (2.31).

Three filters share these equations. `ekf-natural` is the thesis's: errors of rho and b themselves.
`ekf-log` has the errors in ln rho and ln b. Only the product b rho is seen in steady formation; a
noisy linearisation moves the direction of b and rho in which nothing is known, while that of the
logarithms stands still. `ekf` also leaves b as it was told and keeps its uncertainty (a consider
parameter, Schmidt 1966). Without uncertainty in a_lat and no noise on it, a_lat stays 0: the model
without it. Constraints are enforced after the prediction too, because no integration keeps them.
"""

from __future__ import annotations

import math

import numpy as np

from visenvs.core.compile import kernel
from visenvs.estimation.ekf import predict_covariance, update_scalar
from visenvs.estimation.wings import first_look, tangents

U, DU, RHO, S, B, LAT, SIZE = 0, 3, 6, 7, 8, 9, 10  # places in the state

TRACK = np.dtype([("x", "f8", (SIZE,)), ("P", "f8", (SIZE, SIZE))])
SCRATCH = np.dtype([
    *((name, "f8", (SIZE,)) for name in ("middle", "f", "g", "xi", "work")),
    *((name, "f8", (SIZE, SIZE)) for name in ("F", "Phi", "Q", "M")),
    ("C", "f8", (3, 3)), ("H", "f8", (3, SIZE)), ("T", "f8", (6, SIZE)),
    ("v", "f8", (3,)), ("residual", "f8", (3,)), ("variance", "f8", (3,)),
])  # fmt: skip

LEAST_SPEED = 0.1  # of the leader, horizontal, m/s: slower than this it has no course
FARTHEST = 1e4  # m; rho and b stay positive


@kernel
def course_of(x, v):
    """Direction (north, east) of the leader's course and its horizontal speed, m/s, (2.31).

    Args:
        x: state.
        v: own velocity, m/s, (3,).
    """
    north = (x[DU] + x[U] * x[S]) / x[RHO] + v[0]
    east = (x[DU + 1] + x[U + 1] * x[S]) / x[RHO] + v[1]
    speed = max(math.hypot(north, east), LEAST_SPEED)
    return north / speed, east / speed, speed


@kernel
def flow(x, a, v, f):
    """Write dx/dt (2.22), (2.32)-(2.33), without noise.

    Args:
        x: state (10,).
        a, v: own acceleration, m/s^2, and velocity, m/s, in N, (3,).
        f: written, (10,).
    """
    north, east, _ = course_of(x, v)
    ax, ay, az = a[0] + x[LAT] * east, a[1] - x[LAT] * north, a[2]  # own minus the leader's
    rho, s = x[RHO], x[S]
    turn = x[DU] * x[DU] + x[DU + 1] * x[DU + 1] + x[DU + 2] * x[DU + 2]
    turn -= rho * (x[U] * ax + x[U + 1] * ay + x[U + 2] * az)
    for i in range(3):
        f[U + i] = x[DU + i]
        f[DU + i] = -turn * x[U + i] - 2.0 * s * x[DU + i]
    f[DU] -= rho * ax
    f[DU + 1] -= rho * ay
    f[DU + 2] -= rho * az
    f[RHO] = -rho * s
    f[S] = turn - s * s
    f[B] = f[LAT] = 0.0


@kernel
def slope(x, a, v, natural, F, g):
    """Write the derivative of the flow by the error state, (10, 10).

    Args:
        x, a, v: as of `flow`.
        natural: errors of rho and b themselves, rather than of their logarithms.
        F: written.
        g: scratch, (10,): the derivative of the leader's velocity across its course.
    """
    north, east, speed = course_of(x, v)
    ax, ay, az = a[0] + x[LAT] * east, a[1] - x[LAT] * north, a[2]
    rho, s, rate = x[RHO], x[S], x[LAT] / speed
    unit = 1.0 if natural else rho  # d rho / d error
    turn = x[DU] * x[DU] + x[DU + 1] * x[DU + 1] + x[DU + 2] * x[DU + 2]
    inward = x[U] * ax + x[U + 1] * ay + x[U + 2] * az
    turn -= rho * inward
    for i in range(SIZE):
        g[i] = 0.0
        for j in range(SIZE):
            F[i, j] = 0.0
    g[U], g[U + 1] = -east * s / rho, north * s / rho
    g[DU], g[DU + 1] = -east / rho, north / rho
    g[S] = (north * x[U + 1] - east * x[U]) / rho
    across = north * (x[DU + 1] + x[U + 1] * s) - east * (x[DU] + x[U] * s)
    g[RHO] = -across / (rho * rho) * unit
    # the relative acceleration a moves by rate * (north, east) g, and by (east, -north) d a_lat
    along = x[U] * north + x[U + 1] * east
    lateral = x[U] * east - x[U + 1] * north
    for i in range(3):
        F[U + i, DU + i] = 1.0
        ai = ax if i == 0 else ay if i == 1 else az
        ahead = north if i == 0 else east if i == 1 else 0.0
        right = east if i == 0 else -north if i == 1 else 0.0
        through = rho * rate * (x[U + i] * along - ahead)
        F[DU + i, LAT] = rho * (x[U + i] * lateral - right)
        for k in range(8):
            F[DU + i, k] = through * g[k]
        F[DU + i, U + i] -= turn
        F[DU + i, DU + i] -= 2.0 * s
        F[DU + i, U] += rho * x[U + i] * ax
        F[DU + i, U + 1] += rho * x[U + i] * ay
        F[DU + i, U + 2] += rho * x[U + i] * az
        for k in range(3):
            F[DU + i, DU + k] -= 2.0 * x[U + i] * x[DU + k]
        F[DU + i, RHO] += (inward * x[U + i] - ai) * unit
        F[DU + i, S] -= 2.0 * x[DU + i]
    for k in range(8):
        F[S, k] = -rho * rate * along * g[k]
    F[S, LAT] = -rho * lateral
    F[S, U] -= rho * ax
    F[S, U + 1] -= rho * ay
    F[S, U + 2] -= rho * az
    for k in range(3):
        F[S, DU + k] += 2.0 * x[DU + k]
    F[S, RHO] -= inward * unit
    F[S, S] -= 2.0 * s
    F[RHO, RHO] = -s if natural else 0.0
    F[RHO, S] = -rho if natural else -1.0


@kernel
def transition(F, dt, Phi):
    """Write Phi = I + F dt + F^2 dt^2 / 2, (n, n)."""
    n = F.shape[0]
    for i in range(n):
        for j in range(n):
            total = 0.0
            for k in range(n):
                total += F[i, k] * F[k, j]
            Phi[i, j] = F[i, j] * dt + 0.5 * dt * dt * total
        Phi[i, i] += 1.0


@kernel
def constrain(x):
    """Make u a unit vector and its rate perpendicular to it (2.28)-(2.29)."""
    length = math.sqrt(x[U] * x[U] + x[U + 1] * x[U + 1] + x[U + 2] * x[U + 2])
    along = 0.0
    for i in range(3):
        x[U + i] /= length
        along += x[U + i] * x[DU + i]
    for i in range(3):
        x[DU + i] -= along * x[U + i]


@kernel
def step(x, P, a, v, natural, dt, cfg, scratch):
    """Predict over one inner step, by the midpoint rule, in place."""
    middle, f, F, Phi, Q = (
        scratch["middle"], scratch["f"], scratch["F"], scratch["Phi"], scratch["Q"]
    )  # fmt: skip
    flow(x, a, v, f)
    for i in range(SIZE):
        middle[i] = x[i] + 0.5 * dt * f[i]
    for i in range(3):
        v[i] += 0.5 * dt * a[i]
    flow(middle, a, v, f)
    slope(middle, a, v, natural, F, scratch["g"])
    transition(F, dt, Phi)
    white = cfg["q_a"] * dt * middle[RHO] * middle[RHO]
    for i in range(3):
        v[i] += 0.5 * dt * a[i]
        for j in range(3):
            Q[DU + i, DU + j] = -white * middle[U + i] * middle[U + j]
        Q[DU + i, DU + i] += white
    Q[S, S] = white
    Q[LAT, LAT] = cfg["q_lat"] * dt
    predict_covariance(P, Phi, Q, scratch["M"])
    for i in range(SIZE):
        x[i] += dt * f[i]
    x[RHO] = max(x[RHO], 1.0 / FARTHEST)
    constrain(x)


@kernel
def begin(track, own, sight, natural, cfg):
    """Start from the first image: standing still relative to the follower, not turning."""
    x, P = track["x"], track["P"]
    var_r, cov_rb, var_b = first_look(x, own, sight, cfg)
    for i in range(SIZE):
        for j in range(SIZE):
            P[i, j] = 0.0
    angle, speed = cfg["sigma_image"] ** 2, (cfg["sd_velocity"] * x[RHO]) ** 2
    for i in range(3):
        x[DU + i] = 0.0
        for j in range(3):
            across = (1.0 if i == j else 0.0) - x[U + i] * x[U + j]
            P[U + i, U + j] = angle * across
            P[DU + i, DU + j] = speed * across
    x[S] = x[LAT] = 0.0
    unit, size = (x[RHO], x[B]) if natural else (1.0, 1.0)
    P[S, S] = speed
    P[RHO, RHO] = var_r * unit * unit
    P[RHO, B] = P[B, RHO] = -cov_rb * unit * size
    P[B, B] = var_b * size * size
    P[LAT, LAT] = cfg["sd_lat"] ** 2


@kernel
def predict(track, own, natural, cfg, scratch):
    """Predict over one period, inner step by inner step."""
    v, push = scratch["v"], own["push"]
    n = push.shape[0]
    dt = cfg["dt"] / n
    for i in range(3):
        v[i] = own["v_V_N"][i]
        for k in range(n):
            v[i] -= dt * push[k, i]
    for k in range(n):
        step(track["x"], track["P"], push[k], v, natural, dt, cfg, scratch)


@kernel
def update(track, sight, natural, consider, belief, cfg, scratch):
    """Use one image: two angles across the line of sight, and the wing tips' where there is one.

    The measured direction has two degrees of freedom, so it counts as two numbers, (2.25)-(2.26).
    """
    x, P, H, xi = track["x"], track["P"], scratch["H"], scratch["xi"]
    residual, variance = scratch["residual"], scratch["variance"]
    for j in range(SIZE):
        xi[j] = 0.0
        for i in range(3):
            H[i, j] = 0.0
    tangents(x, sight, scratch["C"], H, residual)
    rows = 2
    variance[0] = variance[1] = cfg["sigma_image"] ** 2
    if sight["alpha"] > 0.0:
        rows, half = 3, 0.5 * x[B] * x[RHO]
        share = 2.0 * half / (1.0 + half * half)
        H[2, RHO], H[2, B] = (share / x[RHO], share / x[B]) if natural else (share, share)
        residual[2] = sight["alpha"] - 2.0 * math.atan(half)
        variance[2] = 2.0 * cfg["sigma_image"] ** 2
    told, belief["nis"] = P[B, B], 0.0
    for i in range(rows):
        belief["innovation"][i] = residual[i]
        left = residual[i]
        for j in range(SIZE):
            left -= H[i, j] * xi[j]
        total = update_scalar(xi, P, H, i, left, variance[i], scratch["work"])
        belief["nis"] += left * left / total
        if consider:
            xi[B], P[B, B] = 0.0, told
    for j in range(SIZE):
        if j != RHO and j != B:
            x[j] += xi[j]
    if natural:
        x[RHO] = max(x[RHO] + xi[RHO], 1.0 / FARTHEST)
        x[B] = max(x[B] + xi[B], 1.0 / FARTHEST)
    else:
        x[RHO] *= math.exp(xi[RHO])
        x[B] *= math.exp(xi[B])
    constrain(x)


@kernel
def describe(track, own, natural, belief, scratch):
    """Write relative position and velocity, the leader's acceleration and their covariance."""
    x, P, T, C = track["x"], track["P"], scratch["T"], belief["C"]
    r, v, a, rho = belief["r_LV_N"], belief["v_LV_N"], belief["a_L_N"], x[RHO]
    unit = 1.0 / rho if natural else 1.0  # d ln rho / d error
    for i in range(3):
        r[i] = x[U + i] / rho
        v[i] = (x[DU + i] + x[U + i] * x[S]) / rho
        for j in range(SIZE):
            T[i, j] = P[U + i, j] / rho - unit * r[i] * P[RHO, j]
            T[3 + i, j] = (x[S] * P[U + i, j] + P[DU + i, j] + x[U + i] * P[S, j]) / rho
            T[3 + i, j] -= unit * v[i] * P[RHO, j]
    for m in range(6):
        for i in range(3):
            C[m, i] = T[m, U + i] / rho - unit * r[i] * T[m, RHO]
            C[m, 3 + i] = (x[S] * T[m, U + i] + T[m, DU + i] + x[U + i] * T[m, S]) / rho
            C[m, 3 + i] -= unit * v[i] * T[m, RHO]
    north, east, _ = course_of(x, own["v_V_N"])
    a[0], a[1], a[2] = -x[LAT] * east, x[LAT] * north, 0.0
    belief["sd_log_range"] = unit * math.sqrt(max(P[RHO, RHO], 0.0))
    belief["b"] = x[B]
    belief["sd_b"] = math.sqrt(max(P[B, B], 0.0)) * (1.0 if natural else x[B])
