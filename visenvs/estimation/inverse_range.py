"""Filters of a stationary object by the angles of its first sight and the inverse of its range.

State: (theta0, phi0, rho), the direction in N (rad, `sight.turn`) and the inverse range (1/m) from
where the camera was when it first saw the object, shape (3,). A constant, so there is no process
noise, and what a sighting tells is nearly linear in it: both where the range is hardly known and
where it is (Civera, Davison and Montiel 2008).
"""

from __future__ import annotations

from visenvs.core.compile import kernel
from visenvs.core.frames import direction, identity
from visenvs.core.sight import ANGLES, differ, ray, see, slope, to_angles, turn
from visenvs.estimation.ekf import factorise, pack_lower, whiten
from visenvs.estimation.sighting import assumed_variance
from visenvs.estimation.ukf import sigma_points

# bounds of rho times the prior range: none is believed nearer than half of it or beyond 3.3 of it
LEAST, MOST = 0.3, 2.0


@kernel
def begin(x, P, C, measured, prior_range, prior_deviation, cfg, scratch):
    """Start with the direction of the first sighting and 1/r ~ N(1/r0, (deviation / r0^2)^2).

    Args: as of `inertial.begin`; the object must not be straight above or below. Where the camera
    is now is the anchor, which the caller keeps.

    Returns:
        The prior range r0, m; for an image point the prior depth times |(1, y, z)|.
    """
    sensor, D, A, H = cfg["sensor"], scratch["D"], scratch["A"], scratch["H"]
    ray(sensor, C, measured[0], measured[1], A, D)
    x[0], x[1], length = to_angles(D[0, 0], D[1, 0], D[2, 0])
    r0 = prior_range * length
    x[2] = 1.0 / r0
    for i in range(3):
        scratch["u"][i] = D[i, 0]
    identity(A)
    slope(ANGLES, A, scratch["u"], 1e-9, H)  # of the angles in N by d
    R = assumed_variance(prior_range, cfg)
    for i in range(2):
        for j in range(i + 1):
            P[i, j] = 0.0
            for k in range(1, 3):
                one = H[i, 0] * D[0, k] + H[i, 1] * D[1, k] + H[i, 2] * D[2, k]
                other = H[j, 0] * D[0, k] + H[j, 1] * D[1, k] + H[j, 2] * D[2, k]
                P[i, j] += R * one * other
            P[j, i] = P[i, j]
        P[i, 2] = P[2, i] = 0.0
    P[2, 2] = (prior_deviation * length / (r0 * r0)) ** 2
    return r0


@kernel
def position(x, anchor, r_V, A, r, J):
    """Write the relative position r = d / rho - (r_V - anchor), m, (3,), and J = dr/dx, (3, 3).

    Args:
        anchor: where the camera was at first sight, in N, m, (3,).
        A: scratch, (3, 3).
    """
    turn(x[0], x[1], A)
    length = 1.0 / x[2]
    for i in range(3):
        r[i] = length * A[i, 0] - (r_V[i] - anchor[i])
        J[i, 0] = length * A[i, 1]
        J[i, 1] = length * A[i, 2]
        J[i, 2] = -length * length * A[i, 0]


@kernel
def keep_in_bounds(x, r0):
    """Keep rho within LEAST and MOST times the inverse of the prior range r0 (m), in place."""
    x[2] = min(max(x[2], LEAST / r0), MOST / r0)


@kernel
def update_unscented(x, P, anchor, r_V, C, measured, cfg, scratch):
    """Use one sighting by six symmetric sigma points (cubature), in place; returns the NIS.

    Sight is the same along a ray, so that points go by rho r = d - rho (r_V - anchor) and none
    needs a positive rho. The noise is that at the mean.

    Args:
        x, P: state (3,) and covariance (3, 3).
        anchor, r_V: where the camera was at first sight and is now, in N, m, (3,).
        C, measured, cfg, scratch: as of `sighting.update`.
    """
    factor, points, seen, q = scratch["factor"], scratch["points"], scratch["seen"], scratch["u"]
    pack_lower(P, factor)
    factorise(factor, 3)
    sigma_points(x, factor, 3.0, points)
    distance = 0.0
    for k in range(7):
        rho = points[k, 2]
        q[0], q[1], q[2] = direction(points[k, 0], -points[k, 1])
        for i in range(3):
            q[i] -= rho * (r_V[i] - anchor[i])
        nearest = cfg["min_range"] * abs(rho)
        seen[k, 0], seen[k, 1], scaled = see(cfg["sensor"], C, q, nearest)
        if k == 0:
            distance = scaled / rho
    return update_points(x, P, measured, assumed_variance(distance, cfg), cfg["sensor"], scratch)


@kernel
def update_points(x, P, measured, variance, sensor, scratch):
    """Update with a pair of numbers of the same noise from what six sigma points see; the NIS.

    scratch["points"] (7, 3) has the mean first, of no weight; scratch["seen"] (7, 2) what is seen
    from each. P - B B' with B = cov(x, z) L'^-1, L L' = S.
    """
    points, seen, e, B = scratch["points"], scratch["seen"], scratch["e"], scratch["cross"]
    factor = scratch["factor"]
    for i in range(2):
        middle, mean = seen[0, i], 0.0
        for k in range(1, 7):
            seen[k, i] = differ(sensor, seen[k, i], middle)
            mean += seen[k, i] / 6.0
        for k in range(1, 7):
            seen[k, i] -= mean
        e[i] = differ(sensor, measured[i], middle + mean)
    factor[0] = factor[2] = variance
    factor[1] = 0.0
    for k in range(1, 7):
        factor[0] += seen[k, 0] * seen[k, 0] / 6.0
        factor[1] += seen[k, 0] * seen[k, 1] / 6.0
        factor[2] += seen[k, 1] * seen[k, 1] / 6.0
    factorise(factor, 2)
    nis = whiten(factor, e, e)
    for a in range(3):
        for i in range(2):
            B[a, i] = 0.0
            for k in range(1, 7):
                B[a, i] += (points[k, a] - points[0, a]) * seen[k, i] / 6.0
        whiten(factor, B[a], B[a])
        x[a] += B[a, 0] * e[0] + B[a, 1] * e[1]
        for b in range(a + 1):
            P[a, b] -= B[a, 0] * B[b, 0] + B[a, 1] * B[b, 1]
            P[b, a] = P[a, b]
    return nis
