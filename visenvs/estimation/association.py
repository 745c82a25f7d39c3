"""Which sighting belongs to which track: z-test values (thesis (3.4)-(3.6)), and who wins.

Where several sightings pass the test of a track, or one passes that of several, the sum of the
values decides: a sighting may stay alone, at the price of the threshold. For one sighting this is
(3.6); for many it is the best of all assignments, found exactly.
"""

from __future__ import annotations

import math

from visenvs.core.compile import kernel

NEW, IGNORED = -1, -2  # choices beside the number of a track
U, V, TAKEN, WAY, LEAST, USED = range(6)  # rows of the scratch of `assign`


def assign_scratch(sightings: int, tracks: int) -> tuple[int, int]:
    """Shape of the scratch of `assign`, for at most so many of each."""
    return 6, sightings + max(sightings, tracks) + tracks + 1


@kernel
def price(ztest, i, j, threshold):
    """Price of giving sighting i to column j: a track, or beyond the last one no track.

    What fails the test costs more than no track, and so is never chosen.
    """
    if j >= ztest.shape[1]:
        return threshold
    return ztest[i, j] if ztest[i, j] <= threshold else 2.0 * threshold + 1.0


@kernel
def assign(ztest, count, threshold, choice, work):
    """Choose a track for every sighting, or none, at the least total price; each track once.

    Shortest augmenting paths with potentials u, v (Kuhn 1955, Munkres 1957; Jonker and Volgenant
    1987), at most count^2 (tracks + count) operations. Columns are counted from 1, 0 is the root.

    Args:
        ztest: values of sighting i with track j, (rows, tracks); inf where there is no track.
        count: how many rows are in use.
        threshold: largest value that passes; also the price of no track.
        choice: written for each sighting, (rows,): the track, or NEW for none.
        work: scratch, of shape `assign_scratch(rows, tracks)`.
    """
    tracks = ztest.shape[1]
    columns = tracks + count
    u, v, taken, way = work[U], work[V], work[TAKEN], work[WAY]
    for j in range(work.shape[1]):
        u[j] = v[j] = taken[j] = 0.0
    for i in range(1, count + 1):
        taken[0], column = i, 0
        for j in range(columns + 1):
            work[LEAST, j], work[USED, j] = math.inf, 0.0
        while taken[column] > 0.0:
            column = nearest_column(ztest, threshold, columns, column, work)
        while column != 0:
            before = int(way[column])
            taken[column] = taken[before]
            column = before
    for j in range(1, columns + 1):
        if taken[j] > 0.0:
            choice[int(taken[j]) - 1] = j - 1 if j <= tracks else NEW


@kernel
def nearest_column(ztest, threshold, columns, column, work):
    """Grow the tree of shortest alternating paths by the nearest column; returns that column."""
    u, v, taken, least = work[U], work[V], work[TAKEN], work[LEAST]
    work[USED, column] = 1.0
    row, best, step = int(taken[column]), 0, math.inf
    for j in range(1, columns + 1):
        if work[USED, j] == 0.0:
            reduced = price(ztest, row - 1, j - 1, threshold) - u[row] - v[j]
            if reduced < least[j]:
                least[j], work[WAY, j] = reduced, column
            if least[j] < step:
                step, best = least[j], j
    for j in range(columns + 1):
        if work[USED, j] > 0.0:
            u[int(taken[j])] += step
            v[j] -= step
        else:
            least[j] -= step
    return best


@kernel
def set_aside(ztest, count, threshold, choice):
    """Let only that found a track which passes the test of none: the rest are IGNORED.

    A sighting that passes the test of a track which took another one is a second one of the same
    object (3.6), as far as anyone can tell.
    """
    for i in range(count):
        if choice[i] == NEW:
            for j in range(ztest.shape[1]):
                if ztest[i, j] <= threshold:
                    choice[i] = IGNORED


@kernel
def by_label(owner, alive, labels, count, choice):
    """Choose by label, for an image processor that tells its objects apart.

    Args:
        owner, alive: label of each track and whether there is one, (tracks,).
        labels: of the sightings, (rows,); `count` are in use.
        choice: written, (rows,): the living track with that label, or NEW.
    """
    for i in range(count):
        choice[i] = NEW
        for j in range(owner.shape[0]):
            if alive[j] > 0.0 and owner[j] == labels[i]:
                choice[i] = j
