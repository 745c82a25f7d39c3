"""What visenvs promises of every task: costs, information, bad numbers and bad input."""

from __future__ import annotations

import math

import gymnasium as gym
import numpy as np
import pytest

from visenvs.core.config import field_types
from visenvs.core.outcome import Outcome

SEED = 31
LONGEST = 2000  # steps: no episode is longer

# For each environment: the fields that hold the truth which the filter has to guess, and the
# settings under which it gets no measurement.
HIDDEN = {
    "visenvs/Avoidance-v0": (("r_O_N", "v_O_N"), {"p_detect": 0.0}),
    "visenvs/Formation-v0": (
        ("leader.r_N", "leader.v_N"),
        {"p_lose": 1.0, "p_regain": 0.0, "vision": (0.0, 0.0)},
    ),
    "visenvs/Herding-v0": (("r_R_N",), {"p_detect": 0.0, "false_detections": 0.0}),
    "visenvs/Mapping-v0": (("edge",), {"p_detect": 0.0, "p_false": 0.0}),
    "visenvs/Rendezvous-v0": (("r_T_N", "r_TV_N"), {"p_detect": 0.0}),
    "visenvs/BearingsOnly-v0": (("r_TV_N", "v_T_N"), {"p_detect": 0.0}),
    "visenvs/Tracking2D-v0": (("r_T_N", "r_TV_N"), {"p_detect": 0.0}),
}


def part(records, name):
    """A field of lane records, or one inside a field: `leader.r_N`."""
    for key in name.split("."):
        records = records[key]
    return records


def told_and_hidden(case):
    """The fields of the row and the truth: to spoil them all leaves no lane a way back."""
    told = set(case.task.observation.names) - ({case.task.action.mask} if case.chooses else set())
    return (*sorted(told), *HIDDEN.get(case.env_id, ((), {}))[0])


def episode(env, actions):
    """All steps of one episode: row, reward, terminated, truncated, info."""
    steps = []
    for action in actions:
        steps.append(env.step(action))
        if steps[-1][2] or steps[-1][3]:
            break
    return steps


def test_reward_terms_sum_to_the_reward_and_the_return_is_minus_the_cost(case):
    env = case.single()
    env.reset(seed=SEED)
    steps = episode(env, case.actions(LONGEST))
    terms = {name.removeprefix("cost_") for name in case.task.costs}
    for _, reward, _, _, info in steps:
        assert info["reward_terms"].keys() == terms
        assert sum(info["reward_terms"].values()) == reward
    total = math.fsum(step[1] for step in steps)
    record = env.unwrapped.snapshot()[0]
    assert total == pytest.approx(-record["total_cost"], rel=1e-12)
    assert total < 0


def test_an_episode_ends_with_its_outcome_and_metrics(case):
    env = case.single()
    env.reset(seed=SEED)
    steps = episode(env, case.actions(LONGEST))
    *running, (_, _, terminated, truncated, info) = steps
    assert all("outcome" not in step[4] and "metrics" not in step[4] for step in running)
    if case.scenario == "endless":
        assert len(steps) == LONGEST and not terminated and not truncated
        return
    record = env.unwrapped.snapshot()[0]
    assert info["outcome"] == Outcome(record["outcome"]).name.lower()
    assert truncated == (info["outcome"] == "time_limit") and terminated != truncated
    assert info["metrics"] == {name: record[name] for name in case.task.metrics}


def test_only_the_sensor_tells_the_truth(filtered):
    """Without a measurement the truth may be anything, and no row changes; with one, rows do."""
    fields, blind = HIDDEN[filtered.env_id]
    actions = filtered.actions(1000, 1)
    for settings, hidden in ((blind, True), ({}, False)):
        rows = []
        for shift in (0.0, 0.5):
            lanes = filtered.lanes(1, **settings)
            lanes.reset([SEED])
            moved = lanes.snapshot()
            for name in fields:
                part(moved, name)[:] += shift
            lanes.restore(moved)
            rows.append([lanes.rows.copy()])
            for action in actions:
                ended = lanes.step(action)
                rows[-1].append(lanes.rows.copy())
                if ended:
                    break
        one, other = rows
        assert min(len(one), len(other)) > 2
        assert np.array_equal(one, other) == hidden


def test_every_environment_says_what_is_hidden(filtered):
    fields, blind = HIDDEN[filtered.env_id]
    names = {name.split(".")[0] for name in fields}
    assert names <= set(filtered.task.lane.names) - set(filtered.task.observation.names)
    assert blind.keys() <= field_types(type(filtered.task.scenarios[filtered.scenario])).keys()


