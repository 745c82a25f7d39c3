"""A bank of inverse-range filters of a stationary object, one for each stretch of the prior range.

Each is an `inverse_range` EKF from a prior that is narrow enough for it. The weights follow from
how well each predicted its sightings (Alspach and Sorenson 1972), with the noise that belongs to
its own range: where noise fades with range, its size tells the range too, which no single Gaussian
takes up.
"""

from __future__ import annotations

import math

from visenvs.core.compile import kernel
from visenvs.core.frames import TINY
from visenvs.estimation import inverse_range, sighting

CELLS = 12
REACH = 3.0  # standard deviations of the prior 1/r that the cells cover, within the bounds of rho
NEGLIGIBLE = 1e-7  # a cell of less weight is left out for good


@kernel
def begin(x, P, r0, weights, xs, Ps):
    """Divide the prior that `inverse_range.begin` wrote (x, P, r0) among the cells.

    Args:
        weights: written, (cells,), of sum 1.
        xs, Ps: states, (cells, 3), and covariances, (cells, 3, 3), written.
    """
    deviation, total = math.sqrt(P[2, 2]), 0.0
    low = max(x[2] - REACH * deviation, inverse_range.LEAST / r0)
    width = (min(x[2] + REACH * deviation, inverse_range.MOST / r0) - low) / weights.shape[0]
    for k in range(weights.shape[0]):
        rho = low + (k + 0.5) * width
        weights[k] = math.exp(-0.5 * ((rho - x[2]) / deviation) ** 2)
        total += weights[k]
        for i in range(3):
            xs[k, i] = x[i]
            for j in range(3):
                Ps[k, i, j] = P[i, j]
        xs[k, 2], Ps[k, 2, 2] = rho, width * width / 12.0
    for k in range(weights.shape[0]):
        weights[k] /= total


@kernel
def update(weights, xs, Ps, anchor, r0, r_V, C, measured, cfg, scratch):
    """Use one sighting in every cell, in place; returns the mean NIS of the cells by weight.

    A cell's weight is multiplied by exp(- NIS / 2) / sqrt(det S).

    Args: as of `inverse_range.update_unscented` and `begin`.
    """
    r, J, S, nis, best = scratch["r"], scratch["J"], scratch["S"], 0.0, -math.inf
    for k in range(weights.shape[0]):
        if weights[k] > 0.0:
            inverse_range.position(xs[k], anchor, r_V, scratch["A"], r, J)
            value = sighting.update(xs[k], Ps[k], r, J, C, measured, cfg, scratch)
            inverse_range.keep_in_bounds(xs[k], r0)
            nis += weights[k] * value
            weights[k] = math.log(weights[k] * math.sqrt(S[0] * S[1])) - 0.5 * value
            best = max(best, weights[k])
        else:
            weights[k] = -math.inf
    normalise(weights, best)
    return nis


@kernel
def normalise(weights, best):
    """Turn logarithms of weights into weights of sum 1, the negligible ones into zero, in place."""
    total = 0.0
    for k in range(weights.shape[0]):
        weights[k] = math.exp(weights[k] - best)
        weights[k] = weights[k] if weights[k] > NEGLIGIBLE else 0.0
        total += weights[k]
    for k in range(weights.shape[0]):
        weights[k] /= total


@kernel
def moments(weights, xs, Ps, anchor, r_V, r, cov, scratch):
    """Write the relative position r (m, N, (3,)) and the mean square error about it, m^2, (3, 3).

    r points in the mean direction, at the inverse of the mean of 1/|r_k|: what a sphere looks like
    from here goes by 1/r, and a mean of positions is drawn out by the far ones.
    cov = sum of w (J P J' + (r_k - r) (r_k - r)'), to first order in each cell.
    """
    at, J, u, inverse = scratch["r"], scratch["J"], scratch["u"], 0.0
    u[:] = 0.0
    for k in range(weights.shape[0]):
        if weights[k] > 0.0:
            inverse_range.position(xs[k], anchor, r_V, scratch["A"], at, J)
            near = 1.0 / max(math.sqrt(at[0] * at[0] + at[1] * at[1] + at[2] * at[2]), TINY)
            inverse += weights[k] * near
            for i in range(3):
                u[i] += weights[k] * near * at[i]
    length = inverse * max(math.sqrt(u[0] * u[0] + u[1] * u[1] + u[2] * u[2]), TINY)
    for i in range(3):
        r[i] = u[i] / length
    cov[:] = 0.0
    for k in range(weights.shape[0]):
        if weights[k] > 0.0:
            inverse_range.position(xs[k], anchor, r_V, scratch["A"], at, J)
            sighting.spread(Ps[k], J, scratch["W"], scratch["D"])
            for i in range(3):
                for j in range(3):
                    error = scratch["D"][i, j] + (at[i] - r[i]) * (at[j] - r[j])
                    cov[i, j] += weights[k] * error
