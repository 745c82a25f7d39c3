"""The follower against the lag in closed form, a circle, and its limits."""

import math

import numpy as np
import pytest

from visenvs.dynamics.follower import fly, limit

pytestmark = pytest.mark.kernel

LANE = np.dtype([("r_V_N", "f8", 3), ("v_V_N", "f8", 3), ("a_V_F", "f8", 3), ("heading", "f8")])
LIMITS = np.zeros(1, [("a_max", "f8"), ("a_max_down", "f8")])
LIMITS["a_max"], LIMITS["a_max_down"] = 5.0, 3.0


def test_a_step_ahead_is_a_first_order_lag():
    lane, push = np.zeros(1, LANE), np.zeros(3)
    lane["v_V_N"][0, 0] = 20.0
    command, lag, dt = np.array([2.0, 0.0, -1.0]), 0.3, 0.02
    for _ in range(50):
        before = lane["v_V_N"][0].copy()
        fly(lane[0], command, dt, lag, push)
        assert dt * push == pytest.approx(lane["v_V_N"][0] - before, abs=1e-12)
    t = 1.0
    left = 1.0 - math.exp(-t / lag)
    assert lane["a_V_F"][0] == pytest.approx(command * left, abs=1e-12)
    speed = t - lag * left  # integral of the response
    assert lane["v_V_N"][0] == pytest.approx([20.0 + 2.0 * speed, 0.0, -speed], abs=1e-12)
    way = 0.5 * t * t - lag * speed
    assert lane["r_V_N"][0] == pytest.approx([20.0 * t + 2.0 * way, 0.0, -way], abs=1e-12)


def test_a_command_to_the_right_turns_without_changing_the_speed():
    lane, push = np.zeros(1, LANE), np.zeros(3)
    lane["v_V_N"][0, 1], lane["heading"], lane["a_V_F"][0, 1] = 20.0, math.pi / 2, 2.0
    for _ in range(500):
        fly(lane[0], np.array([0.0, 2.0, 0.0]), 0.02, 0.3, push)
    speed = math.hypot(*lane["v_V_N"][0, :2])
    assert speed == pytest.approx(20.0, rel=2e-3)
    assert lane["heading"][0] == pytest.approx(math.pi / 2 + 10.0 * 2.0 / 20.0, rel=2e-3)


@pytest.mark.parametrize(
    ("action", "expected"),
    [
        ((0.6, 0.0, 0.1), (3.0, 0.0, 0.5)),
        ((1.0, 1.0, 0.0), (5.0 / math.sqrt(2), 5.0 / math.sqrt(2), 0.0)),
        ((0.0, -1.0, 1.0), (0.0, -5.0, 3.0)),
        ((0.0, 0.0, -1.0), (0.0, 0.0, -3.0)),
    ],
)
def test_limits_are_a_length_across_and_a_size_down(action, expected):
    out = np.zeros(3)
    limit(np.array(action), LIMITS[0], out)
    assert out == pytest.approx(expected, rel=1e-12)
