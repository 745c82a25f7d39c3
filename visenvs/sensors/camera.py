"""A camera that measures the image point of a target: field of view, dropouts and pixel noise."""

from __future__ import annotations

import math

from visenvs.core.compile import kernel
from visenvs.core.noise import normal_pair, uniform
from visenvs.core.pinhole import pixel_variance, project


@kernel
def in_view(X, y, z, min_range, half_width):
    """Whether a point is far enough ahead and inside the square image of that half width."""
    return X > min_range and abs(y) < half_width and abs(z) < half_width


@kernel
def take_image(C, r, settings, seed, episode, step, stream, pixel):
    """Measure the image point of a target; False, and `pixel` untouched, where there is none.

    Args:
        C: camera attitude C_CN, (3, 3).
        r: true position of the target relative to the camera in N, m, (3,).
        settings: record with min_range (m), half_width, p_detect, sigma_range (m), sigma_angle.
        seed, episode, step, stream: name the draws (`core.noise`): 0 for noise, 1 for detection.
        pixel: receives the measured (y, z), shape (2,).
    """
    X, y, z = project(C, r, settings["min_range"])
    if not in_view(X, y, z, settings["min_range"], settings["half_width"]):
        return False
    if (
        settings["p_detect"] < 1.0
        and uniform(seed, episode, stream, step, 1) >= settings["p_detect"]
    ):
        return False
    sd = math.sqrt(pixel_variance(X, settings["sigma_range"], settings["sigma_angle"]))
    noise_y, noise_z = normal_pair(seed, episode, stream, step, 0)
    pixel[0] = y + sd * noise_y
    pixel[1] = z + sd * noise_z
    return True
