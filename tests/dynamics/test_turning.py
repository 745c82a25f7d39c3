"""Level turns at constant speed are circular arcs."""

import math

import numpy as np
import pytest

from visenvs.dynamics.turning import turn

pytestmark = pytest.mark.kernel


def flown(v, rate, dt, steps=1):
    v, moved, way = np.array(v, float), np.empty(2), np.zeros(2)
    for _ in range(steps):
        turn(v, rate, dt, moved)
        way += moved
    return v, way


def test_a_quarter_turn_clockwise_from_north_ends_eastwards():
    rate = math.pi / 2 / 5.0
    v, way = flown((18.0, 0.0), rate, 5.0)
    radius = 18.0 / rate
    assert v == pytest.approx([0.0, 18.0], abs=1e-12)
    assert way == pytest.approx([radius, radius], rel=1e-12)


def test_no_turn_is_a_straight_line():
    v, way = flown((3.0, -4.0), 0.0, 2.0)
    assert v.tolist() == [3.0, -4.0]
    assert way.tolist() == [6.0, -8.0]


@pytest.mark.parametrize("rate", [-0.4, 1e-9, 0.1, 2.0])
def test_one_long_step_is_many_short_ones(rate):
    long, short = flown((10.0, 7.0), rate, 3.0), flown((10.0, 7.0), rate, 3.0 / 64, 64)
    assert long[0] == pytest.approx(short[0], rel=1e-11)
    assert long[1] == pytest.approx(short[1], rel=1e-11)
    assert np.hypot(*long[0]) == pytest.approx(math.hypot(10.0, 7.0), rel=1e-14)
