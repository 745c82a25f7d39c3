"""One lane as a Gymnasium environment: seeds, order of calls, what is returned, pictures."""

from __future__ import annotations

import importlib.util
import math

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.error import DependencyNotInstalled, Error, ResetNeeded

from visenvs.core.config import override
from visenvs.core.lanes import Lanes
from visenvs.core.outcome import Outcome
from visenvs.core.registry import load_task
from visenvs.faces.single import LaneEnv

ENV_ID = "visenvs/Rendezvous-v0"
COAST = np.zeros(3, np.float32)


def test_a_seed_names_the_lanes_seed_exactly():
    env = LaneEnv(ENV_ID)
    row, info = env.reset(seed=100_000)
    lanes = Lanes(load_task(ENV_ID), env.config, 1)
    lanes.reset([100_000])
    assert env.snapshot() == lanes.records
    assert (row == lanes.rows[0]).all() and info == {}


def test_without_a_seed_episodes_follow_one_another():
    env = LaneEnv(ENV_ID)
    env.reset(seed=5)
    for episode in (1, 2):
        env.reset()
        assert env.snapshot()[["seed", "episode"]].tolist() == [(5, episode)]


def test_the_first_seed_is_drawn_from_the_generator():
    seeds = set()
    for k in (1, 1, 2):
        env = LaneEnv(ENV_ID)
        env.np_random = np.random.default_rng(k)
        env.reset()
        seeds.add(int(env.snapshot()["seed"][0]))
    assert len(seeds) == 2 and max(seeds) < 2**63
    one, other = LaneEnv(ENV_ID), LaneEnv(ENV_ID)
    assert (one.reset()[0] != other.reset()[0]).any()


@pytest.mark.parametrize("seed", [-1, 1.5, "7", 2**64])
def test_bad_seeds(seed):
    env = LaneEnv(ENV_ID)
    with pytest.raises((Error, ValueError), match=r"[Ss]eed"):
        env.reset(seed=seed)
    with pytest.raises(ResetNeeded):
        env.step(COAST)


def test_settings_and_scenarios_reach_the_task():
    env = gym.make(ENV_ID, scenario="thesis", estimator="truth", t_f=15.0).unwrapped
    preset = load_task(ENV_ID).scenarios["thesis"]
    assert env.config == override(preset, {"estimator": "truth", "t_f": 15.0})
    assert LaneEnv(ENV_ID).config == load_task(ENV_ID).scenarios["random"]
    row, _ = env.reset(seed=1)
    assert env.layout.unpack(row)["t_go"] == pytest.approx(15.0)
    assert env.metadata["render_fps"] == 10


def test_unknown_environments_name_the_nearest():
    with pytest.raises(ValueError, match="did you mean 'visenvs/Rendezvous-v0'"):
        LaneEnv("visenvs/Rendevous-v0")
    with pytest.raises(ValueError, match="unknown choice 'ekff'; did you mean 'ekf'"):
        LaneEnv(ENV_ID, estimator="ekff")


def test_steps_need_an_episode():
    env = LaneEnv(ENV_ID, t_f=0.2)
    for call in (lambda: env.step(COAST), env.snapshot, env.render):
        with pytest.raises(ResetNeeded, match=r"write `observation, info = env\.reset"):
            call()
    env.reset(seed=0)
    env.step(COAST)
    almost = env.snapshot()
    assert env.step(COAST)[2]
    over = env.snapshot()
    with pytest.raises(ResetNeeded, match="the episode is over"):
        env.step(COAST)
    assert env.snapshot() == over
    env.restore(almost)
    assert env.step(COAST)[2]
    env.restore(over)
    with pytest.raises(ResetNeeded, match="the episode is over"):
        env.step(COAST)


def test_what_step_returns():
    env = LaneEnv(ENV_ID, t_f=0.2)
    env.reset(seed=3)
    row, reward, terminated, truncated, info = env.step(COAST + 1)
    assert row.dtype == np.float32 and type(reward) is float
    assert terminated is False and truncated is False
    assert info.keys() == {"reward_terms"}
    assert {name: type(value) for name, value in info["reward_terms"].items()} == {
        "control": float,
        "position": float,
        "velocity": float,
    }
    a_max = env.config.a_max
    assert reward == pytest.approx(-0.5 * 0.1 * a_max**2, rel=1e-6)  # saturated at the ball's edge
    *_, terminated, truncated, info = env.step(COAST)
    assert terminated is True and truncated is False
    assert info["outcome"] == Outcome.MISS.name.lower()
    assert info["metrics"]["miss_distance"] > 1 and type(info["metrics"]["miss_distance"]) is float


