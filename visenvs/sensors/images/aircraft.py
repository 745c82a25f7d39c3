"""An aircraft as a mesh, drawn by a z-buffer at four times the picture's resolution.

Averaged down, that covers pixels in part, so that wings one or two pixels thick keep their place.
"""

from __future__ import annotations

import math
from itertools import pairwise

import cv2
import numpy as np
from numpy.typing import NDArray

from visenvs.core.compile import kernel
from visenvs.sensors.images.optics import Image, Optics, Values

SUPER = 4  # samples of a pixel, each way
MARGIN = 2  # of the region drawn, pixels
SPAN = 2.667  # of the mesh, m: 8.75 ft


def _tube(stations: list[tuple[float, float]], sides: int = 6) -> list[Values]:
    """Triangles around the body axis through (x, radius) stations."""
    angles = np.linspace(0.0, 2.0 * math.pi, sides, endpoint=False)
    rings = [
        np.stack([np.full(sides, x), r * np.cos(angles), r * np.sin(angles)], axis=1)
        for x, r in stations
    ]
    out: list[Values] = []
    for one, other in pairwise(rings):
        for k in range(sides):
            m = (k + 1) % sides
            out += [np.array([one[k], other[k], other[m]]), np.array([one[k], other[m], one[m]])]
    return out


def _slab(corners: Values, normal: int, thickness: float) -> list[Values]:
    """A quadrilateral (4, 3) with a thickness along an axis, both faces and the rim."""
    offset = np.zeros(3)
    offset[normal] = 0.5 * thickness
    upper, lower = corners - offset, corners + offset
    out: list[Values] = []
    for face in (upper, lower):
        out += [face[[0, 1, 2]], face[[0, 2, 3]]]
    for k in range(4):
        m = (k + 1) % 4
        out += [np.array([upper[k], lower[k], lower[m]]), np.array([upper[k], lower[m], upper[m]])]
    return out


def _mesh() -> Values:
    """Triangles in the body frame (forward, right, down) from the wing's middle, m, (n, 3, 3)."""
    half = SPAN / 2
    body = _tube([(0.75, 0.02), (0.6, 0.1), (0.1, 0.12), (-0.5, 0.07), (-1.15, 0.03)])
    wing = [
        np.array([[0.2, 0.0, -0.12], [0.1, side * half, -0.14], [-0.12, side * half, -0.14],
                  [-0.2, 0.0, -0.12]])
        for side in (-1.0, 1.0)
    ]  # fmt: skip
    tail = np.array([[-0.9, -0.42, 0.0], [-0.9, 0.42, 0.0], [-1.12, 0.42, 0.0],
                     [-1.12, -0.42, 0.0]])  # fmt: skip
    fin = np.array([[-0.85, 0.0, 0.0], [-1.05, 0.0, -0.36], [-1.18, 0.0, -0.36],
                    [-1.15, 0.0, 0.0]])  # fmt: skip
    slabs = [_slab(part, 2, 0.05) for part in (*wing, tail)] + [_slab(fin, 1, 0.04)]
    triangles = np.array(body + [triangle for slab in slabs for triangle in slab])
    return triangles + np.array([0.0, 0.0, 0.14])


MESH = _mesh()
WING_TIPS = np.array([[-0.01, -SPAN / 2, 0.0], [-0.01, SPAN / 2, 0.0]])  # left, right, m


