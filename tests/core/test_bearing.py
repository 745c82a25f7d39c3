"""Bearings and their slope."""

import math

import numpy as np
import pytest

from visenvs.core.bearing import bearing, bearing_slope

pytestmark = pytest.mark.kernel


def test_it_runs_clockwise_from_north():
    north_east_south_west = np.array([[2.0, 0.0], [0.0, 3.0], [-1.0, 0.0], [0.0, -5.0]])
    angles = [bearing(r) for r in north_east_south_west]
    assert angles == pytest.approx([0.0, math.pi / 2, math.pi, -math.pi / 2])


@pytest.mark.parametrize("seed", range(5))
def test_the_slope_is_that_of_finite_differences(seed):
    r, h = np.random.default_rng(seed).normal(size=2) * 100.0, 1e-4
    slope = [(bearing(r + e) - bearing(r - e)) / (2 * h) for e in h * np.eye(2)]
    assert bearing_slope(*r, 1.0) == pytest.approx(slope, rel=1e-7)


def test_a_point_that_is_too_near_has_a_bounded_slope():
    assert math.hypot(*bearing_slope(0.3, -0.4, 5.0)) == pytest.approx(0.5 / 25.0)
    assert bearing_slope(0.0, 0.0, 5.0) == (0.0, 0.0)
