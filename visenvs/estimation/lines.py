"""A straight edge in space, estimated by its two ends from line segments in images (thesis 2.4).

State: the ends X_1, X_2 in N, m, shape (6,), covariance (6, 6). It is static and has no process
noise. A segment is (y_1, z_1, y_2, z_2), image points in focal lengths, its ends in any order.

With u from the image of end 1 to that of end 2 and n across it, a segment has the residuals
d_i = n (x_i - p_1) (2.36) and e_i = u (x_i - p_i) (2.37). The printed e_2 takes p_1, so that a
perfect match would have the residual |l|. Noise of the same size in all coordinates of an image
makes all four independent.
"""

from __future__ import annotations

import math

import numpy as np

from visenvs.core.compile import kernel
from visenvs.core.frames import rotate
from visenvs.core.pinhole import jacobian
from visenvs.estimation.ekf import update_sequential

KINDS = ("four", "d-only", "printed")  # which residuals are used, in the order of the codes
FOUR, D_ONLY, PRINTED = range(3)
SHORTEST = 1e-6  # image of a line that has a direction, focal lengths

SIGHT = np.dtype(
    [
        ("t", "f8", (2,)),  # where the part before the camera begins and ends, of X_1 to X_2
        ("q", "f8", (2, 3)),  # its ends in C
        ("p", "f8", (2, 2)),  # their images
        ("u", "f8", (2,)),  # direction of the image
        ("length", "f8"),  # of the image
        ("along", "f8", (2, 6)),  # derivatives by the state of both image points along u
        ("across", "f8", (2, 6)),  # and across it
    ]
)
SCRATCH = np.dtype(
    [
        ("sight", SIGHT),
        ("J", "f8", (2, 3)),
        ("r", "f8", (3,)),
        ("x", "f8", (4,)),  # a segment in the order of the line's ends
        ("s", "f8", (2,)),  # where its ends lie along the line's image, of its length
        ("H", "f8", (4, 6)),
        ("residual", "f8", (4,)),
        ("variance", "f8", (4,)),
        ("B", "f8", (4, 6)),
        ("S", "f8", (4,)),
        ("W", "f8", (6, 6)),
        ("true_end", "f8", (2,)),
        ("y", "f8", (6,)),  # another state
    ]
)


@kernel
def sight(x, C, r_V, nearest, out, r):
    """Write the image of a line, cut off at depth `nearest` (m); False where there is none.

    There is none for a line behind the camera, or one that points at it.

    Args:
        x: state, (6,).
        C, r_V: camera attitude C_CN (3, 3) and position in N, m, (3,).
        out: a SIGHT record.
        r: scratch, (3,).
    """
    q, p, t = out["q"], out["p"], out["t"]
    for i in range(2):
        for j in range(3):
            r[j] = x[3 * i + j] - r_V[j]
        q[i, 0], q[i, 1], q[i, 2] = rotate(C, r)
    first, last = q[0, 0], q[1, 0]
    if first <= nearest and last <= nearest:
        return False
    t[0] = (nearest - first) / (last - first) if first < nearest else 0.0
    t[1] = (nearest - first) / (last - first) if last < nearest else 1.0
    for j in range(3):
        a, b = q[0, j], q[1, j] - q[0, j]
        q[0, j], q[1, j] = a + t[0] * b, a + t[1] * b
    for i in range(2):
        p[i, 0], p[i, 1] = q[i, 1] / q[i, 0], q[i, 2] / q[i, 0]
    y, z = p[1, 0] - p[0, 0], p[1, 1] - p[0, 1]
    out["length"] = math.sqrt(y * y + z * z)
    if not out["length"] > SHORTEST:
        return False
    out["u"][0], out["u"][1] = y / out["length"], z / out["length"]
    return True


@kernel
def slopes(C, out, J):
    """Complete a SIGHT by the derivatives of its image points; `J` is scratch, (2, 3).

    An end that is cut off at the near plane moves along the line as if it were a fixed mixture of
    both ends: what it moves along the line is no matter of distances from it.
    """
    u, t = out["u"], out["t"]
    for i in range(2):
        jacobian(C, out["q"][i, 0], out["p"][i, 0], out["p"][i, 1], J)
        for j in range(3):
            along = u[0] * J[0, j] + u[1] * J[1, j]
            across = u[0] * J[1, j] - u[1] * J[0, j]
            out["along"][i, j], out["along"][i, j + 3] = (1.0 - t[i]) * along, t[i] * along
            out["across"][i, j], out["across"][i, j + 3] = (1.0 - t[i]) * across, t[i] * across


@kernel
def in_order(view, segment, x, s):
    """Write a segment with its ends in the order of the line's, and where they lie along its image.

    Of both orders this is the one with the smaller e_1^2 + e_2^2. Returns whether it is reversed.
    """
    u, p = view["u"], view["p"]
    turned = u[0] * (segment[2] - segment[0]) + u[1] * (segment[3] - segment[1]) < 0.0
    for i in range(2):
        k = 2 * (1 - i) if turned else 2 * i
        x[2 * i], x[2 * i + 1] = segment[k], segment[k + 1]
        s[i] = u[0] * (x[2 * i] - p[0, 0]) + u[1] * (x[2 * i + 1] - p[0, 1])
        s[i] /= view["length"]
    return turned


