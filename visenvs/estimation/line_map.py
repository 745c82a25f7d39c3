"""A map of lines from images of segments: extension, addition and deletion (thesis 2.4.3).

`use_image` is `line_matching.foresee` and `associate`, then `absorb`. Settings: a record with what
`lines` and `line_matching` need, and extend_max, delete_after, patience, confirm, age_out.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from visenvs.core.compile import kernel
from visenvs.estimation import lines
from visenvs.estimation.association import assign_scratch
from visenvs.estimation.line_matching import NEW, OPTIONS, associate, foresee
from visenvs.estimation.lines import (
    FOUR,
    PRINTED,
    SCRATCH,
    begin,
    in_order,
    quadratic,
    sight,
    slide,
    slopes,
)


def map_dtype(slots: int) -> np.dtype[Any]:
    """Record of a map with room for so many lines.

    x, P: `lines` states. closed: 1 for ends that were seen, 0 where the picture cut the line off.
    hits, missed, unseen: images that it was seen in, and since then missed in, and gone by.
    owner: label of the segment that it began with; only to score with.
    """
    if slots < 1:
        raise ValueError(f"slots={slots}: a map holds at least one line; write `map_dtype(64)`")
    one = ("alive", "hits", "missed", "unseen", "owner", "in_view")
    return np.dtype(
        [
            ("x", "f8", (slots, 6)),
            ("P", "f8", (slots, 6, 6)),
            ("closed", "f8", (slots, 2)),
            *((name, "f8", (slots,)) for name in one),
            ("used", "i8"),  # slots beyond these have never held a line
            *((name, "f8") for name in ("made", "wrong", "dropped", "indefinite")),
        ]
    )


def work_dtype(slots: int, segments: int) -> np.dtype[Any]:
    """Scratch record for so many lines and at most so many segments in an image."""
    return np.dtype(
        [
            ("line", SCRATCH),
            ("ahead", "f8", (slots,)),
            ("p", "f8", (slots, 2)),  # of the sight of every line
            ("u", "f8", (slots, 2)),
            ("length", "f8", (slots,)),
            ("t", "f8", (slots, 2)),
            ("across", "f8", (slots, 3)),  # covariance of its image's ends across it
            ("along", "f8", (slots, 2)),  # and variances along it
            ("touched", "f8", (slots,)),
            ("choice", "i8", (segments,)),
            ("options", "i8", (segments,)),  # lines that it may be of
            ("option", "i8", (segments, OPTIONS)),
            ("value", "f8", (segments, OPTIONS)),  # and their z-test values
            ("holders", "i8", (slots,)),  # segments that a line is the best for
            ("row", "i8", (segments,)),  # those to be assigned together
            ("marked", "i8", (segments,)),  # whether it is one of them
            ("ztest", "f8", (segments, slots)),
            ("picked", "i8", (segments,)),
            ("assign", "f8", assign_scratch(segments, slots)),
            ("sum_x", "f8", (6,)),
            ("sum_P", "f8", (6, 6)),
        ]
    )


@kernel
def use_image(lines_map, C, r_V, seen, cut, labels, count, cfg, work):
    """Bring the map up to date by one image.

    Args:
        lines_map: a `map_dtype` record.
        C, r_V: camera attitude C_CN (3, 3) and position in N, m, (3,).
        seen: segments, (rows, 4), of which `count` are in use.
        cut: 1 for ends that the picture's edge cut off, (rows, 2).
        labels: which edge each is of, negative for none; only counted with, (rows,).
        cfg, work: settings, and a `work_dtype` record.
    """
    foresee(lines_map, C, r_V, cfg, work)
    associate(lines_map, seen, cut, count, cfg, work)
    absorb(lines_map, C, r_V, seen, cut, labels, count, cfg, work)


@kernel
def absorb(lines_map, C, r_V, seen, cut, labels, count, cfg, work):
    """Update and extend lines by work["choice"], add those of new segments, delete what is gone."""
    for j in range(lines_map["used"]):
        lines_map["unseen"][j] += 1.0
    if cfg["estimator"] == PRINTED:
        update_printed(lines_map, C, r_V, seen, count, cfg, work)
    for i in range(count):
        j = work["choice"][i]
        if j >= 0:
            if cfg["estimator"] != PRINTED:
                stretch(lines_map, j, C, r_V, seen[i], cut[i], cfg, work)
            if work["touched"][j] == 0.0:
                lines_map["hits"][j] += 1.0
            work["touched"][j] = 1.0
            lines_map["unseen"][j] = lines_map["missed"][j] = 0.0
            lines_map["wrong"] += 1.0 if lines_map["owner"][j] != labels[i] else 0.0
    for i in range(count):
        if work["choice"][i] == NEW:
            add(lines_map, C, r_V, seen[i], cut[i], labels[i], cfg, work)
    delete(lines_map, cfg)


@kernel
def stretch(lines_map, j, C, r_V, segment, cut, cfg, work):
    """Update line j by a segment, and draw its open ends out to the segment's.

    An end of the segment that is not cut off closes an open end, which is moved there, in or out.
    Beyond a closed end a line is lengthened only where the segment tells that it was closed too
    early: the rest was hidden. Noise alone tells so once in 30,000 ends, and distances d could
    never take it back. A segment that ends within the line tells nothing of its end.
    """
    scratch, x, P, closed = work["line"], lines_map["x"][j], lines_map["P"][j], lines_map["closed"]
    out, s, true_end = scratch["sight"], scratch["s"], scratch["true_end"]
    if not sight(x, C, r_V, cfg["near"], out, scratch["r"]):
        return
    slopes(C, out, scratch["J"])
    turned, noise = in_order(out, segment, scratch["x"], s), cfg["sigma_image"]
    for i in range(2):
        k = 1 - i if turned else i
        beyond = (-s[0] if i == 0 else s[1] - 1.0) * out["length"]
        gate = cfg["e_gate"] * math.sqrt(quadratic(P, out["along"][i]) + noise * noise)
        true_end[k] = 1.0 - cut[k]
        opened = closed[j, i] == 0.0
        ends_here = cut[k] == 0.0 and beyond > -gate
        longer = cfg["estimator"] == FOUR and beyond > gate
        moves = beyond > 0.0 or ends_here if opened else longer
        if moves and out["t"][i] == i:
            share = min(max(share_of(out["q"], s, i), -cfg["extend_max"]), 0.5)
            doubt = noise * spread_of(out["q"], s, i) / out["length"]
            slide(x, P, i, share, doubt * doubt, scratch["W"])
            true_end[k] = 0.0  # it has been used
        if ends_here:
            closed[j, i] = 1.0
    lines.update(x, P, C, r_V, segment, true_end, cfg, scratch)


@kernel
def share_of(q, s, i):
    """Where along a line, from its end i to the other, the place s[i] of its image lies.

    Args:
        q: both ends in C, m, (2, 3).
        s: places along the image, 0 at end 0 and 1 at end 1, (2,).
    """
    depth = s[i] * q[0, 0] + (1.0 - s[i]) * q[1, 0]
    share = s[i] * q[0, 0] / depth if depth > 0.0 else s[i]
    return share if i == 0 else 1.0 - share


@kernel
def spread_of(q, s, i):
    """How fast a place on a line moves along it with s[i], m: the further, the more end-on it is.

    Args:
        q, s: as for `share_of`.
    """
    depth, square = s[i] * q[0, 0] + (1.0 - s[i]) * q[1, 0], 0.0
    for j in range(3):
        square += (q[1, j] - q[0, j]) ** 2
    slope = q[0, 0] * q[1, 0] / (depth * depth) if depth > 0.0 else 1.0
    return math.sqrt(square) * slope


@kernel
def update_printed(lines_map, C, r_V, seen, count, cfg, work):
    """Update every line by all its segments at once: x += sum K_i z_i, P -= sum K_i H P.

    As printed in (2.40)-(2.41) every gain uses the same P^-: with two segments of one line the
    covariance need be none any more. Counts in `indefinite` the updates after which it is not.
    """
    scratch, sum_x, sum_P = work["line"], work["sum_x"], work["sum_P"]
    W, y, true_end = scratch["W"], scratch["y"], scratch["true_end"]
    true_end[0] = true_end[1] = 0.0
    for j in range(lines_map["used"]):
        x, P, used = lines_map["x"][j], lines_map["P"][j], 0
        for a in range(6):
            sum_x[a] = x[a]
            for b in range(6):
                sum_P[a, b] = P[a, b]
        for i in range(count):
            if work["choice"][i] == j:
                used += 1
                for a in range(6):
                    y[a] = x[a]
                    for b in range(6):
                        W[a, b] = P[a, b]
                lines.update(y, W, C, r_V, seen[i], true_end, cfg, scratch)
                for a in range(6):
                    sum_x[a] += y[a] - x[a]
                    for b in range(6):
                        sum_P[a, b] += W[a, b] - P[a, b]
        if used:
            for a in range(6):
                x[a] = sum_x[a]
                for b in range(6):
                    P[a, b] = sum_P[a, b]
            lines_map["indefinite"] += 0.0 if positive(sum_P) else 1.0


@kernel
def positive(P):
    """Whether a symmetric matrix is positive definite, by elimination; overwrites it."""
    n = P.shape[0]
    for k in range(n):
        if not P[k, k] > 0.0:
            return False
        for i in range(k + 1, n):
            share = P[i, k] / P[k, k]
            for j in range(k + 1, n):
                P[i, j] -= share * P[k, j]
    return True


@kernel
def add(lines_map, C, r_V, segment, cut, label, cfg, work):
    """Start a line from a segment in a free slot; counted as dropped if there is none."""
    for j in range(lines_map["alive"].shape[0]):
        if lines_map["alive"][j] == 0.0:
            x, P = lines_map["x"][j], lines_map["P"][j]
            if begin(x, P, C, r_V, segment, cfg, work["line"]["r"]):
                lines_map["alive"][j] = lines_map["hits"][j] = 1.0
                lines_map["missed"][j] = lines_map["unseen"][j] = 0.0
                lines_map["in_view"][j] = 1.0
                lines_map["owner"][j] = label
                lines_map["made"] += 1.0
                lines_map["used"] = max(lines_map["used"], j + 1)
                for i in range(2):
                    lines_map["closed"][j, i] = 1.0 - cut[i]
            return
    lines_map["dropped"] += 1.0


@kernel
def delete(lines_map, cfg):
    """Delete lines that should have been seen and were not, and old ones that nobody confirmed.

    A line may be missed in `delete_after` images one after another, and in `patience` more for each
    image that it was seen in. One seen in fewer than `confirm` images is gone after `age_out` more,
    wherever it is: false lines often never come into view again.
    """
    for j in range(lines_map["used"]):
        if lines_map["alive"][j] > 0.0 and lines_map["unseen"][j] > 0.0:
            lines_map["missed"][j] += lines_map["in_view"][j]
            missable = cfg["delete_after"] + cfg["patience"] * lines_map["hits"][j]
            gone = lines_map["missed"][j] > missable
            old = lines_map["hits"][j] < cfg["confirm"] and lines_map["unseen"][j] > cfg["age_out"]
            if gone or old:
                lines_map["alive"][j] = 0.0
