"""What stands out in a part of a picture, against a background that is known at its border only."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from visenvs.core.compile import kernel
from visenvs.sensors.images.optics import Image

BORDER = 3  # rows and columns that are background, pixels
SMOOTH = 2  # to each side, of the border's colours, pixels
KEPT = 0.85  # share of the pixels that tells how the background varies
BINS = 3 * 256  # sums of three differences, grey levels
NOISE = 9.0  # added to the variances of the background, grey levels squared
PEAK = 12  # pixels that tell the colour of what stands out


def stand_out(part: Image) -> NDArray[np.float32]:
    """How far every pixel is from the background, standard deviations, (rows, columns).

    The colour of what stands out is the mean of the pixels farthest off by Mahalanobis's distance;
    all pixels are measured along that colour (Fisher's discriminant), so that what stands out in
    other colours counts less and a pixel that is covered by half counts half.

    Args:
        part: RGB, (rows, columns, 3), at least twice BORDER each way.
    """
    rows, columns = part.shape[:2]
    rest = np.zeros((rows, columns, 3), np.float32)
    edge, corner = np.zeros((2, columns + rows, 3)), np.zeros((2, 2, 3))
    subtract_background(part, edge, corner, rest)
    mean, moments = np.zeros(3), np.zeros((3, 3))
    vary(rest, np.zeros(BINS, np.int64), mean, moments)
    covariance = moments - np.outer(mean, mean) + NOISE * np.eye(3)
    white = np.linalg.inv(np.linalg.cholesky(covariance))
    peak = np.zeros((PEAK, 4))
    farthest(rest, mean, white, peak)
    colour = peak[:, :3].sum(axis=0)
    out = np.zeros((rows, columns), np.float32)
    project(rest, mean, white.T @ colour / max(float(np.linalg.norm(colour)), 1e-9), out)
    return out


@kernel
def read_border(part, edge, corner):
    """Write the colours of a picture's border, smoothed along it.

    Args:
        part: RGB, (rows, columns, 3).
        edge: written, (2, columns + rows, 3): above and below every column, then left and right of
            every row.
        corner: written, (2, 2, 3): upper and lower, left and right.
    """
    rows, columns = part.shape[0], part.shape[1]
    for n in range(columns + rows):
        across = n < columns
        middle, last = (n, columns - 1) if across else (n - columns, rows - 1)
        for end in range(2):
            for k in range(3):
                total = 0.0
                for i in range(BORDER):
                    for j in range(middle - SMOOTH, middle + SMOOTH + 1):
                        at = min(max(j, 0), last)
                        if across:
                            total += part[i if end == 0 else rows - 1 - i, at, k]
                        else:
                            total += part[at, i if end == 0 else columns - 1 - i, k]
                edge[end, n, k] = total / (BORDER * (2 * SMOOTH + 1))
    for upper in range(2):
        for left in range(2):
            for k in range(3):
                one = edge[upper, left * (columns - 1), k]
                corner[upper, left, k] = 0.5 * (one + edge[left, columns + upper * (rows - 1), k])


@kernel
def subtract_background(part, edge, corner, rest):
    """Write what is left of a picture without what its border says of the inside.

    Coons's patch: every row is drawn through between its ends, so is every column, and what both
    draw counts once. It follows a horizon.

    Args:
        part: RGB, (rows, columns, 3).
        edge, corner: written, see `read_border`.
        rest: written, (rows, columns, 3).
    """
    rows, columns = part.shape[0], part.shape[1]
    read_border(part, edge, corner)
    for v in range(rows):
        t = v / (rows - 1)
        for u in range(columns):
            s = u / (columns - 1)
            for k in range(3):
                across = (1.0 - s) * edge[0, columns + v, k] + s * edge[1, columns + v, k]
                down = (1.0 - t) * edge[0, u, k] + t * edge[1, u, k]
                upper = (1.0 - s) * corner[0, 0, k] + s * corner[0, 1, k]
                lower = (1.0 - s) * corner[1, 0, k] + s * corner[1, 1, k]
                both = (1.0 - t) * upper + t * lower
                rest[v, u, k] = part[v, u, k] - across - down + both


@kernel
def vary(rest, counts, mean, moments):
    """Write mean (3,) and second moments (3, 3) of the KEPT share with the smallest differences.

    Args:
        rest: colours without the background, (rows, columns, 3).
        counts: scratch of zeros, (BINS,).
        mean, moments: zeros, written.
    """
    rows, columns = rest.shape[0], rest.shape[1]
    for v in range(rows):
        for u in range(columns):
            off = abs(rest[v, u, 0]) + abs(rest[v, u, 1]) + abs(rest[v, u, 2])
            counts[min(int(off), BINS - 1)] += 1
    limit, kept = 0, counts[0]
    while kept < KEPT * rows * columns:
        limit += 1
        kept += counts[limit]
    for v in range(rows):
        for u in range(columns):
            off = abs(rest[v, u, 0]) + abs(rest[v, u, 1]) + abs(rest[v, u, 2])
            if min(int(off), BINS - 1) <= limit:
                for i in range(3):
                    mean[i] += rest[v, u, i] / kept
                    for j in range(3):
                        moments[i, j] += rest[v, u, i] * rest[v, u, j] / kept


@kernel
def farthest(rest, mean, white, peak):
    """Write the whitened colours of the PEAK pixels farthest from the background, and squares.

    Args:
        rest: colours without the background, (rows, columns, 3).
        mean, white: of these, and what whitens them, (3, 3), lower triangular.
        peak: zeros, written, (PEAK, 4).
    """
    least = 0
    for v in range(rest.shape[0]):
        for u in range(rest.shape[1]):
            x = rest[v, u, 0] - mean[0]
            y, z = rest[v, u, 1] - mean[1], rest[v, u, 2] - mean[2]
            a = white[0, 0] * x
            b = white[1, 0] * x + white[1, 1] * y
            c = white[2, 0] * x + white[2, 1] * y + white[2, 2] * z
            square = a * a + b * b + c * c
            if square > peak[least, 3]:
                peak[least, 0], peak[least, 1], peak[least, 2], peak[least, 3] = a, b, c, square
                for n in range(PEAK):
                    if peak[n, 3] < peak[least, 3]:
                        least = n


@kernel
def project(rest, mean, along, out):
    """Write (rest - mean) . along where it is positive, (rows, columns)."""
    for v in range(rest.shape[0]):
        for u in range(rest.shape[1]):
            total = 0.0
            for i in range(3):
                total += (rest[v, u, i] - mean[i]) * along[i]
            out[v, u] = max(total, 0.0)
