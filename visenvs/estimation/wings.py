"""What filters share of a leader seen by a camera: its direction, and the angle of its wing tips.

The direction is measured by two angles across the predicted line of sight, to the right and down;
the wing tips of a leader of wingspan b at range r subtend 2 atan(b / (2 r)) (thesis (2.23)).
"""

from __future__ import annotations

import math

from visenvs.core.compile import kernel

TINY = 1e-9


@kernel
def tangents(u, sight, H, residual):
    """Write the measured direction's two angles off the predicted one, and their slopes by u.

    Args:
        u: predicted direction, a unit vector in N; (3,) or longer.
        sight: record with u_N, the measured one.
        H: rows 0 and 1 receive the axes to the right and down in their first three columns.
        residual: [0] and [1] are written, rad.
    """
    flat = max(math.hypot(u[0], u[1]), TINY)
    H[0, 0], H[0, 1], H[0, 2] = -u[1] / flat, u[0] / flat, 0.0
    H[1, 0], H[1, 1], H[1, 2] = -u[2] * u[0] / flat, -u[2] * u[1] / flat, flat
    z = sight["u_N"]
    for i in range(2):
        residual[i] = H[i, 0] * z[0] + H[i, 1] * z[1] + H[i, 2] * z[2]


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
