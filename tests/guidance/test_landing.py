"""Landings in a robot's path: where they aim, that they come down there, when they hold still."""

import math

import numpy as np
import pytest

from visenvs.core.config import to_record
from visenvs.guidance import ddp, landing
from visenvs.guidance.ddp import DDPConfig
from visenvs.guidance.landing import AHEAD, FROZEN, LANDING

pytestmark = pytest.mark.kernel

CFG, SPEED, HEADING = to_record(DDPConfig())[0], 0.33, 0.6
ALONG = np.array([math.cos(HEADING), math.sin(HEADING)])


def fly(x, heading_told=HEADING):
    """Land before a robot from the origin; returns states, aims and times to go."""
    task, tape = np.zeros(1, LANDING)[0], ddp.make_tape(120)
    landing.begin(task, x, np.zeros(2), HEADING, SPEED, 6.0, CFG)
    out = []
    for k in range(200):
        told = heading_told if task["t_go"] < FROZEN else HEADING
        landing.land(task, x, k * CFG["dt"] * SPEED * ALONG, told, SPEED, CFG, tape)
        y = np.zeros(6)
        ddp.fly(x, tape.u[0], y, CFG["dt"])
        x = y
        out.append((x, task["aim"].copy(), task["t_go"]))
        if x[2] >= 0.0:
            break
    return out


@pytest.mark.parametrize("start", [(2.0, -1.0, -2.0), (-3.0, 2.0, -1.2), (0.5, 0.5, -2.5)])
def test_it_comes_down_ahead_of_the_robot(start):
    path = fly(np.r_[start, np.zeros(3)])
    end = path[-1][0]
    away = end[:2] - len(path) * CFG["dt"] * SPEED * ALONG
    across = away @ [-ALONG[1], ALONG[0]]
    assert abs(across) < 0.05
    assert away @ ALONG == pytest.approx(AHEAD, abs=0.1)
    assert 0.1 < end[5] < 0.5
    assert max(np.linalg.norm(x[3:]) for x, _, _ in path) < 2.13


def test_a_robot_that_goes_straight_has_one_place_to_land():
    aims = np.array([aim for _, aim, _ in fly(np.array([2.0, -1.0, -2.0, 0.0, 0.0, 0.0]))])
    assert np.ptp(aims, axis=0).max() < 1e-9


def test_at_the_end_the_aim_stays():
    """What is told of the heading in the last half second changes nothing."""
    x = np.array([2.0, -1.0, -2.0, 0.0, 0.0, 0.0])
    told, mistold = fly(x), fly(x, heading_told=HEADING + 1.0)
    assert np.array_equal(told[-1][0], mistold[-1][0])


def test_the_least_time_is_not_beaten():
    task = np.zeros(1, LANDING)[0]
    for away in (0.0, 2.0, 10.0):
        x = np.array([away, 0.0, -1.5, 0.0, 0.0, 0.0])
        landing.begin(task, x, np.zeros(2), HEADING, SPEED, 30.0, CFG)
        reach = (SPEED * task["t_go"] + AHEAD) * ALONG
        distance = math.hypot(*(reach - x[:2]), 1.5)
        assert task["t_go"] > distance / CFG["v_max"]
    landing.begin(task, x, np.zeros(2), HEADING, SPEED, 2.0, CFG)
    assert task["t_go"] <= 2.0
