"""One and four aircraft that share an arena, through PettingZoo."""

import warnings
from functools import partial

import numpy as np
import pytest

from visenvs import herding_v0
from visenvs.render import herding

with warnings.catch_warnings():  # it imports a game by a way that it calls old
    warnings.simplefilter("ignore", DeprecationWarning)
    from pettingzoo.test import api_test, parallel_api_test, parallel_seed_test

QUICK = {"estimator": "truth", "arena": "kinematic", "t_f": 30.0}


def drawing_what_is_allowed(aircraft):
    """An environment whose spaces read the mask: PettingZoo's tests look for it in rows alone."""
    env = herding_v0.parallel_env(aircraft=aircraft, **QUICK)
    for k, agent in enumerate(env.possible_agents):
        space = env.action_space(agent)
        draw = space.sample
        space.sample = lambda _mask=None, draw=draw, k=k: draw(env.lanes.allowed[k].astype(np.int8))
    return env


@pytest.mark.filterwarnings("ignore::UserWarning")
@pytest.mark.parametrize("aircraft", [1, 4])
def test_pettingzoo_finds_nothing(aircraft):
    parallel_api_test(drawing_what_is_allowed(aircraft), num_cycles=100)
    parallel_seed_test(lambda: drawing_what_is_allowed(aircraft))
    api_test(herding_v0.env(aircraft=aircraft, **QUICK), num_cycles=50)


def test_all_see_one_arena_and_busy_ones_may_only_go_on():
    env = herding_v0.parallel_env(aircraft=3, **QUICK)
    _, infos = env.reset(seed=4)
    assert env.possible_agents == ["aircraft_0", "aircraft_1", "aircraft_2"]
    rng, busy = np.random.default_rng(0), 0
    while env.agents:
        masks = {agent: infos[agent]["action_mask"] for agent in env.agents}
        busy += sum(mask.sum() == 1 for mask in masks.values())
        assert all(mask[0] == 1 for mask in masks.values())
        chosen = {a: int(rng.choice(np.flatnonzero(mask))) for a, mask in masks.items()}
        _, rewards, _, _, infos = env.step(chosen)
        assert len(set(rewards.values())) == 1
    assert busy > 0


@pytest.mark.parametrize("settings", [{"aircraft": 2}, {"aircraft": 2, "dynamics": "quadrotor"}])
def test_all_aircraft_of_a_team_are_drawn(settings):
    env = herding_v0.parallel_env(render_mode="rgb_array", **settings, **QUICK)
    env.reset(seed=0)
    team, draw = env.lanes.records, partial(herding.draw, config=env.config, task=env.task)
    first = env.render()
    assert np.array_equal(first, draw(team)) and first.shape == (540, 960, 3)
    moved = team.copy()
    moved["r_V_N"][1] += 1.0
    there = draw(moved)
    assert not np.array_equal(there, first)
    assert np.array_equal(there[:, 520:], first[:, 520:])  # the camera is that of the first
    assert not np.array_equal(draw(moved, trail=team[None]), there)


def test_a_team_on_pictures_sees_what_its_spaces_say():
    env = herding_v0.parallel_env(aircraft=2, observation="pixels", **QUICK)
    observations, _ = env.reset(seed=0)
    for agent, seen in observations.items():
        assert env.observation_space(agent).contains(seen)
    assert env.state_space.contains(env.state())