def test_rows_are_the_callers_to_keep():
    env = LaneEnv(ENV_ID)
    first, _ = env.reset(seed=3)
    kept = first.copy()
    second = env.step(COAST + 1)[0]
    kept_second = second.copy()
    third = env.step(COAST + 1)[0]
    assert (first == kept).all() and (second == kept_second).all()
    third[:] = 7.0
    assert not (env.unwrapped.lanes.rows == 7.0).any()


@pytest.mark.parametrize("kind", [list, tuple, lambda a: a.astype(np.float64)])
def test_actions_may_come_as_other_numbers(kind):
    one, other = LaneEnv(ENV_ID), LaneEnv(ENV_ID)
    one.reset(seed=3)
    other.reset(seed=3)
    action = COAST + np.float32(0.25)
    one.step(action)
    other.step(kind(action))
    assert one.snapshot() == other.snapshot()


def test_spaces_of_two_environments_sample_on_their_own():
    one, other = LaneEnv(ENV_ID), LaneEnv(ENV_ID)
    one.action_space.seed(1)
    other.action_space.seed(1)
    first = one.action_space.sample()
    assert (one.action_space.sample() != first).any()
    assert (other.action_space.sample() == first).all()


def test_pictures_show_the_record_and_change_nothing():
    env = LaneEnv(ENV_ID, render_mode="rgb_array")
    env.reset(seed=3)
    before = env.snapshot()
    frame = env.render()
    assert (frame == env.render()).all() and env.snapshot() == before
    again = LaneEnv(ENV_ID, render_mode="rgb_array")
    again.restore(before)
    assert (again.render() == frame).all()


def test_render_without_a_mode_says_how():
    env = LaneEnv(ENV_ID)
    env.reset(seed=3)
    with pytest.warns(UserWarning, match="write `gymnasium.make"):
        assert env.render() is None


def test_unknown_render_modes_list_the_known_ones():
    with pytest.raises(
        ValueError, match=r"unknown render_mode 'svg'\. Choices: None, 'rgb_array', 'human'"
    ):
        LaneEnv(ENV_ID, render_mode="svg")


def test_only_choices_have_masks():
    assert not hasattr(LaneEnv(ENV_ID), "action_masks")
    env = LaneEnv("visenvs/Herding-v0", estimator="truth")
    env.reset(seed=0)
    assert np.array_equal(env.action_masks(), env.lanes.records["allowed"][0] > 0.5)


def test_presets_of_another_kind_are_refused_with_what_to_write():
    with pytest.raises(ValueError, match=r"unknown scenario 3\. Known: random"):
        LaneEnv(ENV_ID, scenario=3)
    with pytest.raises(ValueError, match=r"unknown scenario \['random'\]; did you mean 'random'"):
        LaneEnv(ENV_ID, scenario=["random"])


def test_human_mode_shows_every_step(monkeypatch):
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    env = LaneEnv(ENV_ID, render_mode="human", t_f=0.3)
    if importlib.util.find_spec("pygame") is None:
        with pytest.raises(DependencyNotInstalled, match=r"visenvs\[viewer\]"):
            env.reset(seed=3)
        return
    import pygame

    env.reset(seed=3)
    assert pygame.display.get_init()
    start = pygame.surfarray.array3d(pygame.display.get_surface())
    env.step(COAST + 1)
    assert (pygame.surfarray.array3d(pygame.display.get_surface()) != start).any()
    assert env.render() is None
    twin = LaneEnv(ENV_ID, render_mode="rgb_array", t_f=0.3)
    twin.restore(env.snapshot())
    shown = pygame.surfarray.array3d(pygame.display.get_surface()).swapaxes(0, 1)
    assert (shown == twin.render()).all()
    env.close()
    env.close()
    assert not pygame.display.get_init()


def test_closing_twice_is_fine_and_resets_still_work():
    env = LaneEnv(ENV_ID)
    env.close()
    env.close()
    assert env.reset(seed=3)[0] in env.observation_space


def test_the_return_is_the_cost_of_the_thesis():
    """(4.2): half of the weighted squares of miss and speed, and of acceleration over time."""
    env = LaneEnv(ENV_ID, scenario="thesis", t_f=2.0)
    env.reset(seed=3)
    total, effort, over = 0.0, 0.0, False
    while not over:
        _, reward, over, _, _ = env.step(COAST + np.float32(0.01))
        record = env.snapshot()[0]
        effort += 0.5 * env.config.dt * float(record["a_V_N"] @ record["a_V_N"])
        total -= reward
    miss, speed = record["r_TV_N"], record["v_V_N"]
    terminal = 0.5 * (env.config.s_x * miss @ miss + env.config.s_v * speed @ speed)
    assert total == pytest.approx(terminal + effort, rel=1e-12)
    assert math.sqrt(miss @ miss) == pytest.approx(record["miss_distance"])
