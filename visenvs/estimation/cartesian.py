"""Filters of a leader in Cartesian coordinates, nine states: unscented and extended (UKF paper).

State: relative position and velocity in N, the wingspan b, and two accelerations of the leader:
a_lat to the right of its course, and a_up across its velocity in the vertical plane, positive up
(UKF paper (1)-(10); it calls the latter longitudinal, but column 1 of (2) is perpendicular to the
velocity). SI. The wing-tip angle of (14) is 2 atan(b / (2 r)): b is x_7, where x_3 is printed.
Without uncertainty in b it stays as told.

Both predict over a period at once, by the midpoint rule with the follower's mean acceleration.
"""

from __future__ import annotations

import math

import numpy as np

from visenvs.core.compile import kernel
from visenvs.core.frames import wrap_angle
from visenvs.core.sight import to_angles
from visenvs.estimation.ekf import (
    factorise,
    pack_lower,
    predict_covariance,
    update_sequential,
    white_acceleration,
)
from visenvs.estimation.polar import LEAST_SPEED, transition
from visenvs.estimation.ukf import recombine, sigma_points, update_angle
from visenvs.estimation.wings import first_look, tangents

R, V, B, LAT, UP, SIZE = 0, 3, 6, 7, 8, 9  # places in the state
POINTS = 2 * SIZE + 1
SPREAD = 3.0  # n + lambda (UKF paper, before (23))
NEAREST = 1e-3  # m; r and b stay positive
LEAST_COSINE = 1e-9  # of an elevation: straight up there is no azimuth

