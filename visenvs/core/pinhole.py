"""Pinhole geometry with unit focal length: projection, Jacobian, and the noise of an image point.

Image point (y, z) = (Y/X, Z/X) of the relative position in C, dimensionless (thesis (2.5)-(2.6)
with f = 1).
It is geometry, so it lives in core: the filters measure with it and the guidance laws plan with it.
"""

from __future__ import annotations

from visenvs.core.compile import kernel
from visenvs.core.frames import rotate


@kernel
def project(C, r, nearest):
    """Depth X (m), at least `nearest`, and image point (y, z) of a relative position in N (2.6)."""
    depth, Y, Z = rotate(C, r)
    X = max(depth, nearest)
    return X, Y / X, Z / X


@kernel
def jacobian(C, X, y, z, H):
    """Write d(y, z)/dr at depth X and image point (y, z), shape (2, 3), 1/m.

    H = (1/X) [-h I] C_CN (thesis (3.14); the printed (4.39) lacks the factor C_CN).
    """
    inverse = 1.0 / X
    for j in range(3):
        H[0, j] = (C[1, j] - y * C[0, j]) * inverse
        H[1, j] = (C[2, j] - z * C[0, j]) * inverse


@kernel
def pixel_variance(X, sigma_range, sigma_angle):
    """Variance of one image coordinate at depth X: a constant part and a part that grows as 1/X^2.

    sigma_range (m) alone is the thesis's model (sigma / X)^2 (4.37), (4.68); sigma_angle is
    dimensionless. The two are independent, so that their variances add.
    """
    near = sigma_range / X
    return near * near + sigma_angle * sigma_angle
