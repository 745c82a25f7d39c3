"""EKF of an object at constant velocity: state (r_O_N, v_O_N), m and m/s, shape (6,).

What `inertial` is for an object that stands still; where its velocity is known, the two are one.
"""

from __future__ import annotations

import numpy as np

from visenvs.core.compile import kernel
from visenvs.estimation.ekf import update_sequential
from visenvs.estimation.sighting import compare

SCRATCH = np.dtype(
    [
        ("r", "f8", (3,)),
        ("G", "f8", (2, 3)),
        ("H", "f8", (2, 6)),
        ("B", "f8", (2, 6)),
        *((name, "f8", (2,)) for name in ("e", "variance", "S")),
    ]
)


@kernel
def begin(x, P, position, covariance, deviation):
    """Start at a position (m, (3,)) of a covariance (3, 3), at rest but for a deviation, m/s."""
    for i in range(6):
        x[i] = position[i] if i < 3 else 0.0
        for j in range(6):
            P[i, j] = covariance[i, j] if i < 3 and j < 3 else 0.0
    for i in range(3, 6):
        P[i, i] = deviation * deviation


@kernel
def predict(x, P, dt, q_dt):
    """Carry the state over dt s, P = Phi P Phi' + Q, in place; q_dt: of the position, m^2."""
    for i in range(3):
        x[i] += dt * x[i + 3]
        for j in range(6):
            P[i, j] += dt * P[i + 3, j]
    for i in range(6):
        for j in range(3):
            P[i, j] += dt * P[i, j + 3]
    for i in range(3):
        P[i, i] += q_dt


@kernel
def update(x, P, r_V, C, measured, cfg, scratch):
    """Use one sighting, in place (thesis (3.11)-(3.13)); returns the NIS.

    Args:
        x, P: state (6,) and covariance (6, 6).
        r_V: position of the camera in N, m, (3,).
        C: camera attitude C_CN, (3, 3).
        measured: (y, z) or (theta, phi), (2,).
        cfg: settings as of `sighting`.
        scratch: a SCRATCH record.
    """
    G, H, r = scratch["G"], scratch["H"], scratch["r"]
    for i in range(3):
        r[i] = x[i] - r_V[i]
    compare(r, C, measured, cfg, scratch)
    for i in range(2):
        for j in range(3):
            H[i, j], H[i, j + 3] = G[i, j], 0.0
    e, variance = scratch["e"], scratch["variance"]
    return update_sequential(x, P, H, e, variance, 0.0, scratch["B"], scratch["S"])
