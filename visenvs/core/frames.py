"""Frames and rotations.

N: local north-east-down. C: camera, x along the optical axis, y right, z down. A direction cosine
matrix `C_CN` maps components in N to components in C. Headings are clockwise positive from above.
"""

from __future__ import annotations

import math

from visenvs.core.compile import kernel


@kernel
def wrap_angle(angle):
    """The same angle in [-pi, pi), rad."""
    return (angle + math.pi) % (2.0 * math.pi) - math.pi


@kernel
def direction(azimuth, elevation):
    """Unit vector in N at an azimuth (rad, clockwise from north) and an elevation (rad, up positive)."""
    c = math.cos(elevation)
    return c * math.cos(azimuth), c * math.sin(azimuth), -math.sin(elevation)


@kernel
def camera_towards(r, C):
    """Write the attitude of a gimballed camera that looks along `r` with a level horizon.

    Args:
        r: where to look, relative to the camera, in N, shape (3,). Straight up or down, and the zero
            vector, keep the horizon axis east.
        C: the direction cosine matrix C_CN is written here, shape (3, 3).
    """
    flat = math.sqrt(r[0] * r[0] + r[1] * r[1])
    length = math.sqrt(flat * flat + r[2] * r[2])
    if length == 0.0:
        x, y, z = 1.0, 0.0, 0.0
    else:
        x, y, z = r[0] / length, r[1] / length, r[2] / length
    if flat < 1e-12:
        east, north = 1.0, 0.0
    else:
        east, north = r[0] / flat, -r[1] / flat
    C[0, 0], C[0, 1], C[0, 2] = x, y, z
    C[1, 0], C[1, 1], C[1, 2] = north, east, 0.0
    C[2, 0], C[2, 1], C[2, 2] = -z * east, z * north, x * east - y * north


@kernel
def identity(C):
    """Write the identity into a square matrix."""
    for i in range(C.shape[0]):
        for j in range(C.shape[1]):
            C[i, j] = 1.0 if i == j else 0.0


@kernel
def rotate(C, r):
    """Components `C r` of a vector in another frame, as three floats."""
    return (
        C[0, 0] * r[0] + C[0, 1] * r[1] + C[0, 2] * r[2],
        C[1, 0] * r[0] + C[1, 1] * r[1] + C[1, 2] * r[2],
        C[2, 0] * r[0] + C[2, 1] * r[1] + C[2, 2] * r[2],
    )
