"""The exact posterior of a stationary target in a plane, seen by a camera that looks along x.

Given the target's abscissa x, the image point z = (Y + nu) / X is a linear measurement of its
ordinate y: z X = Y + nu. So a grid over x with a Kalman filter of y at every point is the whole
posterior (Rao and Blackwell), with the density X N(z X; Y, r) of z for weight: noise that grows as
the target comes near tells its range. The target does not move, so the posterior only ever gets
narrower, and the grid follows it.

Positions are absolute, in N, m. With FEWEST points across the 12.6 standard deviations between log
weights of -20 the moments are within 5e-5 of a standard deviation of the exact ones, and within
1e-2 in the last steps before the target, where the minimum range cuts the density off between two
points.
"""

from __future__ import annotations

import math

import numpy as np

from visenvs.core.compile import kernel
from visenvs.core.pinhole import pixel_variance
from visenvs.sensors.camera import in_view

POINTS = 64
FEWEST = 24  # points that must carry the posterior; fewer, and the grid closes in on them
DEEP = 20.0  # log weights so far below the greatest are not carried
NEVER = -1e30  # log weight of what cannot be
ZOOMS = 12
CUT = 3.0  # standard deviations at which the prior of the abscissa is cut off

GRID = np.dtype(
    [
        ("low", "f8"),  # first abscissa, m
        ("step", "f8"),  # m
        ("log_weight", "f8", (POINTS,)),
        ("mean", "f8", (POINTS,)),  # of the ordinate at each abscissa, m
        ("variance", "f8", (POINTS,)),  # m^2
    ]
)
SCRATCH = np.dtype([("before", GRID), ("after", "f8", (POINTS,))])


@kernel
def begin(grid, z, r_V, cfg):
    """Spread the prior of the abscissa, and the ordinate along the direction of the first image.

    What the first image says of the range is not used: the direction had no prior.

    Args:
        grid: a GRID record, written.
        z: the first image point. r_V: own position in N, m, (2,).
        cfg: record with prior_range (m), prior_deviation (m), sigma_range (m), sigma_angle.
    """
    grid["low"] = r_V[0] + cfg["prior_range"] - CUT * cfg["prior_deviation"]
    grid["step"] = 2.0 * CUT * cfg["prior_deviation"] / (POINTS - 1)
    for i in range(POINTS):
        X = grid["low"] + i * grid["step"] - r_V[0]
        grid["log_weight"][i] = -0.5 * ((X - cfg["prior_range"]) / cfg["prior_deviation"]) ** 2
        grid["mean"][i] = r_V[1] + z * X
        grid["variance"][i] = X * X * pixel_variance(X, cfg["sigma_range"], cfg["sigma_angle"])


@kernel
def update(grid, seen, z, r_V, cfg, scratch):
    """Use an image, or its absence, in place.

    Args:
        seen: whether there is an image point z. r_V: own position in N, m, (2,).
        cfg: record with min_range (m), half_width, p_detect, sigma_range (m), sigma_angle.
        scratch: a SCRATCH record.
    """
    after = scratch["after"]
    for _ in range(ZOOMS):
        best = NEVER
        for i in range(POINTS):
            after[i] = grid["log_weight"][i] + log_likelihood(grid, i, seen, z, r_V, cfg)
            best = max(best, after[i])
        if not best > 0.5 * NEVER:
            return  # nothing that the filter holds possible explains it
        first, last = support(after, best)
        if last - first + 1 >= FEWEST:
            break
        close_in(grid, first, last, scratch["before"])
    for i in range(POINTS):
        grid["log_weight"][i] = max(after[i] - best, NEVER)
        if seen:
            correct(grid, i, z, r_V, cfg)


@kernel
def log_likelihood(grid, i, seen, z, r_V, cfg):
    """Of what came from the camera, if the target were at point i; constants left out."""
    X = grid["low"] + i * grid["step"] - r_V[0]
    Y = grid["mean"][i] - r_V[1]
    visible = X > 0.0 and in_view(X, Y / X, 0.0, cfg["min_range"], cfg["half_width"])
    if not seen:
        missed = 1.0 - cfg["p_detect"] if visible else 1.0
        return math.log(missed) if missed > 0.0 else NEVER
    if not X > cfg["min_range"]:
        return NEVER
    r = X * X * pixel_variance(X, cfg["sigma_range"], cfg["sigma_angle"])
    S = grid["variance"][i] + r
    return math.log(X) - 0.5 * math.log(S) - 0.5 * (z * X - Y) ** 2 / S


