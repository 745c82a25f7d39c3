"""An inertial unit at rest feels its weight; noise and bias walk have the deviations promised."""

import math

import numpy as np
import pytest

from visenvs.core.units import GRAVITY
from visenvs.estimation.navigator import settings
from visenvs.sensors.images.optics import Optics
from visenvs.sensors.imu import take_inertial

pytestmark = pytest.mark.kernel


def samples(count, cfg, C=None, a=(0.0, 0.0, 0.0), omega=(0.0, 0.0, 0.0)):
    biases, out = np.zeros((2, 3)), np.empty((count, 2, 3))
    C = np.eye(3) if C is None else C
    for k in range(count):
        take_inertial(C, np.array(a), np.array(omega), biases, cfg, 5, 0, k, 0, out[k])
    return out, biases


def test_without_noise_it_tells_what_it_feels():
    cfg = settings(Optics())[0]
    for name in ("sigma_force", "sigma_rate", "walk_force", "walk_rate"):
        cfg[name] = 0.0
    C = np.array([[0.0, 1, 0], [-1, 0, 0], [0, 0, 1]])
    out, _ = samples(1, cfg, C, (2.0, 0.0, 1.0), (0.1, 0.2, 0.3))
    assert out[0, 0] == pytest.approx([0.0, -2.0, 1.0 - GRAVITY])
    assert out[0, 1] == pytest.approx([0.1, 0.2, 0.3])


def test_noise_and_walk_are_as_large_as_they_should_be():
    cfg = settings(Optics())[0]
    out, _ = samples(2000, cfg)
    white = out - out.mean(axis=0)
    for k, name in enumerate(("sigma_force", "sigma_rate")):
        assert white[:, k].std() == pytest.approx(cfg[name] / math.sqrt(cfg["dt"]), rel=0.1)
    _, biases = samples(100, cfg)  # a second
    assert 0.0 < np.abs(biases[0]).max() < 5.0 * cfg["walk_force"]
    assert 0.0 < np.abs(biases[1]).max() < 5.0 * cfg["walk_rate"]
