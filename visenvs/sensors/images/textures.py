"""Seeded random textures, and the stacks of ever smaller copies that far surfaces are read from."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from visenvs.core.compile import kernel
from visenvs.core.noise import normal_pair

Values = NDArray[np.float64]

PERSISTENCE = 0.7  # amplitude of an octave over that of the one before
SHRINKING = 0.6  # deviation of a linearly interpolated grid over that of its nodes, about


@kernel
def fill_normal(out, seed, stream):
    """Fill an array (n,) with independent standard normal draws."""
    for i in range(0, out.shape[0], 2):
        first, second = normal_pair(seed, 0, stream, 0, i)
        out[i] = first
        if i + 1 < out.shape[0]:
            out[i + 1] = second


def white(shape: tuple[int, ...], seed: int, stream: int) -> Values:
    """Independent standard normal numbers that depend on nothing but seed and stream."""
    out = np.empty(int(np.prod(shape)))
    fill_normal(out, seed, stream)
    return out.reshape(shape)


def fractal(size: int, coarsest: int, octaves: int, seed: int, stream: int) -> NDArray[np.float32]:
    """Noise that is alike at all scales, shape (size, size), mean 0, deviation about 1.

    Each octave has twice the resolution, starting at `coarsest`, and 0.7 times the amplitude.
    """
    total, power = np.zeros((size, size), np.float32), 0.0
    for k in range(octaves):
        cells, weight = coarsest << k, PERSISTENCE**k
        grid = white((cells, cells), seed, stream + k).astype(np.float32)
        total += weight * cv2.resize(grid, (size, size), interpolation=cv2.INTER_LINEAR)
        power += weight * weight
    return total / np.float32(np.sqrt(power) * SHRINKING)


def periodic(size: int, exponent: float, seed: int, stream: int) -> Values:
    """Noise with spectrum 1 / f^exponent that repeats without a seam, in [0, 1], (size, size)."""
    f = np.fft.fftfreq(size)
    radius = np.hypot(f[:, None], f[None, :])
    radius[0, 0] = 1.0
    spectrum = np.fft.fft2(white((size, size), seed, stream)) / radius**exponent
    spectrum[0, 0] = 0.0
    field = np.fft.ifft2(spectrum).real
    return np.clip(0.5 + field / (4.0 * field.std()), 0.0, 1.0)


def pyramid(texture: NDArray[np.uint8], levels: int) -> list[NDArray[np.uint8]]:
    """The texture and copies of it, each half as large as the one before."""
    out = [texture]
    for _ in range(levels - 1):
        height, width = out[-1].shape[:2]
        half = cv2.resize(out[-1], (width // 2, height // 2), interpolation=cv2.INTER_AREA)
        out.append(half.astype(np.uint8, copy=False))
    return out


def packed(texture: Values, levels: int) -> NDArray[np.uint8]:
    """A square texture in [0, 1] with its smaller copies, one after the other, in one row."""
    copies = pyramid(np.rint(255.0 * texture).astype(np.uint8), levels)
    return np.concatenate([copy.ravel() for copy in copies])
