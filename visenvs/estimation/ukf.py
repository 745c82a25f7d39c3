"""The unscented Kalman filter, written out for small states: one measured angle at a time.

2 n + 1 points stand for a Gaussian: its mean, and two points along each column of its Cholesky
factor (Julier and Uhlmann 2004). `spread` is n + kappa: n gives the centre no weight, which is the
cubature filter (Arasaratnam and Haykin 2009). Prediction through a linear model needs no points.
"""

from __future__ import annotations

import math

from visenvs.core.compile import kernel
from visenvs.core.frames import wrap_angle


@kernel
def sigma_points(x, factor, spread, points):
    """Write the mean and x +- sqrt(spread) times each column of the Cholesky factor.

    Args:
        x: mean, shape (n,).
        factor: packed lower Cholesky factor of the covariance, shape (n (n + 1) / 2,).
        spread: n + kappa, > 0. Below n the weight of the centre, 1 - n / spread, is negative: -2
            for the n = 9 and 3 of the UKF paper.
        points: shape (2 n + 1, n).
    """
    n = x.shape[0]
    for j in range(2 * n + 1):
        for a in range(n):
            points[j, a] = x[a]
    k = 0
    for a in range(n):
        for j in range(a + 1):
            shift = math.sqrt(spread) * factor[k]
            points[1 + j, a] += shift
            points[1 + n + j, a] -= shift
            k += 1


@kernel
def update_angle(x, P, points, spread, angles, measured, variance, cross):
    """Update with one angle, in place; returns the innovation (rad) and its variance S (rad^2).

    Differences of angles are wrapped about that of the centre, so that no seam is felt while the
    points span less than half a turn to either side. P - C C' / S stays positive semidefinite where
    the curvature moves the mean angle off the centre's by no more than the noise's standard
    deviation; with a spread of n or more always, a Schur complement of a covariance of points.

    Args:
        x, P: state (n,) and covariance (n, n).
        points: of `sigma_points`, shape (2 n + 1, n).
        spread: as given there.
        angles: predicted angle of every point, rad, shape (2 n + 1,); left as deviations from
            their mean.
        measured: rad.
        variance: of its noise, rad^2.
        cross: scratch, (n,); holds the covariance C of state and angle on return.
    """
    n = x.shape[0]
    weight, centre = 0.5 / spread, 1.0 - n / spread
    middle, mean = angles[0], 0.0
    for j in range(2 * n + 1):
        angles[j] = wrap_angle(angles[j] - middle)
        mean += weight * angles[j]
    for j in range(2 * n + 1):
        angles[j] -= mean
    S = variance + centre * angles[0] ** 2
    for j in range(1, 2 * n + 1):
        S += weight * angles[j] ** 2
    innovation = wrap_angle(measured - middle - mean)
    for a in range(n):
        cross[a] = 0.0
        for j in range(1, 2 * n + 1):
            cross[a] += weight * (points[j, a] - points[0, a]) * angles[j]
    for a in range(n):
        gain = cross[a] / S
        x[a] += gain * innovation
        for b in range(a + 1):
            P[a, b] -= gain * cross[b]
            P[b, a] = P[a, b]
    return innovation, S


@kernel
def recombine(points, spread, Q, x, P):
    """Mean and covariance of points that have been moved, and noise Q added (prediction).

    The sum is a covariance for certain only with a spread of n or more.

    Args:
        points: of `sigma_points`, each moved, shape (2 n + 1, n).
        spread: as given there.
        Q: noise covariance, (n, n).
        x, P: written, (n,) and (n, n).
    """
    n = x.shape[0]
    weight, centre = 0.5 / spread, 1.0 - n / spread
    for a in range(n):
        total = centre * points[0, a]
        for j in range(1, 2 * n + 1):
            total += weight * points[j, a]
        x[a] = total
    for a in range(n):
        for b in range(a + 1):
            total = centre * (points[0, a] - x[a]) * (points[0, b] - x[b])
            for j in range(1, 2 * n + 1):
                total += weight * (points[j, a] - x[a]) * (points[j, b] - x[b])
            P[a, b] = P[b, a] = total + 0.5 * (Q[a, b] + Q[b, a])