def draw_aircraft(
    frame: Image,
    optics: Optics,
    C: Values,
    r: Values,
    C_BN: Values,
    colour: tuple[float, float, float] = (200.0, 60.0, 50.0),
    sun: tuple[float, float, float] = (-0.35, -0.4, -0.85),
    span: float = SPAN,
) -> None:
    """Draw an aircraft on an RGB picture, in place.

    Args:
        frame: RGB.
        optics, C: the camera and its attitude C_CN, (3, 3).
        r: of the middle of its wing relative to the camera, N, m, (3,).
        C_BN: its attitude, (3, 3).
        colour: RGB in full light.
        sun: direction to the light, N.
        span: from wing tip to wing tip, m.
    """
    vertices = (span / SPAN * MESH @ C_BN + r) @ (optics.matrix @ C).T
    depth = vertices[..., 2]
    if depth.min() <= 0.5:
        return
    pixels = vertices[..., :2] / depth[..., None]
    low = np.maximum(np.floor(pixels.min(axis=(0, 1))) - MARGIN, 0.0).astype(int)
    high = np.ceil(pixels.max(axis=(0, 1))) + MARGIN
    high = np.minimum(high, [optics.width - 1, optics.height - 1]).astype(int)
    if (high <= low).any():
        return
    columns, rows = high - low + 1
    shine = brightness(MESH, C_BN, np.array(sun))
    grid = np.concatenate([(pixels - low + 0.5) * SUPER - 0.5, depth[..., None]], axis=2)
    shades = np.zeros((rows * SUPER, columns * SUPER), np.float32)
    cover = np.zeros_like(shades)
    nearest = np.zeros_like(shades)
    fill_triangles(grid, shine, nearest, shades, cover)
    size = (int(columns), int(rows))
    alpha = cv2.resize(cover, size, interpolation=cv2.INTER_AREA)[..., None]
    shade = cv2.resize(shades, size, interpolation=cv2.INTER_AREA)[..., None]
    part = frame[low[1] : high[1] + 1, low[0] : high[0] + 1]
    part[:] = np.rint((1.0 - alpha) * part + shade * np.array(colour, np.float32))


def brightness(mesh: Values, C_BN: Values, sun: Values) -> NDArray[np.float32]:
    """Brightness of every triangle, lit from both sides, in [0.45, 1], (n,)."""
    normals = np.cross(mesh[:, 1] - mesh[:, 0], mesh[:, 2] - mesh[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    cosine = np.abs(normals @ C_BN @ (sun / np.linalg.norm(sun)))
    return (0.45 + 0.55 * cosine).astype(np.float32)


@kernel
def fill_triangles(grid, shine, nearest, shades, cover):
    """Draw triangles (n, 3, (u, v, depth)) into a buffer, the nearest on top.

    Args:
        grid: corners in samples, and their depths, m.
        shine: brightness of every triangle, (n,).
        nearest: 1 / depth of what is drawn already, 0 for nothing, (rows, columns).
        shades, cover: brightness, and 1 where something is, (rows, columns).
    """
    rows, columns = nearest.shape
    for n in range(grid.shape[0]):
        u0, v0 = grid[n, 0, 0], grid[n, 0, 1]
        au, av = grid[n, 1, 0] - u0, grid[n, 1, 1] - v0
        bu, bv = grid[n, 2, 0] - u0, grid[n, 2, 1] - v0
        area = au * bv - av * bu
        if area == 0.0:
            continue
        i0, i1, i2 = 1.0 / grid[n, 0, 2], 1.0 / grid[n, 1, 2], 1.0 / grid[n, 2, 2]
        first = max(math.ceil(u0 + min(0.0, au, bu)), 0)
        last = min(math.floor(u0 + max(0.0, au, bu)), columns - 1)
        upper = max(math.ceil(v0 + min(0.0, av, bv)), 0)
        lower = min(math.floor(v0 + max(0.0, av, bv)), rows - 1)
        for v in range(upper, lower + 1):
            for u in range(first, last + 1):
                s = ((u - u0) * bv - (v - v0) * bu) / area
                t = ((v - v0) * au - (u - u0) * av) / area
                if s >= 0.0 and t >= 0.0 and s + t <= 1.0:
                    inverse = i0 + s * (i1 - i0) + t * (i2 - i0)
                    if inverse > nearest[v, u]:
                        nearest[v, u] = inverse
                        shades[v, u] = shine[n]
                        cover[v, u] = 1.0
