"""EKF of a stationary target seen by a camera: Cartesian relative position (thesis (3.8)-(3.15)).

State: r_TV_N, the target's position relative to the vehicle in N, m, shape (3,), covariance (3, 3).
"""

from __future__ import annotations

import numpy as np

from visenvs.core.compile import kernel
from visenvs.core.pinhole import jacobian, pixel_variance, project
from visenvs.estimation.ekf import update_sequential

SCRATCH = np.dtype(
    [
        ("H", "f8", (2, 3)),
        ("B", "f8", (2, 3)),
        *((name, "f8", (2,)) for name in ("e", "variance", "S")),
    ]
)


@kernel
def predict(rhat, P, moved, q_dt):
    """Shift the estimate by the vehicle's known displacement (3.9) and add process noise (3.10).

    Args:
        rhat, P: estimate (D,), m, and covariance (D, D), m^2; changed in place.
        moved: displacement of the vehicle during the step in N, m, shape (D,).
        q_dt: process noise variance of the step, m^2.
    """
    for i in range(rhat.shape[0]):
        rhat[i] -= moved[i]
        P[i, i] += q_dt


@kernel
def update(rhat, P, C, y, z, settings, innovation, scratch):
    """Use one image point (y, z), in place (3.11)-(3.14); returns the NIS.

    An estimate nearer than the minimum range along the optical axis, or behind the camera, is
    linearised as if it lay at the minimum range. A measurement that fails the gate is left out.

    Args:
        C: camera attitude C_CN, (3, 3).
        settings: record with sigma_range (m), sigma_angle, min_range (m), gate (standard
            deviations).
        innovation: measured minus predicted image point, written here, shape (2,).
        scratch: a SCRATCH record.
    """
    X, y_hat, z_hat = project(C, rhat, settings["min_range"])
    innovation[0] = y - y_hat
    innovation[1] = z - z_hat
    H, e, variance = scratch["H"], scratch["e"], scratch["variance"]
    jacobian(C, X, y_hat, z_hat, H)
    e[0], e[1] = innovation[0], innovation[1]
    variance[0] = variance[1] = pixel_variance(X, settings["sigma_range"], settings["sigma_angle"])
    B, S = scratch["B"], scratch["S"]
    return update_sequential(rhat, P, H, e, variance, settings["gate"], B, S)
