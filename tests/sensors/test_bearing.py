"""The bearing sensor: noise, dropouts, blind near the target."""

import math

import numpy as np
import pytest
from scipy import stats

from visenvs.sensors.bearing import take_bearing

pytestmark = pytest.mark.kernel

SIGMA = math.radians(1.0)
MIN_RANGE = 10.0


def looks(r, p_detect, count=2000):
    """Bearings of a point at as many seeds, NaN where there was none."""
    settings = np.zeros((), [("min_range", "f8"), ("p_detect", "f8"), ("sigma_bearing", "f8")])
    settings["min_range"], settings["p_detect"], settings["sigma_bearing"] = (
        MIN_RANGE,
        p_detect,
        SIGMA,
    )
    out = np.full((count, 1), np.nan)
    for seed in range(count):
        taken = take_bearing(np.array(r), settings[()], seed, 0, 3, 1, out[seed])
        assert taken == np.isfinite(out[seed, 0])
    return out[:, 0]


def test_the_noise_is_gaussian_and_the_same_all_round():
    north = looks((100.0, 0.0), 1.0)
    assert stats.kstest(north / SIGMA, "norm").pvalue > 1e-3
    south = looks((-100.0, 0.0), 1.0)
    assert np.abs(south).max() <= math.pi
    assert np.sin(south - math.pi) == pytest.approx(np.sin(north), abs=1e-12)


def test_the_target_is_seen_as_often_as_stated():
    seen = np.isfinite(looks((100.0, 50.0), 0.8)).sum()
    assert stats.binomtest(int(seen), 2000, 0.8).pvalue > 1e-3
    assert not np.isfinite(looks((100.0, 50.0), 0.0)).any()


def test_a_dropout_does_not_shift_the_noise():
    all_seen, some = looks((100.0, 50.0), 1.0), looks((100.0, 50.0), 0.5)
    kept = np.isfinite(some)
    assert np.array_equal(all_seen[kept], some[kept])


def test_there_is_no_bearing_of_a_target_that_is_too_near():
    assert not np.isfinite(looks((MIN_RANGE, 0.0), 1.0, 5)).any()
    assert np.isfinite(looks((1.001 * MIN_RANGE, 0.0), 1.0, 5)).all()
