"""Settings of a camera and its filters, for the tests of the tracks."""

import math

import numpy as np
import pytest

from visenvs.core.sight import SENSORS
from visenvs.estimation.sighting import SCRATCH

SETTINGS = [
    *((name, "i8") for name in ("sensor", "reinit", "smoothing", "prior_covariance")),
    *((name, "f8") for name in ("sigma_range", "sigma_angle", "fade", "min_range")),
    *((name, "f8") for name in ("assumed_noise", "dt", "q", "q_range", "q_angle")),
    *((name, "f8") for name in ("half_width", "ztest_max", "delete_after")),
]
IISC = {  # angles, and the noise and process noise of the report
    "sigma_angle": 0.2 * math.radians(120.0) / 3.0,
    "fade": 0.99,
    "min_range": 1.0,
    "assumed_noise": 1.0,
    "dt": 0.1,
    "q_range": 0.2,
    "q_angle": 0.025,
    "half_width": 1.0,
    "ztest_max": 9.21,
}


def make(sensor="angles", **changes):
    out = np.zeros((), SETTINGS)
    for name, value in {**IISC, "sensor": SENSORS.index(sensor), **changes}.items():
        out[name] = value
    return out[()]


@pytest.fixture
def settings():
    """A function that makes settings: a sensor, and what differs from the IISc report."""
    return make


@pytest.fixture
def scratch():
    return np.zeros(1, SCRATCH)[0]


@pytest.fixture
def attitude():
    """A function of a seed that makes an attitude within some 40 degrees of level north."""

    def build(seed):
        yaw, pitch, roll = np.random.default_rng(seed).uniform(-0.4, 0.4, 3)
        c, s = np.cos, np.sin
        one = np.array([[c(yaw), s(yaw), 0], [-s(yaw), c(yaw), 0], [0, 0, 1]])
        two = np.array([[c(pitch), 0, -s(pitch)], [0, 1, 0], [s(pitch), 0, c(pitch)]])
        three = np.array([[1, 0, 0], [0, c(roll), s(roll)], [0, -s(roll), c(roll)]])
        return three @ two @ one

    return build


@pytest.fixture
def derivative():
    """A function (f, x, step) that differentiates f at x by central differences: (m, n)."""

    def of(f, x, step=1e-6):
        columns = []
        for i in range(len(x)):
            h = np.zeros(len(x))
            h[i] = step * max(1.0, abs(x[i])) if np.isscalar(step) else step[i]
            columns.append((np.asarray(f(x + h)) - np.asarray(f(x - h))) / (2 * h[i]))
        return np.array(columns).T

    return of
