"""Which line of a map a segment in an image is of: z-test with log-determinant (thesis 2.4.1).

The segments of an image that contend for lines are assigned together (`association.assign`).

Settings: a record with near, half_width, min_length, sigma_image, ztest_max.
"""

from __future__ import annotations

import math

from visenvs.core.compile import kernel
from visenvs.estimation.association import assign
from visenvs.estimation.lines import quadratic, sight, slopes

NEW, UNCLEAR = -1, -2  # choices beside the number of a line
OPTIONS = 6  # the best lines of a segment, so many
OVERLAP = 0.3  # of the shorter one: what a segment and a line must share
SLACK = 1.5  # deviations that they may share less
LONE = 25.0  # an end inside its line counts no more than this: the rest may be hidden


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
            work["along"][j, i] = max(quadratic(P, out["along"][i]), 0.0)
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
    """Write work["choice"] of every segment: a line, NEW where none fits, or UNCLEAR.

    The z-test values of all segments together are least. Several may be of one line, its parts, but
    an edge shows each of its points once: segments that overlap are of different lines. One that
    fits lines and gets none is UNCLEAR and used for nothing: to start a line from it would double
    one more often than find one. Being left out costs as much as the worst value that is no matter
    of a line's own uncertainty.
    """
    for i in range(count):
        list_lines(lines_map, seen[i], cut[i], i, cfg, work)
    rows = contested(seen, count, work)
    if rows == 0:  # the least values of all have the least sum
        return
    rows = gather(seen, count, rows, work)
    row, values, picked = work["row"], work["ztest"], work["picked"]
    most = cfg["ztest_max"] + 2.0 * LONE
    for r in range(rows):
        for j in range(values.shape[1]):
            values[r, j] = math.inf
        for k in range(work["options"][row[r]]):
            values[r, work["option"][row[r], k]] = work["value"][row[r], k]
    assign(values, rows, most, picked, work["assign"])
    for r in range(rows):
        work["choice"][row[r]] = picked[r] if picked[r] >= 0 else UNCLEAR
    for r in range(rows):
        if picked[r] < 0:
            join(seen, count, row[r], most, work)


@kernel
def list_lines(lines_map, segment, cut, i, cfg, work):
    """Write the lines that segment i may be of, at most OPTIONS, by their z-test values."""
    option, values, found = work["option"][i], work["value"][i], 0
    for j in range(lines_map["used"]):
        if work["ahead"][j] > 0.0 and near_by(segment, j, cfg, work):
            value = ztest(segment, cut, lines_map["closed"][j], j, cfg, work)
            if value < math.inf:
                k = found
                while k > 0 and values[k - 1] > value:
                    if k < OPTIONS:
                        option[k], values[k] = option[k - 1], values[k - 1]
                    k -= 1
                if k < OPTIONS:
                    option[k], values[k] = j, value
                found = min(found + 1, OPTIONS)
    work["options"][i] = found
    work["choice"][i] = option[0] if found else NEW


@kernel
def extent(segment, j, work):
    """Between which places along the image of line j a segment lies, focal lengths."""
    p, u = work["p"][j], work["u"][j]
    a = u[0] * (segment[0] - p[0]) + u[1] * (segment[1] - p[1])
    b = u[0] * (segment[2] - p[0]) + u[1] * (segment[3] - p[1])
    return min(a, b), max(a, b)


@kernel
def overlap(one, other, j, work):
    """Whether two segments would show the same part of line j."""
    a, b = extent(one, j, work)
    c, d = extent(other, j, work)
    return min(b, d) - max(a, c) > OVERLAP * min(b - a, d - c)


@kernel
def crowded(seen, count, i, j, work):
    """Whether segment i overlaps one that line j has been given."""
    for other in range(count):
        if other != i and work["choice"][other] == j and overlap(seen[i], seen[other], j, work):
            return True
    return False


@kernel
def contested(seen, count, work):
    """Write into work["row"] the segments that overlap another one of their line; how many."""
    rows = 0
    for j in range(work["holders"].shape[0]):
        work["holders"][j] = 0
    for i in range(count):
        work["marked"][i] = 0
        if work["choice"][i] >= 0:
            work["holders"][work["choice"][i]] += 1
    for i in range(count):
        j = work["choice"][i]
        if j >= 0 and work["holders"][j] > 1 and crowded(seen, count, i, j, work):
            work["row"][rows], work["marked"][i] = i, 1
            rows += 1
    return rows


@kernel
def gather(seen, count, rows, work):
    """Add to work["row"] whatever overlaps one of these on a line that both may be of; how many.

    All others keep their lines, whatever these get.
    """
    row, r = work["row"], 0
    while r < rows:
        i = row[r]
        for k in range(work["options"][i]):
            j = work["option"][i, k]
            for other in range(count):
                free = work["choice"][other] == j and work["marked"][other] == 0
                if free and overlap(seen[i], seen[other], j, work):
                    row[rows], work["marked"][other] = other, 1
                    rows += 1
        r += 1
    return rows


@kernel
def join(seen, count, i, most, work):
    """Give segment i, which got no line for itself, the best one that it is a free part of."""
    for k in range(work["options"][i]):
        j = work["option"][i, k]
        if work["value"][i, k] <= most and not crowded(seen, count, i, j, work):
            work["choice"][i] = j
            return


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
    slack = SLACK * math.sqrt(max(work["along"][j, 0], work["along"][j, 1]) + noise)
    if min(b, length) - max(a, 0.0) + slack < OVERLAP * min(b - a, length):
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
