"""Lanes that fly together, and actions that are choices."""

import numpy as np
import pytest

from agents.classical import RandomPolicy, ZeroPolicy
from eval.rollout import rollout, together
from tests.toys import toys
from visenvs.core.config import override
from visenvs.core.lanes import Lanes
from visenvs.core.layout import Choices
from visenvs.core.outcome import Outcome
from visenvs.core.registry import load_task
from visenvs.faces.batch import LaneVectorEnv
from visenvs.faces.single import LaneEnv

CONVOY, STAIRS = "visenvs/Convoy-v0", "visenvs/Stairs-v0"


@pytest.fixture(autouse=True)
def only_toys():
    with toys():
        yield


def convoy(carts, teams=1, **settings):
    task = load_task(CONVOY)
    config = override(task.scenarios["alone"], {"carts": carts, **settings})
    return Lanes(task, config, carts * teams)


def stairs(count=1):
    task = load_task(STAIRS)
    return Lanes(task, task.scenarios["plain"], count)


def test_a_team_has_one_seed_and_starts_together():
    lanes = convoy(3, 2)
    lanes.reset([5, 9])
    assert lanes.records["seed"].tolist() == [5, 5, 5, 9, 9, 9]
    second = np.repeat([False, True], 3)
    lanes.reset(None, second)
    assert lanes.records["episode"].tolist() == [0, 0, 0, 1, 1, 1]
    with pytest.raises(ValueError, match="expected 2 integer seeds"):
        lanes.reset(range(6))


def test_an_agent_more_does_not_change_the_others():
    flown = []
    for carts in (2, 3):
        lanes = convoy(carts)
        lanes.reset([5])
        rows = []
        for action in np.random.default_rng(0).uniform(-1, 1, (30, 3, 1)).astype(np.float32):
            lanes.step(action[:carts])
            rows.append(lanes.rows[:2].tobytes())
        flown.append(rows)
    assert flown[0] == flown[1]


def test_an_agent_that_has_ended_stays_until_its_team_has():
    lanes = convoy(2, lost=0.9)
    lanes.reset([5])
    flee = np.ones((2, 1), np.float32)  # the first runs into its mark, the other keeps its gap
    while not lanes.done.any():
        lanes.step(flee)
    assert lanes.done.tolist() == [True, False] and not lanes.over.any()
    kept = lanes.records[0].copy()
    lanes.step(np.array([[np.nan], [0.0]], np.float32))  # nobody asks who has ended
    assert lanes.records[0]["x"] == kept["x"] and lanes.records[0]["step"] == kept["step"]
    assert lanes.rewards[0] == 0.0
    while not lanes.over.any():
        lanes.step(np.zeros((2, 1), np.float32))
    assert lanes.over.tolist() == [True, True]


def test_lanes_do_not_divide():
    task = load_task(CONVOY)
    with pytest.raises(ValueError, match=r"3 lanes of visenvs/Convoy-v0 fly together, 4 lanes"):
        Lanes(task, override(task.scenarios["alone"], {"carts": 3}), 4)


@pytest.mark.parametrize("face", [LaneEnv, LaneVectorEnv])
def test_gymnasium_faces_send_teams_to_the_team_face(face):
    with pytest.raises(ValueError, match=r"2 agents fly .* together.*faces\.team\.parallel_env"):
        face(CONVOY, carts=2)


def test_a_rollout_tells_of_teams():
    task = load_task(CONVOY)
    config = override(task.scenarios["alone"], {"carts": 2, "lost": 1.2})
    flown = rollout(RandomPolicy(task), task, config, [3, 4, 5])
    assert len(flown.records) == len(flown.returns) == len(flown.steps) == 3
    assert flown.returns == pytest.approx(-flown.records["total_cost"])
    lanes = convoy(2)
    lanes.reset([3])
    lanes.records["outcome"] = [Outcome.SUCCESS, Outcome.LOST]
    lanes.records["total_cost"] = [1.0, 3.0]
    (team,) = together(lanes)
    assert team["outcome"] == Outcome.LOST and team["total_cost"] == 2.0
    lanes.records["outcome"] = [Outcome.LOST, Outcome.DIVERGED]
    assert together(lanes)["outcome"] == Outcome.DIVERGED


@pytest.mark.parametrize("bad", [-1, 3, 0.5, np.nan, np.inf])
def test_what_is_no_choice_is_refused(bad):
    lanes = stairs(2)
    lanes.reset([1, 2])
    before = lanes.snapshot()
    with pytest.raises(ValueError, match=r"lane 1 must be the number of a choice .*one of"):
        lanes.step(np.array([0, bad], np.float32))
    assert lanes.records.tobytes() == before.tobytes()


def test_a_forbidden_choice_is_refused_and_the_allowed_ones_named():
    lanes = stairs()
    lanes.reset([1])
    while lanes.records["height"][0] > 0:
        lanes.records["landing"] = 6
        lanes.step(np.array([1]))
    assert lanes.allowed[0].tolist() == [True, False, True]
    with pytest.raises(ValueError, match=r"one of \[0, 2\], got \[1\.0\]"):
        lanes.step(np.array([1]))


def test_policies_choose_only_what_is_allowed():
    task, lanes = load_task(STAIRS), stairs(64)
    lanes.reset(range(64))
    for policy in (RandomPolicy(task), ZeroPolicy(task)):
        for _ in range(20):
            action, _ = policy.predict(lanes.rows)
            assert action.shape == (64,)
            lanes.step(action)
            lanes.reset(range(64), lanes.done) if lanes.done.all() else None


def test_choices_need_names_of_their_own():
    with pytest.raises(ValueError, match="names of their own"):
        Choices(("stay", "stay"))
