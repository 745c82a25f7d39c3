"""What figures 18 and 19 of the thesis share: 16 x 16 points of grid terrain, seen for 200 s.

The camera circles at 100 ft and 20 ft/s, 6.4 times, 120 ft above the lowest ground, and looks
straight down; an image every 0.1 s. Points are 20 ft apart, heights are drawn from 0 to 25 ft, and
edges between neighbours are seen as segments. A point is where up to four lines end: the mean of
their ends, weighted with the inverses of their covariances.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from visenvs.core.units import FOOT

from ..rollout import PUBLIC_SEEDS
from ._mapping import circle, down, fly, settings, start, work

POINTS, SPACING = 16, 20 * FOOT
PERIOD, SECONDS, RADIUS, ALTITUDE, SPEED = 0.1, 200, 100 * FOOT, 120 * FOOT, 20 * FOOT
MOMENTS = (0, 5, 10, 15, 20, 25, 50, 75, 100, 125, 150, 175, 200)  # s
MOST = 10  # seeds: each takes seconds
TINY = 1e-12  # m^2, keeps a covariance from being singular


@cache
def moments(estimator: str, episodes: int) -> list[NDArray[Any]]:
    """The rooms of all seeds at every moment."""
    config = settings("terrain", estimator, POINTS)
    seeds = np.array(PUBLIC_SEEDS[: min(episodes, MOST)], np.uint64)
    rooms, out, done = start(config, seeds), [], 0
    for moment in MOMENTS:
        images = max(round(moment / PERIOD), 1)
        angles = np.arange(done, images) * (SPEED * PERIOD / RADIUS)
        path = circle(RADIUS, ALTITUDE, np.asarray(angles, np.float64))
        fly(rooms, seeds, path, down(path), done, config, work())
        out.append(rooms.copy())
        done = images
    return out


def true_points(room: np.void) -> NDArray[np.float64]:
    """The grid's points, m, N, (256, 3), row by row from the south-west."""
    ends = room["edge"][: int(room["edges"])].reshape(-1, 3)
    place = np.rint(ends[:, :2] / SPACING + 0.5 * (POINTS - 1)).astype(int)
    out = np.zeros((POINTS * POINTS, 3))
    out[place[:, 0] * POINTS + place[:, 1]] = ends
    return out


def point_errors(room: np.void) -> NDArray[np.float64]:
    """Error of every point, ft, (256,); NaN for those that no image has shown."""
    truth, m = true_points(room), room["map"]
    weights, sums = np.zeros((len(truth), 3, 3)), np.zeros((len(truth), 3))
    for j in np.flatnonzero((m["alive"] > 0) & (m["owner"] >= 0)):
        x, P, closed = m["x"][j].reshape(2, 3), m["P"][j], m["closed"][j]
        edge = room["edge"][int(m["owner"][j])].reshape(2, 3)
        straight = np.sum((x - edge) ** 2) <= np.sum((x - edge[::-1]) ** 2)
        place = np.rint(edge[:, :2] / SPACING + 0.5 * (POINTS - 1)).astype(int)
        for i in range(2):
            if closed[i]:
                row, column = place[i if straight else 1 - i]
                k, block = row * POINTS + column, slice(3 * i, 3 * i + 3)
                inverse = np.linalg.inv(P[block, block] + TINY * np.eye(3))
                weights[k] += inverse
                sums[k] += inverse @ x[i]
    seen = weights[:, 0, 0] > 0.0
    out = np.full(len(truth), np.nan)
    found = np.linalg.solve(weights[seen], sums[seen][..., None])[..., 0]
    out[seen] = np.linalg.norm(found - truth[seen], axis=1) / FOOT
    return out
