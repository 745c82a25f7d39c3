"""Contacts: what pymunk and plain geometry must agree on, and what each must do."""

import math

import numpy as np
import pytest

from agents.registry import load
from eval.rollout import rollout
from visenvs.core.config import override, to_record
from visenvs.core.lanes import Lanes, lane_dtype
from visenvs.core.registry import load_task
from visenvs.dynamics.arena import settle
from visenvs.dynamics.ground_robot import ACTIVE, CIRCLES, COLUMNS
from visenvs.dynamics.kinematic_arena import crowded, touch
from visenvs.envs._herding_config import SCENARIOS, HerdingConfig

ARENA = lane_dtype(COLUMNS)
CFG = to_record(HerdingConfig())[0]
RADIUS = HerdingConfig().robot_radius
NOBODY = np.zeros((1, 3))
SEEDS = range(100_000, 100_060)


def by_pymunk(arena, pads):
    near = np.zeros(CIRCLES, np.int64)
    if crowded(arena, pads, near, CFG):
        settle(arena, pads, near, CFG)


def by_geometry(arena, pads):
    touch(arena, pads, CFG)


def scene(*poses):
    """Robots at (north, east, heading)."""
    arena = np.zeros(1, ARENA)[0]
    for k, (north, east, heading) in enumerate(poses):
        arena["fate"][k] = ACTIVE
        arena["r_R_N"][k] = north, east
        arena["heading"][k] = heading
    return arena


@pytest.fixture(params=[by_pymunk, by_geometry])
def contacts(request):
    return request.param


def test_head_on_both_feel_it_and_part(contacts):
    arena = scene((0.0, 0.0, 0.0), (2 * RADIUS - 0.02, 0.0, math.pi))
    contacts(arena, NOBODY)
    assert arena["bumped"][:2].tolist() == [1, 1]
    assert arena["r_R_N"][0] == pytest.approx([-0.01, 0.0], abs=1e-5)
    assert arena["r_R_N"][1] == pytest.approx([2 * RADIUS - 0.01, 0.0], abs=1e-5)


def test_from_behind_only_the_follower_feels_it(contacts):
    arena = scene((0.0, 0.0, 0.0), (2 * RADIUS - 0.01, 0.0, 0.0))
    contacts(arena, NOBODY)
    assert arena["bumped"][:2].tolist() == [1, 0]


def test_a_landed_aircraft_gives_no_way_and_is_met(contacts):
    stand = RADIUS + HerdingConfig().aircraft_radius
    arena = scene((0.0, 0.0, 0.0), (3.0, 0.0, 0.0))
    contacts(arena, np.array([[5.0, 5.0, 1.0], [stand - 0.01, 0.0, 1.0]]))
    assert arena["met"][:2].tolist() == [2, 0] and arena["bumped"][0] == 1
    assert arena["r_R_N"][0] == pytest.approx([-0.01, 0.0], abs=1e-5)
    flying = scene((0.0, 0.0, 0.0))
    contacts(flying, np.array([[stand - 0.01, 0.0, 0.0]]))
    assert not flying["bumped"].any() and not flying["met"].any()


def test_the_heading_is_the_wheels(contacts):
    arena = scene((0.0, 0.0, 0.3), (0.2, 0.25, 2.0))
    contacts(arena, NOBODY)
    assert arena["heading"][:2].tolist() == [0.3, 2.0]


def test_those_who_touch_nothing_keep_every_bit(contacts):
    arena = scene((0.1, 0.2, 0.3), (0.3, 0.4, 0.0), (1 / 3, -4 / 3, 1.0), (2 / 3, 7.7, 0.1))
    before = arena["r_R_N"].copy()
    contacts(arena, NOBODY)
    assert (arena["r_R_N"][:2] != before[:2]).all()
    assert np.array_equal(arena["r_R_N"][2:], before[2:])


def flown(arena, law="zero", seeds=SEEDS, **changes):
    task = load_task("visenvs/Herding-v0")
    settings = {"estimator": "truth", "arena": arena} | changes
    config = override(SCENARIOS["firmware"], settings)
    return rollout(load(law, task, config).policy, task, config, seeds).records


def test_without_contacts_both_arenas_agree_to_the_bit():
    alone = {"robots": 1, "obstacles": 0, "goal_count": 1, "services": "block-tap"}
    one, other = (flown(arena, seeds=SEEDS[:5], **alone) for arena in ("pymunk", "kinematic"))
    assert one.tobytes() == other.tobytes()


def test_with_contacts_both_arenas_agree_in_distribution():
    one, other = (flown(arena, "paper-rule") for arena in ("pymunk", "kinematic"))
    for name in ("goaled", "removed", "blocks"):
        deviation = math.hypot(one[name].std(), other[name].std()) / math.sqrt(len(one))
        assert abs(one[name].mean() - other[name].mean()) < 3.5 * deviation


def test_pymunk_from_one_seed_gives_one_trajectory_also_after_a_snapshot():
    task = load_task("visenvs/Herding-v0")
    config = override(SCENARIOS["firmware"], {"estimator": "truth"})
    policy = load("paper-rule", task, config).policy
    lanes, again = Lanes(task, config, 2), Lanes(task, config, 2)
    lanes.reset([7, 8])
    again.reset([7, 8])
    for k in range(150):
        if k == 60:
            fresh = Lanes(task, config, 2)
            fresh.restore(again.snapshot())
            again = fresh
        lanes.step(policy.predict(lanes.rows)[0])
        again.step(policy.predict(again.rows)[0])
    assert lanes.records.tobytes() == again.records.tobytes()
    assert lanes.records["blocks"].sum() > 0
