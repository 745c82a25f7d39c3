"""What the figures of image processing share: drawn cameras, and pictures of the open air."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from visenvs.sensors.images.exposure import Exposure, expose
from visenvs.sensors.images.optics import Image, Optics
from visenvs.sensors.images.outdoor import Outdoor, Sky, shared_outdoor

Values = NDArray[Any]
LENS = Exposure()


def turned(yaw: float, pitch: float, roll: float) -> Values:
    """DCM from N to a frame with these Euler angles (clockwise, up, to the right), rad, (3, 3)."""
    c, s = math.cos(yaw), math.sin(yaw)
    by_yaw = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    c, s = math.cos(pitch), math.sin(pitch)
    by_pitch = np.array([[c, 0.0, -s], [0.0, 1.0, 0.0], [s, 0.0, c]])
    c, s = math.cos(roll), math.sin(roll)
    return np.array([[1.0, 0.0, 0.0], [0.0, c, s], [0.0, -s, c]]) @ by_pitch @ by_yaw


def outside(rng: np.random.Generator, optics: Optics) -> tuple[Outdoor, Image, Values]:
    """A world, a picture from somewhere in it, and the attitude C_CN of the camera."""
    C = turned(rng.uniform(-3.1, 3.1), rng.uniform(-0.15, 0.15), rng.uniform(-0.3, 0.3))
    place = np.append(rng.uniform(-1e3, 1e3, 2), rng.uniform(-60.0, 40.0))
    world = shared_outdoor(int(rng.integers(2)), Sky())
    return world, world.render(optics, C, place), C


def taken(frame: Image, seed: int) -> Image:
    """The picture as the sensor gives it."""
    return expose(frame, LENS, seed, 0, 0, 0)


def rms(values: Any) -> float:
    """Root of the mean square; NaN for none."""
    return float(np.sqrt(np.mean(np.square(values)))) if len(values) else math.nan
