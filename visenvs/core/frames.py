"""Frames and rotations.

N: local north-east-down. C: camera, x along the optical axis, y right, z down. A direction cosine
matrix `C_CN` maps components in N to components in C. Headings are clockwise positive from above.
"""

from __future__ import annotations

import math

from visenvs.core.compile import kernel

TINY = 1e-100  # a length with no direction


@kernel
def wrap_angle(angle):
    """The same angle in [-pi, pi], rad."""
    return (angle + math.pi) % (2.0 * math.pi) - math.pi


@kernel
def direction(azimuth, elevation):
    """Unit vector in N at an azimuth (clockwise from north) and an elevation (up positive), rad."""
    c = math.cos(elevation)
    return c * math.cos(azimuth), c * math.sin(azimuth), -math.sin(elevation)


@kernel
def camera_towards(r, C):
    """Write the attitude of a gimballed camera that looks along `r` with a level horizon.

    Args:
        r: where to look, relative to the camera, in N, shape (3,). Straight up or down, and the
            zero vector, keep the horizon axis east.
        C: the direction cosine matrix C_CN is written here, shape (3, 3).
    """
    flat = math.sqrt(r[0] * r[0] + r[1] * r[1])
    length = math.sqrt(flat * flat + r[2] * r[2])
    north, east, level, steep = 1.0, 0.0, 1.0, 0.0
    if flat > TINY:
        north, east = r[0] / flat, r[1] / flat
    if length > TINY:
        level, steep = flat / length, r[2] / length
    C[0, 0], C[0, 1], C[0, 2] = level * north, level * east, steep
    C[1, 0], C[1, 1], C[1, 2] = -east, north, 0.0
    C[2, 0], C[2, 1], C[2, 2] = -steep * north, -steep * east, level


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
