"""The firmware's state machine: exact motion, order of checks, two readings of its clock."""

import math

import numpy as np
import pytest

from visenvs.core.config import override, to_record
from visenvs.core.lanes import lane_dtype
from visenvs.dynamics.ground_robot import (
    ACTIVE,
    COLUMNS,
    NOISE,
    OFFSETS,
    REVERSE,
    ROBOTS,
    RUN,
    TOUCH,
    drive_all,
)
from visenvs.envs._herding_config import HerdingConfig

pytestmark = pytest.mark.kernel

ARENA = lane_dtype(COLUMNS)
QUIET = {"noise_max": 0.0}
SPIN, SPEED = HerdingConfig().spin_time, HerdingConfig().speed


def settings(**changes):
    return to_record(override(HerdingConfig(), changes))[0]


def robot(count=1):
    arena = np.zeros(1, ARENA)[0]
    arena["fate"][:count] = ACTIVE
    return arena


def drive(arena, cfg, duration, **switches):
    """Drive for a while; switches are pressed in the first tick."""
    for name in switches:
        arena[name][0] = 1
    for _ in range(round(duration / cfg["tick"])):
        drive_all(arena, cfg)
        arena["tick"] += 1
        arena["t"] = arena["tick"] * cfg["tick"]
    return arena


def test_a_robot_reverses_after_20_s_by_half_a_turn_exactly():
    cfg = settings(**QUIET)
    arena = drive(robot(), cfg, 20.0)
    assert arena["r_R_N"][0] == pytest.approx([20 * SPEED, 0.0], abs=1e-9)
    drive(arena, cfg, 1.0)
    assert arena["mode"][0] == REVERSE
    assert arena["heading"][0] == pytest.approx(math.pi / SPIN, abs=1e-9)
    drive(arena, cfg, 9.0)
    assert arena["mode"][0] == RUN
    assert arena["heading"][0] == pytest.approx(math.pi, abs=1e-12)
    assert arena["r_R_N"][0] == pytest.approx([(20 - (10 - SPIN)) * SPEED, 0.0], abs=1e-9)


@pytest.mark.parametrize("tick", [0.01, 0.1])
def test_the_tick_does_not_matter(tick):
    coarse = drive(robot(), settings(tick=tick, **QUIET), 57.0)
    fine = drive(robot(), settings(**QUIET), 57.0)
    assert coarse["r_R_N"][0] == pytest.approx(fine["r_R_N"][0], abs=1e-9)
    assert coarse["heading"][0] == pytest.approx(fine["heading"][0], abs=1e-9)


def test_a_touch_turns_by_45_degrees_clockwise():
    arena = drive(robot(), settings(**QUIET), 1.0, tapped=1)
    assert arena["mode"][0] == RUN
    assert arena["heading"][0] == pytest.approx(math.pi / 4, abs=1e-12)


def test_a_touch_cuts_a_reversal_short():
    cfg = settings(**QUIET)
    arena = drive(robot(), cfg, 21.0)
    drive(arena, cfg, 4.0, tapped=1)
    assert arena["heading"][0] == pytest.approx(math.pi / SPIN + math.pi / 4, abs=1e-9)


def test_a_bump_is_ignored_while_reversing_and_ends_a_swerve_and_a_touch():
    cfg = settings(**QUIET)
    arena = drive(robot(), cfg, 21.0)
    drive(arena, cfg, 3.0, bumped=1)
    assert arena["heading"][0] == pytest.approx(math.pi, abs=1e-12)
    swerving = drive(robot(), cfg, 5.1)
    assert swerving["mode"][0] == NOISE
    drive(swerving, cfg, 0.05, bumped=1)
    assert swerving["mode"][0] == REVERSE
    touched = drive(robot(), cfg, 0.3, tapped=1)
    assert touched["mode"][0] == TOUCH
    drive(touched, cfg, 0.05, bumped=1)
    assert touched["mode"][0] == REVERSE


def test_a_touch_goes_before_a_bump():
    arena = drive(robot(), settings(**QUIET), 0.05, tapped=1, bumped=1)
    assert arena["mode"][0] == TOUCH


@pytest.mark.parametrize("restart, turns", [(0, 2), (1, 1)])
def test_the_clock_runs_on_through_a_bump_or_starts_anew(restart, turns):
    cfg = settings(bump_restarts_timer=restart, **QUIET)
    arena = drive(robot(), cfg, 10.0)
    drive(arena, cfg, 15.0, bumped=1)
    assert arena["heading"][0] == pytest.approx(turns * math.pi, abs=1e-9)


def test_a_clock_that_runs_out_during_a_bump_waits_for_its_end():
    cfg = settings(**QUIET)
    arena = drive(robot(), cfg, 19.0)
    drive(arena, cfg, 2 * SPIN + 0.2, bumped=1)
    assert arena["heading"][0] == pytest.approx(2 * math.pi, abs=1e-9)
    assert arena["reversal_t"][0] == pytest.approx(19.0 + SPIN, abs=1e-9)


def test_swerves_are_whole_steps_of_at_most_the_largest():
    cfg = settings(period=1e6)
    turned = []
    for seed in range(80):
        arena = robot(ROBOTS)
        arena["seed"] = seed
        drive(arena, cfg, 6.0)
        turned += arena["heading"][:ROBOTS].tolist()
    steps = np.array(turned) / cfg["noise_max"] * OFFSETS
    assert steps == pytest.approx(np.round(steps), abs=1e-6)
    assert steps.min() >= -OFFSETS and steps.max() <= OFFSETS - 1
    assert abs(steps.mean() + 0.5) < 4 * 18.5 / math.sqrt(len(steps))
    assert steps.std() == pytest.approx(18.5, rel=0.1)  # of 64 numbers in a row


def test_the_official_noise_is_12_degrees():
    assert math.degrees(HerdingConfig().noise_max) == pytest.approx(12.1, abs=0.03)