def test_a_lane_with_bad_numbers_ends_diverged_and_harms_no_other(case):
    flown = []
    for poisoned in (False, True):
        lanes = case.lanes(3)
        lanes.reset([SEED, SEED + 1, SEED + 2])
        lanes.step(case.actions(3))
        if poisoned:
            bad = lanes.snapshot()
            for name in told_and_hidden(case):
                part(bad, name)[1] = np.nan
            lanes.restore(bad)
        others, rewards = [], []
        for action in case.actions(5, 3):
            lanes.step(action)
            others.append(lanes.records[[0, 2]].tobytes() + lanes.rows[[0, 2]].tobytes())
            rewards.append(lanes.rewards.copy())
            assert np.isfinite(lanes.rows).all() and np.isfinite(lanes.rewards).all()
        flown.append((others, np.array(rewards)[:, [0, 2]].tolist()))
    assert flown[0] == flown[1]
    assert lanes.outcome[1] == Outcome.DIVERGED
    assert lanes.records["step"].tolist() == [6, 2, 6]


def test_the_faces_show_divergence(case):
    env = case.single()
    env.reset(seed=SEED)
    bad = env.unwrapped.snapshot()
    for name in told_and_hidden(case):
        part(bad, name)[:] = np.nan
    env.unwrapped.restore(bad)
    row, reward, terminated, truncated, info = env.step(case.actions())
    assert row in env.observation_space
    assert (reward, terminated, truncated, info["outcome"]) == (0.0, True, False, "diverged")


BAD = {
    "NaN": (lambda a: np.full_like(a, np.nan), "must be finite and within"),
    "infinite": (lambda a: np.full_like(a, -np.inf), "must be finite and within"),
    "too large": (lambda a: a * 0 + np.float32(1.001), "must be finite and within"),
    "too small": (lambda a: a * 0 - np.float32(1.001), "must be finite and within"),
    "beyond float32": (lambda a: a.astype(float) + 1e300, "must be finite and within"),
    "too long": (lambda a: np.concatenate([np.atleast_1d(a)] * 2, axis=-1), "shape"),
    "too many": (lambda a: np.stack([a, a]), "shape"),
    "scalar": (lambda a: 0.5, "shape"),
    "nothing": (lambda a: None, "shape"),
    "text": (lambda a: a.astype(str).astype(object) + "?", "could not convert"),
}


@pytest.mark.parametrize("spoil, message", BAD.values(), ids=BAD)
def test_bad_actions_touch_nothing(case, spoil, message):
    if case.chooses:
        message = "number of a choice|could not convert|shape"
    for env, shape in ((case.single(), ()), (case.vector(3), (3,))):
        env.reset(seed=SEED)
        env.step(case.actions(*shape))
        before, row = env.unwrapped.snapshot(), env.unwrapped.lanes.rows.copy()
        with pytest.raises(ValueError, match=message):
            env.step(spoil(np.asarray(case.actions(*shape), np.float32)))
        assert env.unwrapped.snapshot().tobytes() == before.tobytes()
        assert env.unwrapped.lanes.rows.tobytes() == row.tobytes()


def test_one_bad_action_stops_all_lanes_and_is_named(case):
    envs = case.vector(3)
    envs.reset(seed=SEED)
    before = envs.snapshot()
    actions = np.asarray(case.actions(3), np.float32)
    if case.chooses:
        actions[:] = 0.0  # which may always be chosen
    actions[2, ...] = np.nan
    advice = r"space\.sample" if case.chooses else r"numpy\.clip"
    with pytest.raises(ValueError, match=rf"action of lane 2 .*{advice}"):
        envs.step(actions)
    assert envs.snapshot().tobytes() == before.tobytes()


def test_actions_beyond_the_box_by_rounding_are_taken(case):
    env = case.single()
    env.reset(seed=SEED)
    if not case.chooses:
        action = np.full(case.task.action.size, np.nextafter(np.float32(1), np.float32(2)))
        assert env.observation_space.contains(env.step(action)[0])


def test_unknown_names_are_answered_with_the_nearest(case):
    misspelt = "z" + case.scenario[1:]
    with pytest.raises(ValueError, match=f"unknown scenario .*did you mean '{case.scenario}"):
        gym.make(case.env_id, scenario=misspelt)
    name = next(iter(field_types(type(case.task.scenarios[case.scenario]))))
    with pytest.raises(ValueError, match=f"no setting '{name}x'; did you mean '{name}'"):
        gym.make_vec(case.env_id, 2, scenario=case.scenario, **{f"{name}x": 1.0})
