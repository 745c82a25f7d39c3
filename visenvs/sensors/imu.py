"""An inertial measurement unit: specific force and turn rate with noise, and biases that walk."""

from __future__ import annotations

import math

from visenvs.core.compile import kernel
from visenvs.core.noise import normal_pair
from visenvs.core.units import GRAVITY


@kernel
def take_inertial(C, a, omega, biases, settings, seed, episode, step, stream, out):
    """Measure specific force and turn rate, and let the biases walk on.

    Args:
        C: attitude C_BN, (3, 3).
        a: acceleration in N, m/s^2, (3,).
        omega: body rates, rad/s, (3,).
        biases: of the accelerometer (m/s^2) and the gyro (rad/s), (2, 3); changed in place.
        settings: record with sigma_force (m/s^2 / sqrt(Hz)), sigma_rate (rad/s / sqrt(Hz)),
            walk_force (m/s^2 / sqrt(s)), walk_rate (rad/s / sqrt(s)), dt (s, between samples).
        seed, episode, step, stream: name the draws (`core.noise`), six pairs.
        out: specific force and turn rate in B, (2, 3).
    """
    white, walk = 1.0 / math.sqrt(settings["dt"]), math.sqrt(settings["dt"])
    for i in range(3):
        n_force, n_rate = normal_pair(seed, episode, stream, step, i)
        w_force, w_rate = normal_pair(seed, episode, stream, step, 3 + i)
        biases[0, i] += settings["walk_force"] * walk * w_force
        biases[1, i] += settings["walk_rate"] * walk * w_rate
        force = C[i, 0] * a[0] + C[i, 1] * a[1] + C[i, 2] * (a[2] - GRAVITY)
        out[0, i] = force + biases[0, i] + settings["sigma_force"] * white * n_force
        out[1, i] = omega[i] + biases[1, i] + settings["sigma_rate"] * white * n_rate
