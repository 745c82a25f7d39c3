"""The quadrotor reaches what it is told by tilting, and gets there as the attitude loop lets it."""

import math

import numpy as np
import pytest

from visenvs.core.units import GRAVITY
from visenvs.dynamics.quadrotor import attitude, fly, tilt_for, turn

pytestmark = pytest.mark.kernel

LANE = np.dtype(
    [
        ("r_V_N", "f8", 3),
        ("v_V_N", "f8", 3),
        ("a_V_N", "f8", 3),
        ("q_V", "f8", 4),
        ("omega_V", "f8", 3),
    ]
)
CFG = np.dtype(
    [(name, "f8") for name in ("dt", "bandwidth", "damping", "rate_max")] + [("substeps", "i8")]
)
SCRATCH = np.dtype([("wanted", "f8", (3, 3)), ("C", "f8", (3, 3))])


def hovering():
    lane, cfg = np.zeros(1, LANE)[0], np.zeros(1, CFG)[0]
    lane["q_V"][0] = 1.0
    cfg["dt"], cfg["bandwidth"], cfg["damping"], cfg["rate_max"] = 0.05, 12.0, 1.0, 6.0
    cfg["substeps"] = 5
    return lane, cfg, np.zeros(1, SCRATCH)[0]


def test_no_command_is_a_hover():
    lane, cfg, scratch = hovering()
    for _ in range(40):
        fly(lane, np.zeros(3), 0.0, cfg, scratch)
    assert lane["r_V_N"] == pytest.approx(np.zeros(3), abs=1e-12)


@pytest.mark.parametrize("heading", [0.0, 1.2, -3.0])
@pytest.mark.parametrize("command", [(2.0, 0.0, 0.0), (-1.0, 3.0, -2.0), (0.5, -1.0, 1.5)])
def test_commands_are_reached_with_a_level_heading(command, heading):
    lane, cfg, scratch = hovering()
    command, C = np.array(command), np.empty((3, 3))
    for _ in range(60):
        fly(lane, command, heading, cfg, scratch)
    assert lane["a_V_N"] == pytest.approx(command, abs=1e-3)
    attitude(lane["q_V"], C)
    assert math.atan2(C[0, 1], C[0, 0]) == pytest.approx(heading, abs=0.3)
    assert C[1] @ [-math.sin(heading), math.cos(heading), 0.0] > 0.9


def test_thrust_acts_along_the_axis_and_takes_time_to_turn():
    lane, cfg, scratch = hovering()
    command = np.array([3.0, 0.0, 0.0])
    fly(lane, command, 0.0, cfg, scratch)
    assert 0.0 < lane["a_V_N"][0] < 0.5 * command[0]
    for _ in range(9):
        fly(lane, command, 0.0, cfg, scratch)
    assert lane["a_V_N"][0] == pytest.approx(command[0], rel=0.05)


def test_what_it_turns_through_is_not_pushed_at_with_the_full_force():
    """Of a force F at an angle e from the axis F cos e is given: the distance to F is least."""
    lane, cfg, scratch = hovering()
    cfg["substeps"], command, C = 1, np.array([4.0, 0.0, 0.0]), np.empty((3, 3))
    force = np.array([4.0, 0.0, -GRAVITY])
    for _ in range(5):
        fly(lane, command, 0.0, cfg, scratch)
        attitude(lane["q_V"], C)
        given = lane["a_V_N"] - [0.0, 0.0, GRAVITY]
        assert (given - force) @ C[2] == pytest.approx(0.0, abs=1e-12)
        assert np.linalg.norm(np.cross(given, C[2])) < 1e-12


def test_the_wanted_attitude_is_a_rotation_whose_thrust_is_the_command():
    command, C = np.array([1.0, -2.0, 0.7]), np.empty((3, 3))
    thrust = tilt_for(command, 0.4, C)
    assert np.array([0, 0, GRAVITY]) - thrust * C[2] == pytest.approx(command, abs=1e-12)
    assert C @ C.T == pytest.approx(np.eye(3), abs=1e-12)
    assert np.linalg.det(C) == pytest.approx(1.0)


def test_a_turn_is_the_exponential_of_its_rates():
    q, omega, C = np.array([1.0, 0.0, 0.0, 0.0]), np.array([0.3, -0.5, 0.9]), np.empty((3, 3))
    for _ in range(10):
        turn(q, omega, 0.1)
    attitude(q, C)
    angle = np.linalg.norm(omega)
    a = omega / angle
    K = np.array([[0, -a[2], a[1]], [a[2], 0, -a[0]], [-a[1], a[0], 0]])
    body = np.eye(3) + math.sin(angle) * K + (1 - math.cos(angle)) * K @ K
    assert C == pytest.approx(body.T, abs=1e-12)
