"""Filters of a stationary target in a plane, seen by a camera that looks along x (thesis 4.4).

State: r_TV_N = (X, Y), the target's position relative to the vehicle, m, shape (2,), covariance
(2, 2). An image gives z = (Y + nu) / X with nu of variance r = sigma_range^2 + (sigma_angle X)^2.
The motion is `stationary.predict`.
"""

from __future__ import annotations

import math

import numpy as np

from visenvs.core.compile import kernel
from visenvs.core.pinhole import pixel_variance
from visenvs.estimation.ekf import update_scalar, update_sequential

SCRATCH = np.dtype(
    [
        *((name, "f8", (2, 2)) for name in ("H", "B")),
        *((name, "f8", (2,)) for name in ("residual", "variance", "work")),
    ]
)


@kernel
def begin(rhat, P, z, cfg):
    """Start at the told range in the direction of the first image, with the covariance that it has.

    X is N(prior_range, prior_deviation^2), and Y = z X - nu: P = s^2 [1 z; z z^2] + diag(0, r).

    Args:
        rhat, P: written, (2,), m, and (2, 2), m^2.
        z: the first image point.
        cfg: record with prior_range (m), prior_deviation (m), sigma_range (m), sigma_angle.
    """
    X, s2 = cfg["prior_range"], cfg["prior_deviation"] ** 2
    rhat[0], rhat[1] = X, z * X
    P[0, 0] = s2
    P[0, 1] = P[1, 0] = s2 * z
    P[1, 1] = s2 * z * z + X * X * pixel_variance(X, cfg["sigma_range"], cfg["sigma_angle"])


@kernel
def begin_thesis(rhat, P, z, cfg):
    """Start as printed in (4.69): P = s^2 diag(1, z^2), which knows Y too well and uncorrelated."""
    begin(rhat, P, z, cfg)
    P[0, 1] = P[1, 0] = 0.0
    P[1, 1] = P[0, 0] * z * z


@kernel
def update_thesis(rhat, P, z, cfg, scratch):
    """EKF update with h = Y / X linearised at the prediction, in place; returns the innovation.

    An estimate nearer than the least range counts as one at the least range. An innovation beyond
    `gate` standard deviations is left out (0 for no gate).

    Args:
        cfg: record with min_range (m), sigma_range (m), sigma_angle, gate.
        scratch: a SCRATCH record.
    """
    X = max(rhat[0], cfg["min_range"])
    t = rhat[1] / X
    H, R = scratch["H"], pixel_variance(X, cfg["sigma_range"], cfg["sigma_angle"])
    H[0, 0], H[0, 1] = -t / X, 1.0 / X
    if (z - t) ** 2 <= limit(P, H[0, 0], H[0, 1], R, cfg["gate"]):
        update_scalar(rhat, P, H, 0, z - t, R, scratch["work"])
    return z - t


@kernel
def update(rhat, P, z, cfg, scratch):
    """Use one image through the density of z itself, in place; returns the innovation.

    For the z that came, z X - Y = nu is linear in the state, and nu is no larger where the target
    is nearer than believed: an over-estimated range, fatal to h = Y / X with its noise r / X^2 at
    the estimate, does no harm. The density of z has the factor X beside that of nu; the slope 1/X
    and the curvature -1/X^2 of its logarithm are those of a measurement of X that reads 2 X with
    the variance X^2. It takes back the bias of a row that contains the noisy z; together they tell
    range from the size of the noise, 2 / X^2 an image. Only a part `share` of the noise variance
    grows as 1 / X^2; with 0 this is the update with h.

    Args: as of `update_thesis`.
    """
    X = max(rhat[0], cfg["min_range"])
    t = rhat[1] / X
    r = X * X * pixel_variance(X, cfg["sigma_range"], cfg["sigma_angle"])
    share = cfg["sigma_range"] ** 2 / r
    H, residual, variance = scratch["H"], scratch["residual"], scratch["variance"]
    H[0, 0], H[0, 1] = t + share * (z - t), -1.0
    H[1, 0], H[1, 1] = 1.0, 0.0
    residual[0], residual[1] = X * (t - z), X / share
    variance[0], variance[1] = r, residual[1] ** 2
    if residual[0] ** 2 <= limit(P, H[0, 0], H[0, 1], r, cfg["gate"]):
        update_sequential(rhat, P, H, residual, variance, 0.0, scratch["B"], scratch["work"])
    return z - t


@kernel
def limit(P, h_X, h_Y, variance, gate):
    """Largest square of an innovation h_X dX + h_Y dY + noise that is used."""
    S = h_X * h_X * P[0, 0] + 2.0 * h_X * h_Y * P[0, 1] + h_Y * h_Y * P[1, 1] + variance
    return gate * gate * S if gate > 0.0 else math.inf
