"""Leader profiles against circles, sines and random walks in closed form."""

import math

import numpy as np
import pytest

from visenvs.dynamics.leader import (
    CIRCLE,
    PLAN,
    PROFILES,
    RANDOM,
    REVERSE,
    STRAIGHT,
    WEAVE,
    lead,
    turn_rate,
    wander,
)
from visenvs.estimation.formation import LEADER

pytestmark = pytest.mark.kernel

DT, SPEED, TURN = 0.02, 20.0, 0.1
SETTINGS = np.zeros(1, [(name, "f8") for name in ("leader_decay", "leader_q_lat", "leader_q_a")])


def fly(profile, seconds, **settings):
    """Yield time and leader record of a flight that starts north at the origin."""
    leader, plan = np.zeros(1, LEADER), np.zeros(1, PLAN)
    leader["v_N"][0] = SPEED, 0.0, 0.0
    plan["profile"], plan["turn"], plan["switch"] = profile, TURN, (2.0, 4.0)
    plan["amplitude"], plan["rate"] = (3.0, 2.0, 1.0), 0.5
    for name, value in settings.items():
        plan[name] = value
    for k in range(round(seconds / DT)):
        yield k * DT, leader[0], plan[0]
        lead(leader[0], plan[0], k * DT, DT, np.zeros(3))
    yield k * DT + DT, leader[0], plan[0]


def test_profiles_are_named_in_the_order_of_their_codes():
    assert [PROFILES[k] for k in (STRAIGHT, CIRCLE, REVERSE, WEAVE, RANDOM)] == list(PROFILES)


def test_a_circle_is_exact_and_pulls_towards_its_centre():
    radius = SPEED / TURN
    for t, leader, _ in fly(CIRCLE, 10.0):
        angle = TURN * t
        assert leader["r_N"][:2] == pytest.approx(
            radius * np.array([math.sin(angle), 1 - math.cos(angle)]), abs=1e-9
        )
    inward = np.array([0.0, radius]) - leader["r_N"][:2]
    assert leader["a_N"][:2] == pytest.approx(SPEED * TURN * inward / radius, abs=1e-9)
    assert leader["a_N"][2] == 0.0


def test_a_reversed_circle_turns_back_after_as_much_time():
    flown = [(turn_rate(plan, t + 1e-9, SPEED), leader) for t, leader, plan in fly(REVERSE, 6.0)]
    third, leader = round(2.0 / DT), flown[-1][1]
    assert [rate for rate, _ in flown[:-1]] == [TURN] * third + [0.0] * third + [-TURN] * third
    assert math.atan2(leader["v_N"][1], leader["v_N"][0]) == pytest.approx(0.0, abs=1e-12)


def test_a_weave_returns_to_where_it_would_be_without_it():
    """1 - cos(w t) is zero after a period, and twice the amplitude after half of one."""
    period = 2 * math.pi / 0.5
    flown = [(t, leader["r_N"].copy()) for t, leader, _ in fly(WEAVE, period, amplitude=(0, 2, 1))]
    assert flown[-1][1][1:] == pytest.approx([0.0, 0.0], abs=0.02)
    assert flown[len(flown) // 2][1][1:] == pytest.approx([4.0, 2.0], abs=0.05)
    flown = [(t, leader["r_N"].copy()) for t, leader, _ in fly(WEAVE, period, amplitude=(3, 0, 0))]
    for t, r in flown:
        expected = SPEED * t + 3.0 * (1.0 - math.cos(0.5 * t))
        assert r == pytest.approx([expected, 0.0, 0.0], abs=1e-3)


def test_a_random_leader_has_the_spread_that_it_is_told():
    cfg = SETTINGS.copy()
    cfg["leader_q_lat"], cfg["leader_q_a"], cfg["leader_decay"] = 0.5, 0.3, 0.2
    n, steps = 300, 50
    plan, v = np.zeros(n, PLAN), np.zeros((n, 3))
    plan["profile"], plan["a_lat"] = RANDOM, 1.0
    for i in range(n):
        for k in range(steps):
            wander(plan[i], v[i], DT, cfg[0], i, 0, 0, k)
    t = steps * DT
    assert v.var(axis=0) == pytest.approx([0.3 * t] * 3, rel=0.3)
    assert plan["a_lat"].mean() == pytest.approx(math.exp(-0.2 * t), abs=0.15)
    assert plan["a_lat"].var() == pytest.approx(0.5 * (1 - math.exp(-0.4 * t)) / 0.4, rel=0.3)


def test_the_other_profiles_do_not_wander():
    plan, v, cfg = np.zeros(1, PLAN), np.zeros(3), SETTINGS.copy()
    cfg["leader_q_lat"] = cfg["leader_q_a"] = 1.0
    for profile in (STRAIGHT, CIRCLE, REVERSE, WEAVE):
        plan["profile"] = profile
        wander(plan[0], v, DT, cfg[0], 1, 0, 0, 0)
        assert not v.any() and plan["a_lat"][0] == 0.0