TRACK = np.dtype([("x", "f8", (SIZE,)), ("P", "f8", (SIZE, SIZE))])
SCRATCH = np.dtype([
    ("polar", "f8", (10,)), ("factor", "f8", (SIZE * (SIZE + 1) // 2,)),
    *((name, "f8", (SIZE,)) for name in ("middle", "f", "work")),
    *((name, "f8", (SIZE, SIZE)) for name in ("F", "Phi", "Q", "M")),
    ("points", "f8", (POINTS, SIZE)), ("angles", "f8", (POINTS,)),
    ("C", "f8", (3, 3)), *((name, "f8", (3, SIZE)) for name in ("H", "B")),
    *((name, "f8", (3,)) for name in ("a", "v", "u", "residual", "variance", "S")),
])  # fmt: skip


@kernel
def axes_of(x, v):
    """Course (north, east), horizontal speed, speed and downward speed of the leader, m/s."""
    north, east, down = x[V] + v[0], x[V + 1] + v[1], x[V + 2] + v[2]
    flat = max(math.hypot(north, east), LEAST_SPEED)
    return north / flat, east / flat, flat, math.hypot(flat, down), down


@kernel
def pull(x, v):
    """Acceleration of the leader in N, m/s^2 (UKF paper (2))."""
    north, east, flat, speed, down = axes_of(x, v)
    dive = x[UP] * down / speed
    return (
        dive * north - x[LAT] * east,
        dive * east + x[LAT] * north,
        -x[UP] * flat / speed,
    )


@kernel
def flow(x, a, v, f):
    """Write dx/dt (UKF paper (9)); own acceleration a, m/s^2, and velocity v, m/s, in N, (3,)."""
    ax, ay, az = pull(x, v)
    for i in range(3):
        f[R + i] = x[V + i]
    f[V], f[V + 1], f[V + 2] = ax - a[0], ay - a[1], az - a[2]
    f[B] = f[LAT] = f[UP] = 0.0


@kernel
def slope(x, v, F):
    """Write the derivative of the flow by the state, (9, 9)."""
    north, east, flat, speed, down = axes_of(x, v)
    sine, cosine = down / speed, flat / speed
    for i in range(SIZE):
        for j in range(SIZE):
            F[i, j] = 0.0
    for i in range(3):
        F[R + i, V + i] = 1.0
        course = north if i == 0 else east if i == 1 else 0.0  # the course, e
        right = -east if i == 0 else north if i == 1 else 0.0  # n, to its right
        ahead = cosine * course + (sine if i == 2 else 0.0)  # along the velocity
        climb = sine * course - (cosine if i == 2 else 0.0)  # m, across it, up
        F[V + i, LAT], F[V + i, UP] = right, climb
        for k in range(3):
            along_right = -east if k == 0 else north if k == 1 else 0.0
            along_climb = sine * (north if k == 0 else east if k == 1 else 0.0)
            along_climb -= cosine if k == 2 else 0.0
            F[V + i, V + k] = (x[UP] * sine * right - x[LAT] * course) * along_right / flat
            F[V + i, V + k] -= x[UP] * ahead * along_climb / speed


@kernel
def own_motion(own, dt, scratch):
    """Write the mean acceleration over the period and the velocity in its middle."""
    a, v, push = scratch["a"], scratch["v"], own["push"]
    for i in range(3):
        a[i] = 0.0
        for k in range(push.shape[0]):
            a[i] += push[k, i] / push.shape[0]
        v[i] = own["v_V_N"][i] - 0.5 * dt * a[i]


@kernel
def advance(x, dt, scratch):
    """Move a state over one period, by the midpoint rule, in place (UKF paper (31))."""
    a, v, middle, f = scratch["a"], scratch["v"], scratch["middle"], scratch["f"]
    for i in range(3):
        v[i] -= 0.5 * dt * a[i]
    flow(x, a, v, f)
    for i in range(3):
        v[i] += 0.5 * dt * a[i]
    for i in range(SIZE):
        middle[i] = x[i] + 0.5 * dt * f[i]
    flow(middle, a, v, f)
    for i in range(SIZE):
        x[i] += dt * f[i]


@kernel
def process_noise(dt, cfg, Q):
    """Write the covariance that white leader acceleration and drifting a_lat, a_up add, (9, 9)."""
    place, both, speed = white_acceleration(cfg["q_a"], dt)
    for i in range(3):
        Q[R + i, R + i] = place
        Q[R + i, V + i] = Q[V + i, R + i] = both
        Q[V + i, V + i] = speed
    Q[LAT, LAT] = cfg["q_lat"] * dt
    Q[UP, UP] = cfg["q_up"] * dt


@kernel
def begin(track, own, sight, cfg, scratch):
    """Start from the first image, (43)-(50), with the covariance that one image has.

    The printed (51), 1 ft in every direction, is far too small along the line of sight.
    """
    x, P, polar = track["x"], track["P"], scratch["polar"]
    var_r, cov_rb, var_b = first_look(polar, own, sight, cfg)
    r, b = 1.0 / polar[6], polar[8]
    for i in range(SIZE):
        x[i] = 0.0
        for j in range(SIZE):
            P[i, j] = 0.0
    across = cfg["sigma_image"] ** 2
    for i in range(3):
        x[R + i] = r * polar[i]
        for j in range(3):
            P[R + i, R + j] = r * r * (var_r - across) * polar[i] * polar[j]
        P[R + i, R + i] += r * r * across
        P[R + i, B] = P[B, R + i] = r * b * cov_rb * polar[i]
        P[V + i, V + i] = cfg["sd_velocity"] ** 2
    x[B] = b
    P[B, B] = b * b * var_b
    P[LAT, LAT] = cfg["sd_lat"] ** 2
    P[UP, UP] = cfg["sd_up"] ** 2


@kernel
def predict_extended(track, own, cfg, scratch):
    """Predict with a linearised flow over one period."""
    x, dt = track["x"], cfg["dt"]
    own_motion(own, dt, scratch)
    advance(x, dt, scratch)
    slope(scratch["middle"], scratch["v"], scratch["F"])
    transition(scratch["F"], dt, scratch["Phi"])
    process_noise(dt, cfg, scratch["Q"])
    predict_covariance(track["P"], scratch["Phi"], scratch["Q"], scratch["M"])


@kernel
def predict_unscented(track, own, cfg, scratch):
    """Predict with sigma points over one period (UKF paper (29)-(33))."""
    points, dt = scratch["points"], cfg["dt"]
    own_motion(own, dt, scratch)
    draw_points(track, scratch)
    for j in range(POINTS):
        advance(points[j], dt, scratch)
    process_noise(dt, cfg, scratch["Q"])
    recombine(points, SPREAD, scratch["Q"], track["x"], track["P"])


@kernel
def draw_points(track, scratch):
    """Write the sigma points of the present estimate (UKF paper (29)-(30), (34)-(35))."""
    pack_lower(track["P"], scratch["factor"])
    factorise(scratch["factor"], SIZE)
    sigma_points(track["x"], scratch["factor"], SPREAD, scratch["points"])


@kernel
def wing_angle(x):
    """Angle between the wing tips, rad."""
    r = math.sqrt(x[R] * x[R] + x[R + 1] * x[R + 1] + x[R + 2] * x[R + 2])
    return 2.0 * math.atan(0.5 * x[B] / max(r, NEAREST))


@kernel
def update_extended(track, sight, belief, cfg, scratch):
    """Use one image, linearised at the prediction."""
    x, H, u = track["x"], scratch["H"], scratch["u"]
    residual, variance = scratch["residual"], scratch["variance"]
    r = max(math.sqrt(x[R] * x[R] + x[R + 1] * x[R + 1] + x[R + 2] * x[R + 2]), NEAREST)
    for i in range(3):
        u[i] = x[R + i] / r
    tangents(u, sight, scratch["C"], H, residual)
    rows, variance[0] = 2, cfg["sigma_image"] ** 2
    variance[1], variance[2] = variance[0], 2.0 * variance[0]
    for k in range(3):
        H[0, k] /= r
        H[1, k] /= r
    if sight["alpha"] > 0.0:
        rows, half = 3, 0.5 * x[B] / r
        share = 2.0 * half / (1.0 + half * half)
        residual[2] = sight["alpha"] - 2.0 * math.atan(half)
        H[2, B] = share / x[B]
        for k in range(3):
            H[2, k] = -share * u[k] / r
    for i in range(rows):
        belief["innovation"][i] = residual[i]
    belief["nis"] = update_sequential(
        x, track["P"], H, residual[:rows], variance[:rows], 0.0, scratch["B"], scratch["S"]
    )
    x[B] = max(x[B], NEAREST)


@kernel
def update_unscented(track, sight, belief, cfg, scratch):
    """Use one image, angle by angle, each with points drawn afresh (UKF paper (34)-(42)).

    The angles are azimuth and elevation in N; the paper's (11)-(12) are those in a level camera.
    """
    x, P, points, angles = track["x"], track["P"], scratch["points"], scratch["angles"]
    z, alpha = sight["u_N"], sight["alpha"]
    azimuth, elevation, _ = to_angles(z[0], z[1], z[2])
    variance, belief["nis"] = cfg["sigma_image"] ** 2, 0.0
    for i in range(3 if alpha > 0.0 else 2):
        draw_points(track, scratch)
        for j in range(POINTS):
            y, p, _ = to_angles(points[j, R], points[j, R + 1], points[j, R + 2])
            angles[j] = y if i == 0 else p if i == 1 else wing_angle(points[j])
        measured, noise = azimuth, variance / max(math.cos(elevation), LEAST_COSINE) ** 2
        if i == 1:
            measured, noise = elevation, variance
        elif i == 2:
            measured, noise = alpha, 2.0 * variance
        e, total = update_angle(x, P, points, SPREAD, angles, measured, noise, scratch["work"])
        belief["innovation"][i] = wrap_angle(e)
        belief["nis"] += e * e / total
        x[B] = max(x[B], NEAREST)


@kernel
def describe(track, own, belief):
    """Write relative position and velocity, the leader's acceleration and their covariance."""
    x, P, a = track["x"], track["P"], belief["a_L_N"]
    square, along = 0.0, 0.0
    for i in range(3):
        belief["r_LV_N"][i], belief["v_LV_N"][i] = x[R + i], x[V + i]
        square += x[i] * x[i]
        for j in range(3):
            along += x[i] * P[i, j] * x[j]
    for i in range(6):
        for j in range(6):
            belief["C"][i, j] = P[i, j]
    a[0], a[1], a[2] = pull(x, own["v_V_N"])
    belief["sd_log_range"] = math.sqrt(max(along, 0.0)) / max(square, NEAREST)
    belief["b"] = x[B]
    belief["sd_b"] = math.sqrt(max(P[B, B], 0.0))
