"""What lens and sensor do to a picture: blur, exposure, saturation, and noise.

Noise comes from a bank that is made once; where a picture's part of it begins is drawn from the
lane's own counter-based stream, so that a picture depends on its lane, episode and step alone.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from visenvs.core.noise import uniform_pair
from visenvs.sensors.images.optics import Image
from visenvs.sensors.images.textures import white

BANK_SEED, BANK_STREAM = 2013, 0
OFFSET, EXPOSURE = 0, 1  # draws of a picture's stream


@dataclass(frozen=True)
class Exposure:
    """How a picture comes out.

    Attributes:
        blur: standard deviation of the lens's blur, pixels; 0 for none.
        noise: standard deviation of a pixel, grey levels; 0 for none.
        gain_error: half width of the draw, once an episode, about a gain of 1.
    """

    blur: float = 0.6
    noise: float = 3.0
    gain_error: float = 0.15

    def __post_init__(self) -> None:
        if min(self.blur, self.noise) < 0.0 or not 0.0 <= self.gain_error < 1.0:
            raise ValueError(
                f"blur and noise must not be negative, and gain_error lies in [0, 1), got {self}; "
                "write `Exposure(blur=0.6, noise=3.0, gain_error=0.15)`"
            )


def expose(
    frame: Image, exposure: Exposure, seed: int, episode: int, stream: int, step: int
) -> Image:
    """The picture as the sensor gives it; `frame` may be overwritten.

    Args:
        frame: what the lens sees, grey or RGB.
        exposure: how it comes out.
        seed, episode, stream, step: name the draws (`core.noise`).
    """
    out: Any = frame
    if exposure.blur > 0.0:
        out = cv2.GaussianBlur(out, (3, 3), exposure.blur)
    if exposure.gain_error > 0.0:
        u, _ = uniform_pair(seed, episode, stream, 0, EXPOSURE)
        gain = 1.0 + exposure.gain_error * (2.0 * u - 1.0)
        out = cv2.LUT(out, np.clip(gain * np.arange(256.0), 0.0, 255.0).astype(np.uint8))
    if exposure.noise > 0.0:
        bank = noise_bank(frame.shape, exposure.noise)
        u, w = uniform_pair(seed, episode, stream, step, OFFSET)
        height, width = frame.shape[:2]
        top, left = int(u * height), int(w * width)
        part = bank[top : top + height, left : left + width]
        out = cv2.add(out, part, dtype=cv2.CV_8U)
    return out


@cache
def noise_bank(shape: tuple[int, ...], sigma: float) -> NDArray[np.int16]:
    """Noise of twice a picture's size in both directions, grey levels."""
    height, width, *channels = shape
    draws = white((2 * height, 2 * width, *channels), BANK_SEED, BANK_STREAM)
    return np.rint(sigma * draws).astype(np.int16)
