"""Filter of a stationary object in Cartesian coordinates: state r_O_N, its position in N, m.

Thesis (3.5)-(3.15); one update for image points and for angles (`sighting.update`).
"""

from __future__ import annotations

from visenvs.core.compile import kernel
from visenvs.core.sight import ray
from visenvs.core.units import FOOT
from visenvs.estimation.sighting import assumed_variance


@kernel
def begin(x, P, r_V, C, measured, prior_range, prior_deviation, cfg, scratch):
    """Start at the prior distance along the first sighting, with the covariance that it has.

    r = distance d(measured): P = s^2 d d' + distance^2 R (d_1 d_1' + d_2 d_2'), with d_i the
    derivatives of d; for an image point the thesis's (3.7), corrected: L_c' (diag(s^2, r0^2 R) +
    the terms z s^2 and z z' s^2) L_c.

    Args:
        x, P: written, (3,), m, and (3, 3), m^2.
        r_V: position of the camera in N, m, (3,).
        C: camera attitude C_CN, (3, 3).
        measured: (y, z) or (theta, phi), (2,).
        prior_range, prior_deviation: depth (image point) or range (angles) and its standard
            deviation s, m.
        cfg, scratch: as in `sighting`.
    """
    D = scratch["D"]
    ray(cfg["sensor"], C, measured[0], measured[1], scratch["A"], D)
    along = prior_deviation * prior_deviation
    across = prior_range * prior_range * assumed_variance(prior_range, cfg)
    for i in range(3):
        x[i] = r_V[i] + prior_range * D[i, 0]
        for j in range(i + 1):
            P[i, j] = along * D[i, 0] * D[j, 0]
            P[i, j] += across * (D[i, 1] * D[j, 1] + D[i, 2] * D[j, 2])
            P[j, i] = P[i, j]


@kernel
def begin_thesis(x, P, r_V, C, measured, prior_range, prior_deviation, cfg, scratch):
    """Start as printed in (3.35): P = L_c' diag(s^2, r0 R, r0 R) L_c, the range r0 in feet.

    It holds in feet only, and knows the lateral position too well by a factor of r0 in variance.
    """
    begin(x, P, r_V, C, measured, prior_range, prior_deviation, cfg, scratch)
    along = prior_deviation * prior_deviation
    across = prior_range * FOOT * assumed_variance(prior_range, cfg)
    for i in range(3):
        for j in range(i + 1):
            P[i, j] = along * C[0, i] * C[0, j]
            P[i, j] += across * (C[1, i] * C[1, j] + C[2, i] * C[2, j])
            P[j, i] = P[i, j]


@kernel
def predict(P, q_dt):
    """Add the process noise variance q_dt (m^2) of a step (3.10); the object stands still (3.8)."""
    for i in range(3):
        P[i, i] += q_dt


@kernel
def position(x, r_V, r, J):
    """Write the relative position r = x - r_V (m, (3,)) and its derivative by the state, (3, 3)."""
    for i in range(3):
        r[i] = x[i] - r_V[i]
        for j in range(3):
            J[i, j] = 1.0 if i == j else 0.0
