"""The Bierman-Thornton filter of the IARC paper: navigation by an IMU and floor landmarks.

Estimated are position and velocity in N, attitude, and the biases of accelerometer and gyro, with
the places of SLOTS landmarks. The filter runs on the errors (dp, dv, dtheta, dba, dbg | dl_1, ..):
dtheta is a rotation vector in B, C_NB = C_NB_hat (I + [dtheta x]), three numbers; the four of a
quaternion, as printed, have a singular covariance. The vehicle's errors come first and the
landmarks' last, so that a prediction works on a block of 15 by 27 (`ud.predict_leading`).

The transition is collected from IMU sample to IMU sample, and the covariance predicted once a
picture. A new landmark starts where its ray meets the floor, as good as unknown, and its first
sighting ties it to the vehicle.
"""

from __future__ import annotations

import math

import numpy as np

from visenvs.core.compile import kernel
from visenvs.core.pinhole import jacobian, project
from visenvs.core.units import GRAVITY
from visenvs.estimation import ud

SLOTS, VEHICLE, NOISES = 20, 15, 12
STATES = VEHICLE + 3 * SLOTS
POSITION, VELOCITY, ATTITUDE, FORCE, RATE = 0, 3, 6, 9, 12  # where errors begin
ACROSS, UP = 1.0, 0.01  # deviations of a new landmark on the floor, m

NAVIGATION = np.dtype(
    [
        ("p", "f8", (3,)),  # m, N
        ("v", "f8", (3,)),
        ("C", "f8", (3, 3)),  # C_BN
        ("biases", "f8", (2, 3)),  # of specific force, m/s^2, and of turn rate, rad/s
        ("landmarks", "f8", (SLOTS, 3)),  # m, N
        ("alive", "f8", (SLOTS,)),
        ("missed", "f8", (SLOTS,)),  # pictures in a row
        ("Phi", "f8", (VEHICLE, VEHICLE)),  # since the last prediction,
        ("elapsed", "f8"),  # and how long that was, s
        ("U", "f8", (STATES, STATES)),
        ("D", "f8", (STATES,)),
    ]
)
SCRATCH = np.dtype(
    [
        ("dx", "f8", (STATES,)),
        ("h", "f8", (2, STATES)),
        *((name, "f8", (STATES,)) for name in ("f", "v", "b")),
        ("W", "f8", (VEHICLE, VEHICLE + NOISES)),
        ("weight", "f8", (VEHICLE + NOISES,)),
        ("G", "f8", (VEHICLE, NOISES)),
        ("q", "f8", (NOISES,)),
        ("column", "f8", (VEHICLE,)),
        ("A", "f8", (VEHICLE, VEHICLE)),
        ("B", "f8", (VEHICLE, VEHICLE)),
        ("r_B", "f8", (3,)),
        ("turn", "f8", (3, 3)),
    ]
)


