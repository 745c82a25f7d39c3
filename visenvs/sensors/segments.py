"""A camera that measures line segments: the edges of solids, as far as the picture shows them.

A scene holds straight edges and the convex solids that they bound. An edge is clipped to the near
plane and the picture before it is projected. With hidden lines removed, an edge is dropped if both
faces beside it are turned away, and what lies behind another solid is cut out of it, exactly.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from visenvs.core.compile import kernel
from visenvs.core.frames import rotate
from visenvs.core.noise import normal_pair, uniform_pair

FACES = 6  # that a solid has at most
CORNERS = 3 + FACES  # of a triangle that is cut by them, at most
PIECES = 4  # of an edge that are left beside the solids before it
DRAWS = 8  # of a piece of an edge in an image
FALSE = 1 << 24  # first draw of a false segment
NOBODY = -1.0  # label of a false segment
GAP = 0.05  # between the two parts of a split segment, of its length


def scene_columns(edges: int, solids: int) -> list[Any]:
    """Columns of a record with a scene, with room for so many edges and solids.

    edge: ends in N, m. solid, face: of which solid, and between which two of its faces; -1 for
    none. plane: n and b of the faces n x <= b of a solid, unit normals outwards, N, m.
    """
    return [
        ("edges", "i8"),
        ("solids", "i8"),
        ("edge", "f8", (edges, 6)),
        ("solid", "i8", (edges,)),
        ("face", "i8", (edges, 2)),
        ("faces", "i8", (solids,)),
        ("plane", "f8", (solids, FACES, 4)),
    ]


SCRATCH = np.dtype(
    [
        ("r", "f8", (3,)),
        ("q", "f8", (2, 3)),
        ("pieces", "f8", (PIECES, 2)),
        ("left", "f8", (2 * PIECES, 2)),
        ("polygon", "f8", (2, CORNERS, 2)),
        ("f", "f8", (3, FACES)),
        ("interval", "f8", (2,)),
        ("point", "f8", (4,)),
    ]
)


@kernel
def take_segments(scene, C, r_V, cfg, seed, episode, step, stream, seen, cut, labels, work):
    """Measure the segments of an image; returns how many there are.

    Args:
        scene: a record with `scene_columns`.
        C, r_V: camera attitude C_CN (3, 3) and position in N, m, (3,).
        cfg: record with near (m), half_width and min_length (focal lengths), sigma_image, p_detect,
            p_split, p_false, and hidden: 1 to remove hidden lines.
        seed, episode, step, stream: name the draws (`core.noise`).
        seen: receives (y_1, z_1, y_2, z_2), focal lengths, ends in random order, (rows, 4).
        cut: receives 1 for ends that the picture's edge cut off, (rows, 2).
        labels: receives the number of the edge, or NOBODY, (rows,).
        work: a SCRATCH record.
    """
    count, pieces = 0, work["pieces"]
    for e in range(scene["edges"]):
        if cfg["hidden"] > 0 and turned_away(scene, e, r_V):
            continue
        if not clip(scene["edge"][e], C, r_V, cfg, work):
            continue
        first, last = pieces[0, 0], pieces[0, 1]
        parts = hide(scene, e, r_V, work) if cfg["hidden"] > 0 else 1
        for k in range(parts):
            ends = (pieces[k, 0], pieces[k, 1])
            at_edge = (ends[0] == first and first > 0.0, ends[1] == last and last < 1.0)
            draw = (seed, episode, stream, step, DRAWS * (PIECES * e + k))
            count = measure(e, ends, at_edge, cfg, draw, seen, cut, labels, count, work)
    return add_false(cfg, (seed, episode, stream, step, FALSE), seen, cut, labels, count)


@kernel
def clip(edge, C, r_V, cfg, work):
    """Write the part [first, last] of an edge that lies in the picture as pieces[0]; False if none.

    Its ends in C stay in work["q"].
    """
    q, r, width, low, high = work["q"], work["r"], cfg["half_width"], 0.0, 1.0
    for i in range(2):
        for j in range(3):
            r[j] = edge[3 * i + j] - r_V[j]
        q[i, 0], q[i, 1], q[i, 2] = rotate(C, r)
    for k in range(5):  # near plane, right, left, lower and upper edge
        if k == 0:
            a, b = q[0, 0] - cfg["near"], q[1, 0] - cfg["near"]
        else:
            axis, sign = (k + 1) // 2, (1.0 if k % 2 else -1.0)
            a = width * q[0, 0] - sign * q[0, axis]
            b = width * q[1, 0] - sign * q[1, axis]
        if a < 0.0 and b < 0.0:
            return False
        if a < 0.0:
            low = max(low, a / (a - b))
        elif b < 0.0:
            high = min(high, a / (a - b))
    work["pieces"][0, 0], work["pieces"][0, 1] = low, high
    return low < high


@kernel
def turned_away(scene, e, r_V):
    """Whether the camera sees neither of the two faces beside an edge."""
    solid = scene["solid"][e]
    if solid < 0:
        return False
    for k in range(2):
        n = scene["plane"][solid, scene["face"][e, k]]
        if n[0] * r_V[0] + n[1] * r_V[1] + n[2] * r_V[2] > n[3]:
            return False
    return True


@kernel
def hide(scene, e, r_V, work):
    """Cut out of pieces[0] what other solids hide; returns how many pieces are left."""
    pieces, left, parts = work["pieces"], work["left"], 1
    for b in range(scene["solids"]):
        if b == scene["solid"][e] or not behind(scene, b, scene["edge"][e], r_V, work):
            continue
        low, high, kept = work["interval"][0], work["interval"][1], 0
        for k in range(parts):
            first, last = pieces[k, 0], pieces[k, 1]
            if first < low:
                left[kept, 0], left[kept, 1] = first, min(last, low)
                kept += 1
            if last > high:
                left[kept, 0], left[kept, 1] = max(first, high), last
                kept += 1
        parts = min(kept, PIECES)
        for k in range(parts):
            pieces[k, 0], pieces[k, 1] = left[k, 0], left[k, 1]
    return parts


@kernel
def behind(scene, b, edge, r_V, work):
    """Whether solid b hides a part of an edge, and which, of its length, as work["interval"].

    The triangle of camera and edge is cut by the solid's faces. Its points are
    r_V + v (edge_0 - r_V) + w (edge_1 - r_V); a corner (v, w) lies on the way to w / (v + w).
    """
    f, faces = work["f"], scene["faces"][b]
    for k in range(faces):
        n = scene["plane"][b, k]
        f[0, k] = n[0] * r_V[0] + n[1] * r_V[1] + n[2] * r_V[2] - n[3]
        f[1, k] = n[0] * edge[0] + n[1] * edge[1] + n[2] * edge[2] - n[3]
        f[2, k] = n[0] * edge[3] + n[1] * edge[4] + n[2] * edge[5] - n[3]
        if f[0, k] >= 0.0 and f[1, k] >= 0.0 and f[2, k] >= 0.0:
            return False
    polygon, corners = work["polygon"], 3
    polygon[0, 0, 0] = polygon[0, 0, 1] = polygon[0, 1, 1] = polygon[0, 2, 0] = 0.0
    polygon[0, 1, 0] = polygon[0, 2, 1] = 1.0
    for k in range(faces):
        corners = cut_polygon(polygon[k % 2], corners, f[:, k], polygon[1 - k % 2])
    low, high, last = 1.0, 0.0, polygon[faces % 2]
    for c in range(corners):
        total = last[c, 0] + last[c, 1]
        if total > 0.0:
            low, high = min(low, last[c, 1] / total), max(high, last[c, 1] / total)
    work["interval"][0], work["interval"][1] = low, high
    return low < high


@kernel
def cut_polygon(polygon, corners, f, out):
    """Write the part of a convex polygon with f_0 + v (f_1 - f_0) + w (f_2 - f_0) < 0.

    Args:
        polygon: corners (v, w), (n, 2), of which `corners` are in use.
        f: values at (0, 0), (1, 0) and (0, 1), (3,).
        out: receives the corners, (n, 2).

    Returns:
        How many corners are left (Sutherland and Hodgman 1974).
    """
    kept = 0
    for c in range(corners):
        before = c - 1 if c > 0 else corners - 1
        v, w, v0, w0 = polygon[c, 0], polygon[c, 1], polygon[before, 0], polygon[before, 1]
        here = f[0] + v * (f[1] - f[0]) + w * (f[2] - f[0])
        there = f[0] + v0 * (f[1] - f[0]) + w0 * (f[2] - f[0])
        if (here < 0.0) != (there < 0.0):
            s = there / (there - here)
            out[kept, 0], out[kept, 1] = v0 + s * (v - v0), w0 + s * (w - w0)
            kept += 1
        if here < 0.0:
            out[kept, 0], out[kept, 1] = v, w
            kept += 1
    return kept


@kernel
def measure(e, ends, at_edge, cfg, draw, seen, cut, labels, count, work):
    """Measure a piece of edge e, maybe in two parts; returns the count.

    Args:
        ends: where the piece begins and ends, of the edge.
        at_edge: whether the picture's edge cuts it off there.
        draw: names its first draw (`core.noise`).
    """
    q, point = work["q"], work["point"]
    for i in range(2):
        X = q[0, 0] + ends[i] * (q[1, 0] - q[0, 0])
        for j in range(2):
            point[2 * i + j] = (q[0, j + 1] + ends[i] * (q[1, j + 1] - q[0, j + 1])) / X
    length = math.hypot(point[2] - point[0], point[3] - point[1])
    if length < cfg["min_length"]:
        return count
    seed, episode, stream, step, first = draw
    chance, order = uniform_pair(seed, episode, stream, step, first)
    if chance >= cfg["p_detect"]:
        return count
    parts, middle = 1, 1.0
    if cfg["p_split"] > 0.0:
        split, place = uniform_pair(seed, episode, stream, step, first + 1)
        if split < cfg["p_split"]:
            parts, middle = 2, 0.3 + 0.4 * place
    for part in range(min(parts, seen.shape[0] - count)):
        first_end = 0.0 if part == 0 else middle + 0.5 * GAP
        last_end = 1.0 if part == parts - 1 else middle - 0.5 * GAP
        for i in range(2):
            s = last_end if (i == 1) != (order < 0.5) else first_end
            noise = normal_pair(seed, episode, stream, step, first + 2 + 2 * part + i)
            for j in range(2):
                at = point[j] + s * (point[2 + j] - point[j])
                seen[count, 2 * i + j] = at + cfg["sigma_image"] * noise[j]
            off = (s == 0.0 and at_edge[0]) or (s == 1.0 and at_edge[1])
            cut[count, i] = 1.0 if off else 0.0
        labels[count] = e
        count += 1
    return count


@kernel
def add_false(cfg, draw, seen, cut, labels, count):
    """Add a segment of nothing somewhere in the picture, with chance p_false; returns the count."""
    if cfg["p_false"] > 0.0 and count < seen.shape[0]:
        seed, episode, stream, step, first = draw
        chance, turn = uniform_pair(seed, episode, stream, step, first)
        if chance < cfg["p_false"]:
            y, z = uniform_pair(seed, episode, stream, step, first + 1)
            angle, reach = 2.0 * math.pi * turn, 0.3 * cfg["half_width"]
            y, z = (1.4 * y - 0.7) * cfg["half_width"], (1.4 * z - 0.7) * cfg["half_width"]
            seen[count, 0] = y - reach * math.cos(angle)
            seen[count, 1] = z - reach * math.sin(angle)
            seen[count, 2] = y + reach * math.cos(angle)
            seen[count, 3] = z + reach * math.sin(angle)
            cut[count, 0] = cut[count, 1] = 0.0
            labels[count] = NOBODY
            count += 1
    return count
