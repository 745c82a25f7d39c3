"""A quadrotor with six degrees of freedom that obeys acceleration commands by tilting.

Thrust acts along its vertical axis only, so that an acceleration needs an attitude first: the
command turns into a thrust vector, that into an attitude, and the attitude loop follows it as a
second-order system with limited rates. A camera that is fixed to the body tilts with it.

The attitude is the quaternion q (scalar first) of C_BN, body axes forward, right, down.
"""

from __future__ import annotations

import math

from visenvs.core.compile import kernel
from visenvs.core.frames import wrap_angle
from visenvs.core.units import GRAVITY

LEAST_THRUST = 0.2  # of the weight, so that it stays upright


@kernel
def attitude(q, C):
    """Write C_BN of a unit quaternion (scalar first), (3, 3)."""
    w, x, y, z = q[0], q[1], q[2], q[3]
    C[0, 0], C[0, 1], C[0, 2] = (
        1.0 - 2.0 * (y * y + z * z),
        2.0 * (x * y + w * z),
        2.0 * (x * z - w * y),
    )
    C[1, 0], C[1, 1], C[1, 2] = (
        2.0 * (x * y - w * z),
        1.0 - 2.0 * (x * x + z * z),
        2.0 * (y * z + w * x),
    )
    C[2, 0], C[2, 1], C[2, 2] = (
        2.0 * (x * z + w * y),
        2.0 * (y * z - w * x),
        1.0 - 2.0 * (x * x + y * y),
    )


@kernel
def turn(q, omega, dt):
    """Turn a quaternion by the body rates omega (rad/s, (3,)) held for dt s, in place; exact."""
    rate = math.sqrt(omega[0] * omega[0] + omega[1] * omega[1] + omega[2] * omega[2])
    half = 0.5 * rate * dt
    c, s = math.cos(half), (math.sin(half) / rate if rate > 1e-12 else 0.5 * dt)
    w, x, y, z = q[0], q[1], q[2], q[3]
    a, b, d = s * omega[0], s * omega[1], s * omega[2]
    q[0] = c * w - a * x - b * y - d * z
    q[1] = c * x + a * w + d * y - b * z
    q[2] = c * y + b * w + a * z - d * x
    q[3] = c * z + d * w + b * x - a * y
    norm = math.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    for i in range(4):
        q[i] /= norm


@kernel
def tilt_for(command, heading, C):
    """Write the attitude C_BN whose thrust gives an acceleration; returns the thrust, m/s^2.

    Args:
        command: acceleration in N, m/s^2, (3,).
        heading: of the forward axis, rad.
        C: written, (3, 3).
    """
    down_N = GRAVITY - command[2]
    down_N = max(down_N, LEAST_THRUST * GRAVITY)
    length = math.sqrt(command[0] ** 2 + command[1] ** 2 + down_N * down_N)
    # the body's down axis is against the thrust
    C[2, 0], C[2, 1], C[2, 2] = -command[0] / length, -command[1] / length, down_N / length
    c, s = math.cos(heading), math.sin(heading)
    # right = down x (heading), forward = right x down
    C[1, 0], C[1, 1] = -C[2, 2] * s, C[2, 2] * c
    C[1, 2] = C[2, 0] * s - C[2, 1] * c
    norm = math.sqrt(C[1, 0] ** 2 + C[1, 1] ** 2 + C[1, 2] ** 2)
    for j in range(3):
        C[1, j] /= norm
    C[0, 0] = C[1, 1] * C[2, 2] - C[1, 2] * C[2, 1]
    C[0, 1] = C[1, 2] * C[2, 0] - C[1, 0] * C[2, 2]
    C[0, 2] = C[1, 0] * C[2, 1] - C[1, 1] * C[2, 0]
    return length


@kernel
def fly(lane, command, heading, cfg, scratch):
    """Obey an acceleration for one step of dt s, in place.

    The attitude error is the rotation vector from the attitude to the wanted one, to first order;
    angular acceleration = bandwidth^2 error - 2 damping bandwidth omega, which is integrated in
    `substeps` parts. The thrust is the wanted force's part along the axis as it is, so that nothing
    pushes where nobody wants it to while it turns (Lee, Leok and McClamroch 2010, "Geometric
    tracking control of a quadrotor UAV on SE(3)"). What is reached is that, and gravity.

    Args:
        lane: record with r_V_N, v_V_N, a_V_N (what was reached, mean over the step), q_V (4,),
            omega_V (body rates, rad/s, (3,)); SI; changed in place.
        command: acceleration in N, m/s^2, (3,).
        heading: wanted, rad.
        cfg: record with dt, bandwidth (rad/s), damping, rate_max (rad/s), substeps.
        scratch: record with wanted and C, (3, 3) each.
    """
    wanted, C, omega = scratch["wanted"], scratch["C"], lane["omega_V"]
    q, r, v = lane["q_V"], lane["r_V_N"], lane["v_V_N"]
    thrust = tilt_for(command, wrap_angle(heading), wanted)
    n = int(cfg["substeps"])
    h, k = cfg["dt"] / n, cfg["bandwidth"]
    for i in range(3):
        lane["a_V_N"][i] = 0.0
    for _ in range(n):
        attitude(q, C)
        for i in range(3):
            # rotation vector e in B: wanted = (I - [e x]) C, e = half the difference of rows
            a, b = (i + 1) % 3, (i + 2) % 3
            error = 0.0
            for j in range(3):
                error += 0.5 * (wanted[a, j] * C[b, j] - wanted[b, j] * C[a, j])
            omega[i] += h * (k * k * error - 2.0 * cfg["damping"] * k * omega[i])
            omega[i] = min(max(omega[i], -cfg["rate_max"]), cfg["rate_max"])
        turn(q, omega, h)
        attitude(q, C)
        along = wanted[2, 0] * C[2, 0] + wanted[2, 1] * C[2, 1] + wanted[2, 2] * C[2, 2]
        for i in range(3):
            a = -thrust * max(along, 0.0) * C[2, i] + (GRAVITY if i == 2 else 0.0)
            r[i] += h * (v[i] + 0.5 * h * a)
            v[i] += h * a
            lane["a_V_N"][i] += a / n