@kernel
def begin(nav, p, v, C, deviations):
    """Start from a known place.

    Args:
        nav: a NAVIGATION record, written.
        p, v, C: position (m), velocity (m/s) and attitude C_BN.
        deviations: of position, velocity, attitude (rad), and both biases, (5,).
    """
    for i in range(3):
        nav["p"][i], nav["v"][i] = p[i], v[i]
        for j in range(3):
            nav["C"][i, j] = C[i, j]
    nav["biases"][:] = 0.0
    nav["alive"][:] = 0.0
    nav["landmarks"][:] = 0.0
    nav["U"][:] = 0.0
    for i in range(STATES):
        nav["U"][i, i] = 1.0
        nav["D"][i] = deviations[i // 3] ** 2 if i < VEHICLE else 1.0
    restart(nav)


@kernel
def restart(nav):
    """Forget the transition so far."""
    nav["elapsed"] = 0.0
    for i in range(VEHICLE):
        for j in range(VEHICLE):
            nav["Phi"][i, j] = 1.0 if i == j else 0.0


@kernel
def rotation(e, R):
    """Write R = exp(-[e x]), the DCM of axes turned by the rotation vector e (rad, (3,))."""
    angle = math.sqrt(e[0] * e[0] + e[1] * e[1] + e[2] * e[2])
    s = math.sin(angle) / angle if angle > 1e-9 else 1.0
    c = (1.0 - math.cos(angle)) / (angle * angle) if angle > 1e-5 else 0.5
    for i in range(3):
        for j in range(3):
            R[i, j] = c * e[i] * e[j]
        R[i, i] += math.cos(angle)
    R[0, 1] += s * e[2]
    R[0, 2] -= s * e[1]
    R[1, 0] -= s * e[2]
    R[1, 2] += s * e[0]
    R[2, 0] += s * e[1]
    R[2, 1] -= s * e[0]


@kernel
def turn_attitude(C, e, scratch):
    """C <- exp(-[e x]) C: the body turns by e (rad, (3,)), given in B."""
    R, A = scratch["turn"], scratch["A"]
    rotation(e, R)
    for i in range(3):
        for j in range(3):
            A[i, j] = R[i, 0] * C[0, j] + R[i, 1] * C[1, j] + R[i, 2] * C[2, j]
    for i in range(3):
        for j in range(3):
            C[i, j] = A[i, j]


@kernel
def integrate(nav, force, rate, dt, scratch):
    """Use one IMU sample that held for dt s, in place: the estimate, and the transition of errors.

    Attitude at the middle of the sample carries specific force to N.
    """
    C, e, f, A, B = nav["C"], scratch["r_B"], scratch["f"], scratch["A"], scratch["B"]
    for i in range(3):
        e[i] = 0.5 * dt * (rate[i] - nav["biases"][1, i])
        f[i] = force[i] - nav["biases"][0, i]
    turn_attitude(C, e, scratch)
    for i in range(VEHICLE):
        for j in range(VEHICLE):
            A[i, j] = 1.0 if i == j else 0.0
    for i in range(3):
        A[POSITION + i, VELOCITY + i] = dt
        for j in range(3):
            a, b = (j + 1) % 3, (j + 2) % 3
            # -C_NB [f x] dtheta and -C_NB dba; column j of C_NB [f x] is C_NB (f x e_j)
            A[VELOCITY + i, ATTITUDE + j] = -dt * (C[a, i] * f[b] - C[b, i] * f[a])
            A[VELOCITY + i, FORCE + j] = -dt * C[j, i]
        a, b = (i + 1) % 3, (i + 2) % 3
        # -[omega x] dtheta - dbg
        A[ATTITUDE + i, ATTITUDE + a] = 2.0 * e[b]
        A[ATTITUDE + i, ATTITUDE + b] = -2.0 * e[a]
        A[ATTITUDE + i, RATE + i] = -dt
        acceleration = C[0, i] * f[0] + C[1, i] * f[1] + C[2, i] * f[2]
        acceleration += GRAVITY if i == 2 else 0.0
        nav["p"][i] += dt * (nav["v"][i] + 0.5 * dt * acceleration)
        nav["v"][i] += dt * acceleration
    multiply(A, nav["Phi"], B)
    turn_attitude(C, e, scratch)
    nav["elapsed"] += dt


@kernel
def multiply(A, Phi, B):
    """Phi <- A Phi for a sparse A; B is scratch, all (15, 15)."""
    for i in range(VEHICLE):
        for j in range(VEHICLE):
            B[i, j] = 0.0
        for k in range(VEHICLE):
            if A[i, k] != 0.0:
                for j in range(VEHICLE):
                    B[i, j] += A[i, k] * Phi[k, j]
    for i in range(VEHICLE):
        for j in range(VEHICLE):
            Phi[i, j] = B[i, j]


@kernel
def predict(nav, settings, scratch):
    """Carry the covariance over the IMU samples since the last time, in place.

    Args:
        settings: record with sigma_force, sigma_rate, walk_force, walk_rate, as in `sensors.imu`.
    """
    G, q, T = scratch["G"], scratch["q"], nav["elapsed"]
    G[:] = 0.0
    for i in range(NOISES):
        G[VELOCITY + i, i] = 1.0
    for i in range(3):
        q[i] = settings["sigma_force"] ** 2 * T
        q[3 + i] = settings["sigma_rate"] ** 2 * T
        q[6 + i] = settings["walk_force"] ** 2 * T
        q[9 + i] = settings["walk_rate"] ** 2 * T
    W, weight, column = scratch["W"], scratch["weight"], scratch["column"]
    ud.predict_leading(nav["U"], nav["D"], nav["Phi"], G, q, W, weight, column)
    restart(nav)
    scratch["dx"][:] = 0.0


@kernel
def expect(nav, j, C_CB, nearest, scratch, pixel):
    """Write landmark j's image point (y, z) and its derivatives by the errors, scratch["h"].

    Returns False, and writes nothing, where it is not more than `nearest` (m) deep.
    """
    C, r_B, h, R = nav["C"], scratch["r_B"], scratch["h"], scratch["turn"]
    for i in range(3):
        r_B[i] = 0.0
        for k in range(3):
            r_B[i] += C[i, k] * (nav["landmarks"][j, k] - nav["p"][k])
    X, y, z = project(C_CB, r_B, nearest)
    if X <= nearest:
        return False
    pixel[0], pixel[1] = y, z
    jacobian(C_CB, X, y, z, R)  # by r_B
    h[:] = 0.0
    for n in range(2):
        for i in range(3):
            a, b = (i + 1) % 3, (i + 2) % 3
            by_place = R[n, 0] * C[0, i] + R[n, 1] * C[1, i] + R[n, 2] * C[2, i]
            h[n, POSITION + i] = -by_place
            h[n, VEHICLE + 3 * j + i] = by_place
            # r_B + r_B x dtheta
            h[n, ATTITUDE + i] = R[n, a] * r_B[b] - R[n, b] * r_B[a]
    return True


@kernel
def innovation(nav, measured, pixel, n, variance, scratch):
    """Residual of coordinate n freed of the errors found so far, and its variance."""
    h, dx = scratch["h"][n], scratch["dx"]
    residual = measured[n] - pixel[n]
    for i in range(STATES):
        residual -= h[i] * dx[i]
    S = ud.innovation_variance(nav["U"], nav["D"], h, variance, scratch["f"], scratch["v"])
    return residual, S


@kernel
def use_landmark(nav, j, C_CB, measured, settings, scratch, pixel):
    """Use a sighting (y, z) of landmark j; False, and nothing changed, where it fails the gate.

    Args:
        settings: record with sigma_pixel (focal lengths), gate (of the sum of both squared
            residuals in standard deviations; 0 for none) and min_range (m).
        pixel: receives the predicted image point, (2,).
    """
    if not expect(nav, j, C_CB, settings["min_range"], scratch, pixel):
        return False
    variance, total = settings["sigma_pixel"] ** 2, 0.0
    for n in range(2):
        residual, S = innovation(nav, measured, pixel, n, variance, scratch)
        total += residual * residual / S
    if settings["gate"] > 0.0 and total > settings["gate"]:
        return False
    for n in range(2):
        residual, _ = innovation(nav, measured, pixel, n, variance, scratch)
        use(nav, scratch["h"][n], residual, variance, scratch)
    return True


@kernel
def use(nav, h, residual, variance, scratch):
    """One scalar update of the errors."""
    f, v, b = scratch["f"], scratch["v"], scratch["b"]
    ud.update(scratch["dx"], nav["U"], nav["D"], h, residual, variance, f, v, b)


@kernel
def use_height(nav, height, sigma, scratch):
    """Use a measured height above the floor (the plane z = 0 of N), m, with its deviation."""
    h = scratch["h"][0]
    h[:] = 0.0
    h[POSITION + 2] = -1.0
    residual = height + nav["p"][2] + scratch["dx"][POSITION + 2]
    use(nav, h, residual, sigma * sigma, scratch)


@kernel
def correct(nav, scratch):
    """Take the errors found out of the estimate, in place."""
    dx, e = scratch["dx"], scratch["r_B"]
    for i in range(3):
        nav["p"][i] += dx[POSITION + i]
        nav["v"][i] += dx[VELOCITY + i]
        nav["biases"][0, i] += dx[FORCE + i]
        nav["biases"][1, i] += dx[RATE + i]
        e[i] = dx[ATTITUDE + i]
    turn_attitude(nav["C"], e, scratch)
    for j in range(SLOTS):
        for i in range(3):
            nav["landmarks"][j, i] += dx[VEHICLE + 3 * j + i]
    dx[:] = 0.0


@kernel
def add_landmark(nav, j, C_CB, measured, settings, scratch, pixel):
    """Put a new landmark into slot j, where its ray meets the floor; False where it does not.

    Nor where that is too near: there it has no slopes.
    """
    C, ray = nav["C"], scratch["r_B"]
    for i in range(3):
        ray[i] = C_CB[0, i] + C_CB[1, i] * measured[0] + C_CB[2, i] * measured[1]
    down = C[0, 2] * ray[0] + C[1, 2] * ray[1] + C[2, 2] * ray[2]
    if down < 0.1 or nav["p"][2] > -settings["min_range"]:
        return False
    t = -nav["p"][2] / down
    for i in range(3):
        along = C[0, i] * ray[0] + C[1, i] * ray[1] + C[2, i] * ray[2]
        nav["landmarks"][j, i] = nav["p"][i] + t * along
        deviation = UP if i == 2 else ACROSS
        ud.replace(nav["U"], nav["D"], VEHICLE + 3 * j + i, deviation**2, scratch["b"])
    nav["landmarks"][j, 2] = 0.0
    if not expect(nav, j, C_CB, settings["min_range"], scratch, pixel):
        return False
    nav["alive"][j], nav["missed"][j] = 1.0, 0.0
    variance = settings["sigma_pixel"] ** 2
    for n in range(2):
        residual, _ = innovation(nav, measured, pixel, n, variance, scratch)
        use(nav, scratch["h"][n], residual, variance, scratch)
    return True
