"""A map of lines from images of segments: association, extension, addition and deletion (2.4).

An image is `foresee` (the images of all lines, with their deviations), `associate` (which line
each segment is of), `absorb` (update, extend, add, delete); `use_image` does all three. Settings:
a record with what `lines` needs, and half_width, ztest_max, extend_max, delete_after, patience,
confirm, age_out, min_length.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from visenvs.core.compile import kernel
from visenvs.estimation import lines
from visenvs.estimation.lines import (
    PRINTED,
    SCRATCH,
    begin,
    in_order,
    quadratic,
    sight,
    slide,
    slopes,
)

NEW, IGNORED = -1, -2  # choices beside the number of a line
OVERLAP = 0.3  # of the shorter one: what a segment and a line must share
LONE = 25.0  # an end inside its line counts no more than this: the rest may be hidden


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
def foresee(lines_map, C, r_V, cfg, work):
    """Write the image of every line with its deviations, and whether it should be seen."""
    scratch = work["line"]
    out = scratch["sight"]
    for j in range(lines_map["used"]):
        work["ahead"][j] = lines_map["in_view"][j] = work["touched"][j] = 0.0
        if lines_map["alive"][j] == 0.0:
            continue
        if not sight(lines_map["x"][j], C, r_V, cfg["near"], out, scratch["r"]):
            continue
        slopes(C, out, scratch["J"])
        work["ahead"][j], work["length"][j], P = 1.0, out["length"], lines_map["P"][j]
        for i in range(2):
            work["p"][j, i], work["u"][j, i] = out["p"][0, i], out["u"][i]
            work["t"][j, i] = out["t"][i]
            work["along"][j, i] = quadratic(P, out["along"][i])
        work["across"][j, 0] = quadratic(P, out["across"][0])
        work["across"][j, 2] = quadratic(P, out["across"][1])
        total = 0.0
        for a in range(6):
            for b in range(6):
                total += out["across"][0, a] * P[a, b] * out["across"][1, b]
        work["across"][j, 1] = total
        shown = part_in_view(out["p"], cfg["half_width"]) * out["length"]
        lines_map["in_view"][j] = 1.0 if shown > 2.0 * cfg["min_length"] else 0.0


@kernel
def part_in_view(p, half_width):
    """Share of the segment between two image points (2, 2) that lies inside the square picture."""
    low, high = 0.0, 1.0
    for k in range(2):
        a, b = p[0, k], p[1, k] - p[0, k]
        if b == 0.0:
            if abs(a) >= half_width:
                return 0.0
            continue
        first, last = (-half_width - a) / b, (half_width - a) / b
        low, high = max(low, min(first, last)), min(high, max(first, last))
    return max(high - low, 0.0)


@kernel
def associate(lines_map, seen, cut, count, cfg, work):
    """Write work["choice"] of every segment: the line with the least z-test value, or NEW.

    Several segments may be of one line.
    """
    for i in range(count):
        best, work["choice"][i] = math.inf, NEW
        for j in range(lines_map["used"]):
            if work["ahead"][j] > 0.0 and near_by(seen[i], j, cfg, work):
                value = ztest(seen[i], cut[i], lines_map["closed"][j], j, cfg, work)
                if value < best:
                    best, work["choice"][i] = value, j


@kernel
def near_by(segment, j, cfg, work):
    """Whether the middle of a segment is near enough to line j for its z-test to be worth it."""
    y = 0.5 * (segment[0] + segment[2]) - work["p"][j, 0]
    z = 0.5 * (segment[1] + segment[3]) - work["p"][j, 1]
    d = work["u"][j, 0] * z - work["u"][j, 1] * y
    spread = max(work["across"][j, 0], work["across"][j, 2])
    return d * d <= cfg["ztest_max"] * (4.0 * spread + cfg["sigma_image"] ** 2)


@kernel
def ztest(segment, cut, closed, j, cfg, work):
    """The z-test value of a segment with line j, and log det of its covariance; inf where it fails.

    It is d' S^-1 d of the distances (d_1, d_2), and as much for ends that lie beyond a closed end.
    The logarithm, of S over the noise alone, keeps uncertain lines from winning. Ends of a segment
    that is seen whole and lie inside the line count up to LONE each, to tell neighbours in one
    straight line apart.
    """
    u, noise, length = work["u"][j], cfg["sigma_image"] ** 2, work["length"][j]
    y, z = segment[0] - work["p"][j, 0], segment[1] - work["p"][j, 1]
    a, d_a = u[0] * y + u[1] * z, u[0] * z - u[1] * y
    y, z = segment[2] - work["p"][j, 0], segment[3] - work["p"][j, 1]
    b, d_b = u[0] * y + u[1] * z, u[0] * z - u[1] * y
    first, last = 0, 1
    if b < a:
        a, d_a, b, d_b, first, last = b, d_b, a, d_a, 1, 0
    slack = 3.0 * math.sqrt(max(work["along"][j, 0], work["along"][j, 1]) + noise)
    if min(b, length) - max(a, 0.0) + slack < OVERLAP * min(b - a, length) + 0.5 * slack:
        return math.inf
    N, p, q = work["across"][j], a / length, b / length
    s_aa = (1 - p) * (1 - p) * N[0] + 2.0 * p * (1 - p) * N[1] + p * p * N[2] + noise
    s_bb = (1 - q) * (1 - q) * N[0] + 2.0 * q * (1 - q) * N[1] + q * q * N[2] + noise
    s_ab = (1 - p) * (1 - q) * N[0] + (p + q - 2.0 * p * q) * N[1] + p * q * N[2]
    det = s_aa * s_bb - s_ab * s_ab
    if not det > 0.0:
        return math.inf
    value = (s_bb * d_a * d_a - 2.0 * s_ab * d_a * d_b + s_aa * d_b * d_b) / det
    inside = 0.0
    for i in range(2):
        beyond = -a if i == 0 else b - length
        error = beyond * beyond / (work["along"][j, i] + noise)
        if closed[i] > 0.0 and beyond > 0.0:
            value += error
        elif closed[i] > 0.0 and cut[first if i == 0 else last] == 0.0:
            inside += min(error, LONE)
    if value > cfg["ztest_max"]:
        return math.inf
    return value + inside + math.log(det / (noise * noise))


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

    An end of the segment that is not cut off closes the line's end. Beyond a closed end a line is
    lengthened only where the segment tells that it was closed too early, by a part that was hidden.
    """
    scratch, x, P, closed = work["line"], lines_map["x"][j], lines_map["P"][j], lines_map["closed"]
    out, s, true_end = scratch["sight"], scratch["s"], scratch["true_end"]
    if not sight(x, C, r_V, cfg["near"], out, scratch["r"]):
        return
    slopes(C, out, scratch["J"])
    turned, noise = in_order(out, segment, scratch["x"], s), cfg["sigma_image"]
    for i in range(2):
        k = 1 - i if turned else i
        beyond, depth = (-s[0] if i == 0 else s[1] - 1.0) * out["length"], out["q"][i, 0]
        gate = cfg["e_gate"] * math.sqrt(quadratic(P, out["along"][i]) + noise * noise)
        true_end[k] = 1.0 - cut[k]
        if out["t"][i] == i and beyond > (gate if closed[j, i] > 0.0 else 0.0):
            share = max(share_of(out["q"], s, i), -cfg["extend_max"])
            slide(x, P, i, share, (noise * depth) ** 2, scratch["W"])
            true_end[k] = 0.0  # it has been used
        if cut[k] == 0.0 and beyond > -gate:
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
def update_printed(lines_map, C, r_V, seen, count, cfg, work):
    """Update every line by all its segments at once, as printed: x += sum K_i z_i, P -= sum K_i H P.

    Every gain uses the same P^- (2.40)-(2.41): with two segments of one line the covariance is
    no longer one. Counts in `indefinite` the updates after which a variance is negative.
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
            negative = False
            for a in range(6):
                x[a] = sum_x[a]
                negative = negative or sum_P[a, a] < 0.0
                for b in range(6):
                    P[a, b] = sum_P[a, b]
            lines_map["indefinite"] += 1.0 if negative else 0.0


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