@kernel
def correct(grid, i, z, r_V, cfg):
    """Kalman update of the ordinate at point i with z X = Y + nu."""
    X = grid["low"] + i * grid["step"] - r_V[0]
    r = X * X * pixel_variance(X, cfg["sigma_range"], cfg["sigma_angle"])
    gain = grid["variance"][i] / (grid["variance"][i] + r)
    grid["mean"][i] += gain * (z * X + r_V[1] - grid["mean"][i])
    grid["variance"][i] *= 1.0 - gain


@kernel
def support(log_weight, best):
    """First and last point whose weight counts."""
    first, last = POINTS, 0
    for i in range(POINTS):
        if log_weight[i] > best - DEEP:
            first = min(first, i)
            last = i
    return first, last


@kernel
def close_in(grid, first, last, before):
    """Lay the grid over the points from `first` to `last` and one more to each side."""
    before["log_weight"][:] = grid["log_weight"]
    before["mean"][:] = grid["mean"]
    before["variance"][:] = grid["variance"]
    left, right = max(first - 1, 0), min(last + 1, POINTS - 1)
    finer = (right - left) / (POINTS - 1)
    for i in range(POINTS):
        at = left + i * finer
        grid["log_weight"][i] = between(before["log_weight"], at)
        grid["mean"][i] = between(before["mean"], at)
        grid["variance"][i] = between(before["variance"], at)
    grid["low"] += left * grid["step"]
    grid["step"] *= finer


@kernel
def between(values, at):
    """The cubic through the four values about a fractional index; NEVER next to a NEVER."""
    i = min(max(int(at) - 1, 0), POINTS - 4)
    t = at - i
    a, b, c, d = values[i], values[i + 1], values[i + 2], values[i + 3]
    if min(min(a, b), min(c, d)) < 0.5 * NEVER:
        j = min(int(at), POINTS - 2)
        low, high = values[j], values[j + 1]
        return NEVER if min(low, high) < 0.5 * NEVER else low + (at - j) * (high - low)
    return (
        -a * (t - 1.0) * (t - 2.0) * (t - 3.0) / 6.0
        + b * t * (t - 2.0) * (t - 3.0) / 2.0
        - c * t * (t - 1.0) * (t - 3.0) / 2.0
        + d * t * (t - 1.0) * (t - 2.0) / 6.0
    )


@kernel
def moments(grid, r_V, rhat, P):
    """Write mean (2,), m, and covariance (2, 2), m^2, of the position relative to `r_V`."""
    weight, mean_x, mean_y, best = 0.0, 0.0, 0.0, NEVER
    for i in range(POINTS):
        best = max(best, grid["log_weight"][i])
    for i in range(POINTS):
        w = share(grid, i, best)
        weight += w
        mean_x += w * i
        mean_y += w * grid["mean"][i]
    mean_x /= weight
    mean_y /= weight
    xx, xy, yy = 0.0, 0.0, 0.0
    for i in range(POINTS):
        w = share(grid, i, best) / weight
        x, y = grid["step"] * (i - mean_x), grid["mean"][i] - mean_y
        xx += w * x * x
        xy += w * x * y
        yy += w * (y * y + grid["variance"][i])
    rhat[0] = grid["low"] + mean_x * grid["step"] - r_V[0]
    rhat[1] = mean_y - r_V[1]
    P[0, 0], P[0, 1], P[1, 0], P[1, 1] = xx, xy, xy, yy


@kernel
def share(grid, i, best):
    """Weight of point i in Gregory's rule of fourth order, up to a factor."""
    end = min(i, POINTS - 1 - i)
    rule = 3.0 / 8.0 if end == 0 else 7.0 / 6.0 if end == 1 else 23.0 / 24.0 if end == 2 else 1.0
    return rule * math.exp(grid["log_weight"][i] - best)
