"""One sighting of one stationary object, for filters of any three coordinates of its position.

A filter gives its relative position r and the slope J = dr/dx; what is left of the EKF is here.
Settings: a record with what `sight.noise_variance` needs, min_range (m), and assumed_noise, the
standard deviation of the noise that filters assume over the true one.
"""

from __future__ import annotations

import numpy as np

from visenvs.core.compile import kernel
from visenvs.core.sight import differ, noise_variance, see, slope
from visenvs.estimation.ekf import factorise, update_sequential, whiten

LEAST_VARIANCE = 1e-10  # of a measured number: without noise the linearisation errs for ever

SCRATCH = np.dtype(
    [
        *((name, "f8", (2,)) for name in ("e", "variance", "S")),
        *((name, "f8", (3,)) for name in ("r", "u")),
        *((name, "f8", (2, 3)) for name in ("G", "H", "B")),
        *((name, "f8", (3, 3)) for name in ("J", "A", "D", "W")),
        ("cross", "f8", (3, 2)),
        ("factor", "f8", (6,)),
        ("points", "f8", (7, 3)),
        ("seen", "f8", (7, 2)),
    ]
)


@kernel
def assumed_variance(distance, cfg):
    """Variance of a measured number that the filters assume, at least LEAST_VARIANCE."""
    return max(cfg["assumed_noise"] ** 2 * noise_variance(distance, cfg), LEAST_VARIANCE)


@kernel
def compare(r, C, measured, cfg, scratch):
    """Compare a sighting with r: fills scratch G (slope by r, (2, 3)), e (innovation), variance."""
    sensor, e = cfg["sensor"], scratch["e"]
    first, second, distance = see(sensor, C, r, cfg["min_range"])
    slope(sensor, C, r, cfg["min_range"], scratch["G"])
    e[0], e[1] = differ(sensor, measured[0], first), differ(sensor, measured[1], second)
    scratch["variance"][0] = scratch["variance"][1] = assumed_variance(distance, cfg)


@kernel
def linearise(r, J, C, measured, cfg, scratch):
    """Linearise a sighting at (r, J): `compare`, and its slope by the state in scratch H (2, 3)."""
    compare(r, C, measured, cfg, scratch)
    G, H = scratch["G"], scratch["H"]
    for i in range(2):
        for j in range(3):
            H[i, j] = G[i, 0] * J[0, j] + G[i, 1] * J[1, j] + G[i, 2] * J[2, j]


@kernel
def update(x, P, r, J, C, measured, cfg, scratch):
    """Use one sighting linearised at (r, J), in place (thesis (3.11)-(3.13)); returns the NIS.

    Args:
        x, P: state (3,) and covariance (3, 3).
        r, J: relative position in N, m, (3,), and its derivative by the state, (3, 3).
        C: camera attitude C_CN, (3, 3).
        measured: (y, z) or (theta, phi), (2,).
        scratch: a SCRATCH record.
    """
    linearise(r, J, C, measured, cfg, scratch)
    e, variance, H = scratch["e"], scratch["variance"], scratch["H"]
    return update_sequential(x, P, H, e, variance, 0.0, scratch["B"], scratch["S"])


@kernel
def spread(P, J, W, cov):
    """Write cov = J P J', m^2, (3, 3); `W` is scratch of that shape."""
    for i in range(3):
        for j in range(3):
            W[i, j] = J[i, 0] * P[0, j] + J[i, 1] * P[1, j] + J[i, 2] * P[2, j]
    for i in range(3):
        for j in range(i + 1):
            cov[i, j] = W[i, 0] * J[j, 0] + W[i, 1] * J[j, 1] + W[i, 2] * J[j, 2]
            cov[j, i] = cov[i, j]


@kernel
def expect(r, cov, C, cfg, scratch, predicted, factor):
    """Predict a sighting: the measurement, and the packed Cholesky factor of its covariance S.

    S = H cov H' + R (thesis (3.5)), by the chain rule the same in any coordinates.

    Args:
        r, cov: relative position in N, m, (3,), and its covariance, m^2, (3, 3).
        predicted: written, (2,).
        factor: written, (3,).

    Returns:
        The distance that the noise depends on, m.
    """
    sensor, G, B = cfg["sensor"], scratch["G"], scratch["B"]
    predicted[0], predicted[1], distance = see(sensor, C, r, cfg["min_range"])
    slope(sensor, C, r, cfg["min_range"], G)
    R = assumed_variance(distance, cfg)
    for i in range(2):
        for j in range(3):
            B[i, j] = G[i, 0] * cov[0, j] + G[i, 1] * cov[1, j] + G[i, 2] * cov[2, j]
    k = 0
    for i in range(2):
        for j in range(i + 1):
            factor[k] = B[i, 0] * G[j, 0] + B[i, 1] * G[j, 1] + B[i, 2] * G[j, 2]
            factor[k] += R if i == j else 0.0
            k += 1
    factorise(factor, 2)
    return distance


@kernel
def ztest(measured, predicted, factor, cfg, e):
    """The z-test value e' S^-1 e of a sighting and a track (thesis (3.5)); `e` is scratch, (2,)."""
    for i in range(2):
        e[i] = differ(cfg["sensor"], measured[i], predicted[i])
    return whiten(factor, e, e)
