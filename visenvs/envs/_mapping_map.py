"""What a mapping task makes of its images: map, coverage, what the row tells, errors."""

from __future__ import annotations

import math

import numpy as np

from visenvs.core.compile import kernel
from visenvs.core.frames import camera_towards
from visenvs.core.pinhole import project
from visenvs.envs._mapping_config import EDGES, SEGMENTS, SIDE, SLOTS, TOKENS
from visenvs.estimation import line_map
from visenvs.sensors import segments

SCENE, IMAGE = 0, 1  # noise streams
SAMPLES = 4  # points of an edge at which the map's error is taken

WORK = np.dtype(
    [
        ("map", line_map.work_dtype(SLOTS, SEGMENTS)),
        ("camera", segments.SCRATCH),
        ("labels", "f8", (SEGMENTS,)),
        ("r", "f8", (3,)),
        ("moved", "f8", (2,)),
        ("worst", "f8", (SLOTS, 3)),
        ("deviation", "f8", (SLOTS,)),
        ("order", "i8", (TOKENS,)),
        ("gap", "f8", (EDGES, SAMPLES)),
        ("doubt", "f8", (EDGES,)),
    ]
)


@kernel
def look(lane, k, cfg, work):
    """Take image k, bring the map up to date, and note which cells of the area it shows."""
    r, C = work["r"], lane["C"]
    r[0], r[1], r[2] = lane["tilt"][0], lane["tilt"][1], 1.0
    camera_towards(r, C)
    lane["seen"] = segments.take_segments(
        lane,
        C,
        lane["r_V_N"],
        cfg,
        lane["seed"],
        lane["episode"],
        k,
        IMAGE,
        lane["segment"],
        lane["cut"],
        work["labels"],
        work["camera"],
    )
    line_map.use_image(
        lane["map"],
        C,
        lane["r_V_N"],
        lane["segment"],
        lane["cut"],
        work["labels"],
        int(lane["seen"]),
        cfg,
        work["map"],
    )
    cover(lane, cfg, r)