@kernel
def linearise(view, x, s, residual, H):
    """Write the residuals (d_1, d_2, e_1, e_2) of an ordered segment, and H = - d residual / dX.

    The rows of d_i are exactly (1 - s_i) and s_i times those of the line's ends.

    Args:
        view: SIGHT with `slopes`.
        x, s: from `in_order`.
        residual, H: written, (4,) and (4, 6).
    """
    u, p, along, across = view["u"], view["p"], view["along"], view["across"]
    for i in range(2):
        d = u[0] * (x[2 * i + 1] - p[0, 1]) - u[1] * (x[2 * i] - p[0, 0])
        residual[i] = d
        residual[i + 2] = (s[i] - i) * view["length"]
        for j in range(6):
            H[i, j] = (1.0 - s[i]) * across[0, j] + s[i] * across[1, j]
            turning = (across[1, j] - across[0, j]) / view["length"]
            H[i + 2, j] = along[i, j] - d * turning


@kernel
def update(x, P, C, r_V, segment, true_end, cfg, scratch):
    """Use one segment, linearised at the present estimate, in place; False if it has no image.

    Several segments of one line are used one after the other, each linearised anew.

    Args:
        true_end: 1 for the ends of the segment (in its own order) at which the edge is known to
            end, (2,): those have residuals e_i, if the line's own end is before the camera and
            within e_gate standard deviations of it.
        cfg: record with near (m), sigma_image (focal lengths), estimator, e_gate.
        scratch: a SCRATCH record.
    """
    out, H = scratch["sight"], scratch["H"]
    residual, variance = scratch["residual"], scratch["variance"]
    if not sight(x, C, r_V, cfg["near"], out, scratch["r"]):
        return False
    slopes(C, out, scratch["J"])
    turned = in_order(out, segment, scratch["x"], scratch["s"])
    linearise(out, scratch["x"], scratch["s"], residual, H)
    noise, rows = cfg["sigma_image"] ** 2, 2
    for i in range(2):
        shown = true_end[1 - i if turned else i] > 0.0 and out["t"][i] == i
        if cfg["estimator"] == FOUR and shown:
            spread = noise + quadratic(P, H[i + 2])
            if residual[i + 2] ** 2 <= cfg["e_gate"] ** 2 * spread:
                residual[rows] = residual[i + 2]
                for j in range(6):
                    H[rows, j] = H[i + 2, j]
                rows += 1
    for i in range(rows):
        variance[i] = noise
    update_sequential(
        x, P, H[:rows], residual[:rows], variance[:rows], 0.0, scratch["B"], scratch["S"]
    )
    return True


@kernel
def quadratic(P, h):
    """The variance h' P h of a row h (6,)."""
    total = 0.0
    for a in range(6):
        row = 0.0
        for b in range(6):
            row += P[a, b] * h[b]
        total += h[a] * row
    return total


@kernel
def begin(x, P, C, r_V, segment, cfg, r):
    """Start a line from a segment, taking it to lie in the plane of zero altitude (2.42).

    The deviation of each end is s_ray along its ray, and what the image noise makes at its depth
    across. The same in all directions would let the ends slide along the line.

    Args:
        cfg: record with horizon (least downward component of a ray of unit depth), s_ray (m),
            range_max (m), sigma_image.
        r: scratch, (3,).

    Returns:
        False, and nothing written, if a ray is too near to the horizon or ends beyond range_max.
    """
    for i in range(2):
        down = C[0, 2] + C[1, 2] * segment[2 * i] + C[2, 2] * segment[2 * i + 1]
        if down < cfg["horizon"] or -r_V[2] / down > cfg["range_max"] or r_V[2] >= 0.0:
            return False
    for a in range(6):
        for b in range(6):
            P[a, b] = 0.0
    for i in range(2):
        y, z = segment[2 * i], segment[2 * i + 1]
        for j in range(3):
            r[j] = C[0, j] + C[1, j] * y + C[2, j] * z
        depth = -r_V[2] / r[2]
        square = r[0] * r[0] + r[1] * r[1] + r[2] * r[2]
        across = (cfg["sigma_image"] * depth) ** 2
        for j in range(3):
            x[3 * i + j] = r_V[j] + depth * r[j]
            for k in range(3):
                P[3 * i + j, 3 * i + k] = (cfg["s_ray"] ** 2 - across) * r[j] * r[k] / square
            P[3 * i + j, 3 * i + j] += across
    return True


@kernel
def slide(x, P, end, share, variance, W):
    """Move one end of a line along it, to X_end + share (X_other - X_end), with its covariance.

    Args:
        end: 0 or 1.
        share: of the way to the other end; negative lengthens the line.
        variance: of the new place along the line, added to that which the old ends imply, m^2.
        W: scratch, (6, 6).
    """
    mine, other, square = 3 * end, 3 * (1 - end), 0.0
    for j in range(3):
        square += (x[other + j] - x[mine + j]) ** 2
    for a in range(6):
        for b in range(6):
            W[a, b] = P[a, b]
    for j in range(3):  # rows, then columns, of T P T'
        for b in range(6):
            W[mine + j, b] = (1.0 - share) * P[mine + j, b] + share * P[other + j, b]
    for a in range(6):
        for b in range(6):
            P[a, b] = W[a, b]
    for j in range(3):
        for a in range(6):
            P[a, mine + j] = (1.0 - share) * W[a, mine + j] + share * W[a, other + j]
    for j in range(3):
        for k in range(3):
            reach = (x[other + j] - x[mine + j]) * (x[other + k] - x[mine + k])
            P[mine + j, mine + k] += variance * reach / square
    for j in range(3):
        x[mine + j] += share * (x[other + j] - x[mine + j])
