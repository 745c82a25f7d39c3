"""What filters share of a leader seen by a camera: its direction, and the angle of its wing tips.

The direction is measured by two angles across the predicted line of sight, to the right and down;
the wing tips of a leader of wingspan b at range r subtend 2 atan(b / (2 r)) (thesis (2.23)).
"""

from __future__ import annotations

import math

from visenvs.core.compile import kernel
from visenvs.core.frames import camera_towards, rotate


@kernel
def tangents(u, sight, C, H, residual):
    """Write the measured direction's two angles off the predicted one, and their slopes by u.

    Args:
        u: predicted direction, a unit vector in N; (3,) or longer.
        sight: record with u_N, the measured one.
        C: scratch, (3, 3); holds the axes along u, to the right and down on return.
        H: rows 0 and 1 receive the axes to the right and down in their first three columns.
        residual: [0] and [1] are written, rad.
    """
    camera_towards(u, C)
    for k in range(3):
        H[0, k], H[1, k] = C[1, k], C[2, k]
    _, residual[0], residual[1] = rotate(C, sight["u_N"])


@kernel
def first_look(x, own, sight, cfg):
    """Write direction, inverse range and wingspan of the first image into a polar state.

    A wing-tip angle gives the range as far as the wingspan is known, b / (2 tan(alpha / 2)), so the
    two errors belong together. Without one the range is what was told.

    Args:
        x: [0:3], [6] and [8] are written: u, 1/range (1/m) and b (m).
        own: record with size_told and range_told, m.
        sight: record with u_N and alpha (rad, 0 for none).
        cfg: record with sd_size, sd_range (relative) and sigma_image (rad).

    Returns:
        Variance of ln range, its covariance with ln b, and the variance of ln b.
    """
    for i in range(3):
        x[i] = sight["u_N"][i]
    b, alpha, var_b = own["size_told"], sight["alpha"], cfg["sd_size"] ** 2
    x[8] = b
    if alpha > 0.0:
        x[6] = 2.0 * math.tan(0.5 * alpha) / b
        return 2.0 * (cfg["sigma_image"] / math.sin(alpha)) ** 2 + var_b, var_b, var_b
    x[6] = 1.0 / own["range_told"]
    return cfg["sd_range"] ** 2, 0.0, var_b