@kernel
def cover(lane, cfg, r):
    """Mark the cells of the area whose middle on the ground lies in the picture."""
    width, C = 2.0 * cfg["area"] / SIDE, lane["C"]
    for c in range(SIDE * SIDE):
        r[0] = (c // SIDE + 0.5) * width - cfg["area"] - lane["r_V_N"][0]
        r[1] = (c % SIDE + 0.5) * width - cfg["area"] - lane["r_V_N"][1]
        r[2] = -lane["r_V_N"][2]
        X, y, z = project(C, r, cfg["near"])
        if X > cfg["near"] and max(abs(y), abs(z)) < cfg["half_width"]:
            lane["covered"][c] = 1.0


@kernel
def worst_deviation(x, P, w):
    """The largest standard deviation of a line's place across it, m, and as a vector w in N, (3,).

    It is that of the mean of both ends' covariances, freed of what is along the line.
    """
    length = 0.0
    for j in range(3):
        w[j] = x[j + 3] - x[j]
        length += w[j] * w[j]
    length = math.sqrt(length)
    u0, u1, u2 = w[0] / length, w[1] / length, w[2] / length
    flat = math.sqrt(u0 * u0 + u1 * u1)
    if flat > 1e-3:  # a level axis across the line, and one across both
        a0, a1, a2 = -u1 / flat, u0 / flat, 0.0
    else:
        a0, a1, a2 = 1.0, 0.0, 0.0
    b0, b1, b2 = u1 * a2 - u2 * a1, u2 * a0 - u0 * a2, u0 * a1 - u1 * a0
    a, b = (a0, a1, a2), (b0, b1, b2)
    aa = ab = bb = 0.0
    for i in range(3):
        for j in range(3):
            s = 0.5 * (P[i, j] + P[i + 3, j + 3])
            aa += a[i] * s * a[j]
            ab += a[i] * s * b[j]
            bb += b[i] * s * b[j]
    angle = 0.5 * math.atan2(2.0 * ab, aa - bb)
    c, s = math.cos(angle), math.sin(angle)
    deviation = math.sqrt(max(c * c * aa + 2.0 * c * s * ab + s * s * bb, 0.0))
    for j in range(3):
        w[j] = deviation * (c * a[j] + s * b[j])
    return deviation


@kernel
def describe(lane, cfg, work):
    """Write the row's lines: those with the largest deviations, the largest first."""
    m, order, count = lane["map"], work["order"], 0
    lane["lines"] = 0.0
    for j in range(m["used"]):
        if m["alive"][j] == 0.0:
            continue
        lane["lines"] += 1.0
        work["deviation"][j] = worst_deviation(m["x"][j], m["P"][j], work["worst"][j])
        k = count
        while k > 0 and work["deviation"][order[k - 1]] < work["deviation"][j]:
            if k < TOKENS:
                order[k] = order[k - 1]
            k -= 1
        if k < TOKENS:
            order[k] = j
        count = min(count + 1, TOKENS)
    for k in range(TOKENS):
        write_token(lane, k, order[k] if k < count else -1, cfg, work)


@kernel
def write_token(lane, k, j, cfg, work):
    """Write line j into place k of the row, or zeros for j = -1."""
    m, there = lane["map"], 1.0 if j >= 0 else 0.0
    for i in range(3):
        first = m["x"][j, i] - lane["r_V_N"][i] if j >= 0 else 0.0
        last = m["x"][j, i + 3] - lane["r_V_N"][i] if j >= 0 else 0.0
        lane["rhat_1_N"][k, i], lane["rhat_2_N"][k, i] = first, last
        lane["worst_N"][k, i] = work["worst"][j, i] if j >= 0 else 0.0
    lane["age"][k] = m["unseen"][j] * cfg["dt"] / cfg["images"] if j >= 0 else 0.0
    lane["in_view"][k] = m["in_view"][j] if j >= 0 else 0.0
    lane["valid"][k] = there


@kernel
def compare(lane, cfg, work):
    """Write the map's mean error and deviation over the length of all edges, from 0 to 1.

    Both are in units of error_scale and at most 1, which they are where there is no line. The error
    is the distance of points of an edge from the nearest line that began with it.
    """
    m, gap, doubt, scale = lane["map"], work["gap"], work["doubt"], cfg["error_scale"]
    for e in range(lane["edges"]):
        doubt[e] = scale
        for s in range(SAMPLES):
            gap[e, s] = scale * scale
    for j in range(m["used"]):
        e = int(m["owner"][j])
        if m["alive"][j] > 0.0 and 0 <= e < lane["edges"]:
            doubt[e] = min(doubt[e], work["deviation"][j])
            for s in range(SAMPLES):
                gap[e, s] = min(gap[e, s], square_distance(lane["edge"][e], s, m["x"][j]))
    total, error, deviation = 0.0, 0.0, 0.0
    for e in range(lane["edges"]):
        edge, length, mean = lane["edge"][e], 0.0, 0.0
        for i in range(3):
            length += (edge[i + 3] - edge[i]) ** 2
        for s in range(SAMPLES):
            mean += math.sqrt(gap[e, s]) / (SAMPLES * scale)
        length = math.sqrt(length)
        total += length
        error += length * mean
        deviation += length * doubt[e] / scale
    lane["map_error"] = error / total if total > 0.0 else 0.0
    lane["map_deviation"] = deviation / total if total > 0.0 else 0.0


@kernel
def square_distance(edge, s, x):
    """Squared distance of sample s of an edge (6,) from the segment between a line's ends, m^2."""
    t, dot, square, out = (s + 0.5) / SAMPLES, 0.0, 0.0, 0.0
    for i in range(3):
        p, d = edge[i] + t * (edge[i + 3] - edge[i]) - x[i], x[i + 3] - x[i]
        dot += p * d
        square += d * d
    along = min(max(dot / square, 0.0), 1.0) if square > 0.0 else 0.0
    for i in range(3):
        p = edge[i] + t * (edge[i + 3] - edge[i]) - x[i]
        out += (p - along * (x[i + 3] - x[i])) ** 2
    return out
