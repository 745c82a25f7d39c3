"""Tracks of stationary objects, one filter each, all of one kind, in one record.

An image is: `predict` every track, `compare` its sightings with them, `associate` (or
`association.by_label`), `absorb`. `report` gives positions relative to the vehicle at any time.
Settings: a record with what `sighting`, `inertial.predict` and `spherical.predict` need, and
half_width, ztest_max, delete_after, and prior_covariance (for CARTESIAN: one of PRIORS).
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from visenvs.core.compile import kernel
from visenvs.core.frames import rotate
from visenvs.core.sight import IMAGE
from visenvs.estimation import bank, batch, inertial, inverse_range, sighting, spherical
from visenvs.estimation.association import IGNORED, NEW, assign, assign_scratch, set_aside

# the order of the codes
KINDS = ("cartesian", "inverse-ekf", "inverse-ukf", "spherical", "batch", "bank")
CARTESIAN, INVERSE_EKF, INVERSE_UKF, SPHERICAL, BATCH, BANK = range(6)
PRIORS = ("full", "thesis")  # `inertial.begin`, `inertial.begin_thesis`
FULL, THESIS = range(2)
RECENT = 10.0  # sightings of another object after which a track is that object's at the latest
NOBODY = -1.0  # label of a sighting that is of no object


def tracks_dtype(slots: int, window: int = 1, cells: int = bank.CELLS) -> np.dtype[Any]:
    """Record of so many tracks, `window` sightings that BATCH linearises anew, `cells` of BANK."""
    if min(slots, window, cells) < 1:
        raise ValueError(
            f"slots={slots}, window={window}, cells={cells}: a record holds at least one track, "
            "and a track one sighting and one cell; write `tracks_dtype(6, window=1)`"
        )
    one = ("prior", "alive", "hits", "missed", "unseen", "owner", "votes", "ahead", "in_view")
    return np.dtype(
        [
            *((name, "f8", (slots, 3)) for name in ("x", "anchor", "r", "factor")),
            *((name, "f8", (slots, 3, 3)) for name in ("P", "cov")),
            *((name, "f8", (slots,)) for name in one),
            ("deviation", "f8", (slots,)),
            ("predicted", "f8", (slots, 2)),
            ("history", "f8", (slots, spherical.HISTORY_ROWS, 3)),
            ("window", "f8", (slots, 1 + window, batch.WIDTH)),
            ("weights", "f8", (slots, cells)),
            ("xs", "f8", (slots, cells, 3)),
            ("Ps", "f8", (slots, cells, 3, 3)),
            *((name, "f8") for name in ("made", "ghosts", "wrong", "dropped")),
        ]
    )


def work_dtype(slots: int, sightings: int) -> np.dtype[Any]:
    """Scratch record for so many tracks and at most so many sightings in an image."""
    return np.dtype(
        [
            ("filter", sighting.SCRATCH),
            ("ztest", "f8", (sightings, slots)),
            ("choice", "i8", (sightings,)),
            ("assign", "f8", assign_scratch(sightings, slots)),
        ]
    )


@kernel
def begin(kind, tracks, j, r_V, C, measured, prior, cfg, scratch):
    """Start track j from one sighting at a prior distance and its standard deviation, m, (2,)."""
    x, P, r0 = tracks["x"][j], tracks["P"][j], prior[0]
    if kind == CARTESIAN:
        if cfg["prior_covariance"] == THESIS:
            inertial.begin_thesis(x, P, r_V, C, measured, prior[0], prior[1], cfg, scratch)
        else:
            inertial.begin(x, P, r_V, C, measured, prior[0], prior[1], cfg, scratch)
    elif kind == SPHERICAL:
        history = tracks["history"][j]
        spherical.begin(x, P, history, C, measured, prior[0], prior[1], cfg, scratch)
    else:
        r0 = inverse_range.begin(x, P, C, measured, prior[0], prior[1], cfg, scratch)
        if kind == BATCH:
            batch.begin(x, P, tracks["window"][j])
        if kind == BANK:
            bank.begin(x, P, r0, tracks["weights"][j], tracks["xs"][j], tracks["Ps"][j])
    tracks["prior"][j], tracks["deviation"][j] = r0, prior[1]
    for i in range(3):
        tracks["anchor"][j, i] = r_V[i]


@kernel
def predict(kind, tracks, r_V, moved, cfg, scratch):
    """Carry every track over a step in which the camera moved to r_V by `moved` (m, N, (3,))."""
    for j in range(tracks["alive"].shape[0]):
        if tracks["alive"][j] > 0.0:
            x, P = tracks["x"][j], tracks["P"][j]
            if kind == CARTESIAN:
                inertial.predict(P, cfg["q"] * cfg["dt"])
            elif kind == SPHERICAL:
                history, deviation = tracks["history"][j], tracks["deviation"][j]
                spherical.predict(x, P, history, r_V, moved, deviation, cfg, scratch)


@kernel
def update(kind, tracks, j, r_V, C, measured, cfg, scratch):
    """Use one sighting for track j; returns the NIS."""
    x, P, anchor = tracks["x"][j], tracks["P"][j], tracks["anchor"][j]
    r0 = tracks["prior"][j]
    if kind == SPHERICAL:
        return spherical.use(x, P, C, measured, tracks["deviation"][j], cfg, scratch)
    if kind == BATCH:
        window = tracks["window"][j]
        return batch.update(x, P, window, anchor, r0, r_V, C, measured, cfg, scratch)
    if kind == BANK:
        weights, xs, Ps = tracks["weights"][j], tracks["xs"][j], tracks["Ps"][j]
        return bank.update(weights, xs, Ps, anchor, r0, r_V, C, measured, cfg, scratch)
    if kind == INVERSE_UKF:
        nis = inverse_range.update_unscented(x, P, anchor, r_V, C, measured, cfg, scratch)
    else:
        r, J = scratch["r"], scratch["J"]
        locate(kind, x, anchor, r_V, scratch["A"], r, J)
        nis = sighting.update(x, P, r, J, C, measured, cfg, scratch)
    if kind != CARTESIAN:
        inverse_range.keep_in_bounds(x, r0)
    return nis


@kernel
def locate(kind, x, anchor, r_V, A, r, J):
    """Write the relative position of a state (m, N, (3,)) and its derivative by it, (3, 3)."""
    if kind == CARTESIAN:
        inertial.position(x, r_V, r, J)
    elif kind == SPHERICAL:
        spherical.position(x, A, r, J)
    else:
        inverse_range.position(x, anchor, r_V, A, r, J)


@kernel
def moments(kind, tracks, j, r_V, scratch):
    """Write r (m, N) and cov (m^2) of track j, relative to r_V, to first order."""
    r, cov, anchor = tracks["r"][j], tracks["cov"][j], tracks["anchor"][j]
    if kind == BANK:
        weights, xs, Ps = tracks["weights"][j], tracks["xs"][j], tracks["Ps"][j]
        bank.moments(weights, xs, Ps, anchor, r_V, r, cov, scratch)
    else:
        locate(kind, tracks["x"][j], anchor, r_V, scratch["A"], r, scratch["J"])
        sighting.spread(tracks["P"][j], scratch["J"], scratch["W"], cov)


@kernel
def report(kind, tracks, r_V, cfg, scratch):
    """Write `moments` of every living track, smoothed if the spherical filter is to be (3.41)."""
    for j in range(tracks["alive"].shape[0]):
        if tracks["alive"][j] > 0.0:
            moments(kind, tracks, j, r_V, scratch)
            if kind == SPHERICAL:
                x, history, r = tracks["x"][j], tracks["history"][j], tracks["r"][j]
                spherical.smooth(x, history, r_V, scratch["A"], cfg, r)


@kernel
def expect(kind, tracks, j, r_V, C, cfg, scratch):
    """Predict the sighting of track j, and whether it is ahead, and in view if it is there at all.

    Ahead: beyond min_range along the optical axis (IMAGE) or to the object (ANGLES). In view: two
    standard deviations inside half_width (tangent, or rad) in both directions.
    """
    moments(kind, tracks, j, r_V, scratch)
    r, predicted, factor = tracks["r"][j], tracks["predicted"][j], tracks["factor"][j]
    sighting.expect(r, tracks["cov"][j], C, cfg, scratch, predicted, factor)
    away, nearest = rotate(C, r)[0], cfg["min_range"]
    if cfg["sensor"] != IMAGE:
        away = math.sqrt(r[0] * r[0] + r[1] * r[1] + r[2] * r[2])
    tracks["ahead"][j] = 1.0 if away > nearest else 0.0
    first = abs(predicted[0]) + 2.0 * factor[0]
    second = abs(predicted[1]) + 2.0 * math.sqrt(factor[1] * factor[1] + factor[2] * factor[2])
    seen = away > nearest and first < cfg["half_width"] and second < cfg["half_width"]
    tracks["in_view"][j] = 1.0 if seen else 0.0


@kernel
def compare(kind, tracks, r_V, C, seen, count, cfg, work):
    """Write work["ztest"] of every sighting and track; inf where there is no track ahead.

    Args:
        seen: measurements, (rows, 2), of which `count` are in use.
    """
    scratch = work["filter"]
    for j in range(tracks["alive"].shape[0]):
        if tracks["alive"][j] > 0.0:
            expect(kind, tracks, j, r_V, C, cfg, scratch)
        for i in range(count):
            work["ztest"][i, j] = math.inf
            if tracks["alive"][j] > 0.0 and tracks["ahead"][j] > 0.0 and readable(seen[i]):
                predicted, factor = tracks["predicted"][j], tracks["factor"][j]
                value = sighting.ztest(seen[i], predicted, factor, cfg, scratch["e"])
                work["ztest"][i, j] = value


@kernel
def readable(measured):
    """Whether both measured numbers are finite."""
    return math.isfinite(measured[0]) and math.isfinite(measured[1])


@kernel
def associate(count, cfg, work):
    """Write work["choice"] of every sighting: its track, NEW, or IGNORED as one more of a track."""
    ztest, choice = work["ztest"], work["choice"]
    assign(ztest, count, cfg["ztest_max"], choice, work["assign"])
    set_aside(ztest, count, cfg["ztest_max"], choice)


@kernel
def absorb(kind, tracks, r_V, C, seen, labels, priors, count, threshold, cfg, work):
    """Update, start and delete tracks by work["choice"], and count what went wrong.

    A sighting with a number that is not finite is left out. Counted in `tracks`: `made` tracks,
    `ghosts` among them (of nothing, or of an object that had one), `wrong` updates (by another
    object than the track's owner), sightings `dropped` for want of a slot.

    Args:
        seen: measurements, (rows, 2), of which `count` are in use.
        labels: which object each is of, NOBODY for a false one; only counted with, (rows,).
        priors: distance and its standard deviation for a new track, m, (rows, 2).
        threshold: a sighting whose z-test value with a track just made is no larger is of the same
            object: cfg["ztest_max"], or below 0 where labels tell.
    """
    for j in range(tracks["alive"].shape[0]):
        tracks["unseen"][j] += 1.0
    for i in range(count):
        j = work["choice"][i]
        if not readable(seen[i]):
            work["choice"][i] = IGNORED
        elif j >= 0:
            update(kind, tracks, j, r_V, C, seen[i], cfg, work["filter"])
            count_hit(tracks, j, labels[i])
    for i in range(count):
        if work["choice"][i] == NEW:
            create(kind, tracks, i, r_V, C, seen, labels, priors, count, threshold, cfg, work)
    delete(tracks, cfg["delete_after"])


@kernel
def count_hit(tracks, j, label):
    """Count an update of track j; its owner is whom most of its last sightings were of.

    That is the majority vote of Boyer and Moore, in which no lead is longer than RECENT.
    """
    tracks["hits"][j] += 1.0
    tracks["unseen"][j] = tracks["missed"][j] = 0.0
    if tracks["owner"][j] == label:
        tracks["votes"][j] = min(tracks["votes"][j] + 1.0, RECENT)
        return
    tracks["wrong"] += 1.0
    if tracks["votes"][j] > 0.0:
        tracks["votes"][j] -= 1.0
    else:
        tracks["owner"][j], tracks["votes"][j] = label, 1.0


@kernel
def create(kind, tracks, i, r_V, C, seen, labels, priors, count, threshold, cfg, work):
    """Start a track from sighting i in a free slot, or in that of a track that is out of date.

    That is one unseen in more images than it was seen in; the one unseen for longest goes.
    Later sightings of the image that pass the new track's test are taken for the same object.
    """
    slot, longest = -1, 0.0
    for j in range(tracks["alive"].shape[0]):
        waited = math.inf if tracks["alive"][j] == 0.0 else tracks["unseen"][j]
        if waited > longest and waited > tracks["hits"][j]:
            slot, longest = j, waited
    if slot < 0:
        tracks["dropped"] += 1.0
        return
    tracks["made"] += 1.0
    ghost = labels[i] == NOBODY
    for j in range(tracks["alive"].shape[0]):
        if j != slot and tracks["alive"][j] > 0.0 and tracks["owner"][j] == labels[i]:
            ghost = True
    tracks["ghosts"] += 1.0 if ghost else 0.0
    begin(kind, tracks, slot, r_V, C, seen[i], priors[i], cfg, work["filter"])
    tracks["owner"][slot] = labels[i]
    tracks["alive"][slot] = tracks["hits"][slot] = tracks["votes"][slot] = 1.0
    tracks["missed"][slot] = tracks["unseen"][slot] = 0.0
    expect(kind, tracks, slot, r_V, C, cfg, work["filter"])
    predicted, factor = tracks["predicted"][slot], tracks["factor"][slot]
    for k in range(i + 1, count):
        if work["choice"][k] == NEW:
            value = sighting.ztest(seen[k], predicted, factor, cfg, work["filter"]["e"])
            work["choice"][k] = IGNORED if value <= threshold else NEW


@kernel
def delete(tracks, delete_after):
    """Delete tracks that should have been seen and were not.

    A track may be missed in as many images, one after another, as it was seen in, but at most
    `delete_after`; 0 for ever. What is out of view coasts, unless it was seen but once.
    """
    for j in range(tracks["alive"].shape[0]):
        due = tracks["in_view"][j] > 0.0 or tracks["hits"][j] <= 1.0
        if tracks["alive"][j] > 0.0 and tracks["unseen"][j] > 0.0 and due:
            tracks["missed"][j] += 1.0
            if delete_after > 0 and tracks["missed"][j] >= min(delete_after, tracks["hits"][j]):
                tracks["alive"][j] = 0.0
