"""A straight line through the last sights, against numpy's."""

import math

import numpy as np
import pytest

from visenvs.estimation.slope import SIGHTS, course, push, velocity

pytestmark = pytest.mark.kernel


def window(count, seed=0):
    rng = np.random.default_rng(seed)
    out, filled = np.zeros((SIGHTS, 3)), 0
    for k in range(count):
        filled = push(out, filled, 0.1 * k + 0.02 * rng.random(), rng.normal(size=2))
    return out, filled


@pytest.mark.parametrize("count", [2, 5, SIGHTS, SIGHTS + 5])
def test_the_line_is_numpys(count):
    sights, filled = window(count)
    used = sights[:filled]
    assert filled == min(count, SIGHTS)
    north, east, spread = velocity(sights, filled)
    assert (north, east) == pytest.approx(np.polyfit(used[:, 0], used[:, 1:], 1)[0])
    assert spread == pytest.approx(filled * used[:, 0].var())


def test_the_oldest_goes_first():
    sights, filled = window(SIGHTS)
    second = sights[1].copy()
    push(sights, filled, 9.0, np.array([1.0, 2.0]))
    assert np.array_equal(sights[0], second) and sights[-1].tolist() == [9.0, 1.0, 2.0]


def test_one_sight_has_no_course():
    sights, filled = window(1)
    assert velocity(sights, filled) == (0.0, 0.0, 0.0)
    assert course(sights, filled, 1e-4)[1:] == (0.0, math.inf)
