"""A sensor that measures the bearing of a target and nothing else: dropouts and angular noise."""

from __future__ import annotations

from visenvs.core.bearing import bearing
from visenvs.core.compile import kernel
from visenvs.core.frames import wrap_angle
from visenvs.core.noise import normal, uniform


@kernel
def take_bearing(r, settings, seed, episode, step, stream, out):
    """Measure the bearing of a target; False, and `out` untouched, where there is none.

    Args:
        r: true position of the target relative to the sensor (north, east), m, shape (2,).
        settings: record with min_range (m), p_detect and sigma_bearing (rad).
        seed, episode, step, stream: name the draws (`core.noise`): 0 for noise, 1 for detection.
        out: receives the measured bearing, rad, shape (1,).
    """
    if not r[0] * r[0] + r[1] * r[1] > settings["min_range"] ** 2:
        return False
    if (
        settings["p_detect"] < 1.0
        and uniform(seed, episode, stream, step, 1) >= settings["p_detect"]
    ):
        return False
    noise = settings["sigma_bearing"] * normal(seed, episode, stream, step, 0)
    out[0] = wrap_angle(bearing(r) + noise)
    return True
