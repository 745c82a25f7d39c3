"""Rotations and angles."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from visenvs.core.frames import camera_towards, direction, identity, rotate, wrap_angle

pytestmark = pytest.mark.kernel

component = st.floats(-1e4, 1e4)
vector = st.tuples(component, component, component)


def looking_along(r):
    C = np.full((3, 3), np.nan)
    camera_towards(np.array(r, float), C)
    return C


@given(st.floats(-1e3, 1e3))
def test_wrap_angle_keeps_the_angle(angle):
    wrapped = wrap_angle(angle)
    assert -math.pi <= wrapped <= math.pi
    turns = (angle - wrapped) / (2 * math.pi)
    assert abs(turns - round(turns)) < 1e-12


def test_wrap_angle_by_hand():
    assert wrap_angle(0.25) == pytest.approx(0.25, abs=1e-15)
    assert wrap_angle(math.pi + 0.25) == pytest.approx(0.25 - math.pi, abs=1e-15)
    assert wrap_angle(-3.5 * math.pi) == pytest.approx(0.5 * math.pi, abs=1e-15)
    assert abs(wrap_angle(math.pi)) == math.pi


def test_directions_of_the_compass():
    quarter = math.pi / 2
    assert direction(0.0, 0.0) == pytest.approx((1, 0, 0), abs=1e-15)
    assert direction(quarter, 0.0) == pytest.approx((0, 1, 0), abs=1e-15)
    assert direction(0.3, quarter) == pytest.approx((0, 0, -1), abs=1e-15)
    assert direction(quarter, -math.pi / 4) == pytest.approx(
        (0, math.sqrt(0.5), math.sqrt(0.5)), abs=1e-15
    )


@given(vector)
def test_the_camera_axes_are_a_right_handed_frame(r):
    C = looking_along(r)
    assert np.allclose(C @ C.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(C) == pytest.approx(1.0, abs=1e-12)


@given(vector.filter(lambda r: math.hypot(*r) > 1e-3))
def test_the_camera_sees_its_target_on_the_axis_and_the_horizon_level(r):
    C = looking_along(r)
    assert np.allclose(C @ np.array(r), [math.hypot(*r), 0, 0], atol=1e-11 * math.hypot(*r))
    assert C[1, 2] == 0.0  # right lies in the horizontal plane
    assert C[2, 2] >= 0.0  # down points down


def test_camera_attitudes_by_hand():
    assert np.array_equal(looking_along((2, 0, 0)), np.eye(3))
    assert np.array_equal(looking_along((0, 0, 0)), np.eye(3))
    assert np.array_equal(
        looking_along((0, 3, 0)), [[0, 1, 0], [-1, 0, 0], [0, 0, 1]]
    )  # east: right is south
    assert np.array_equal(looking_along((0, 0, 5)), [[0, 0, 1], [0, 1, 0], [-1, 0, 0]])  # down
    assert np.array_equal(looking_along((0, 0, -5)), [[0, 0, -1], [0, 1, 0], [1, 0, 0]])  # up


@given(vector, vector)
def test_rotate_is_the_matrix_product(axis, r):
    C = looking_along(axis)
    assert rotate(C, np.array(r)) == pytest.approx(tuple(C @ np.array(r)), rel=1e-12, abs=1e-10)


@pytest.mark.parametrize("n", [1, 3, 4])
def test_identity(n):
    C = np.full((n, n), np.nan)
    identity(C)
    assert np.array_equal(C, np.eye(n))
