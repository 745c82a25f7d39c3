"""Lanes as SB3 sees them, beside SB3's own vector of single environments and bare lanes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from stable_baselines3 import PPO
from stable_baselines3.common.env_checker import check_env
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import DummyVecEnv, VecMonitor, VecNormalize

from agents.registry import load
from agents.residual import Reading, Residual
from eval.rollout import rollout
from tests.toys import toys
from train.shaping import potential_of
from train.vec_env import LaneVecEnv
from visenvs.core.lanes import Lanes
from visenvs.core.registry import load_task
from visenvs.faces.single import LaneEnv

with toys():
    CART = load_task("visenvs/Cart-v0")
SHORT = {"radius": 0.1, "longest": 12}  # some stop at the origin, the others are cut off
CARTS = replace(CART.scenarios["plain"], **SHORT)
RENDEZVOUS = load_task("visenvs/Rendezvous-v0")
BRIEF = replace(RENDEZVOUS.scenarios["random"], t_f=1.0)  # 10 steps


def pushes(env, steps, seed=0):
    """Random actions for every lane, step by step."""
    rng = np.random.default_rng(seed)
    shape = (steps, env.num_envs, *env.action_space.shape)
    return rng.uniform(-1.0, 1.0, shape).astype(np.float32)


def flown(env, actions):
    """Rows, rewards, dones and infos of every step after a reset."""
    env.reset()
    rows, rewards, dones, infos = zip(*(env.step(action) for action in actions), strict=True)
    return np.array(rows), np.array(rewards), np.array(dones), infos


def brief(**extras):
    return LaneVecEnv(RENDEZVOUS, BRIEF, range(7, 10), **extras)


def single_carts(count):
    """SB3's own vector of the same carts."""

    def make():
        with toys():
            return Monitor(LaneEnv("visenvs/Cart-v0", "plain", **SHORT))

    return DummyVecEnv([make] * count)


def test_it_is_sb3s_vector_of_single_environments_bit_for_bit():
    ours, theirs = LaneVecEnv(CART, CARTS, range(5, 25)), single_carts(20)
    theirs.seed(5)
    assert ours.observation_space == theirs.observation_space
    assert ours.action_space == theirs.action_space
    first, expected = ours.reset(), theirs.reset()
    assert np.array_equal(first, expected) and first.dtype == expected.dtype
    cut, stopped = 0, 0
    for action in pushes(ours, 40):
        one, two = ours.step(action), theirs.step(action)
        for mine, other in zip(one[:3], two[:3], strict=True):
            assert np.array_equal(mine, other)
            assert (mine.dtype, mine.shape) == (other.dtype, other.shape)
        for mine, other in zip(one[3], two[3], strict=True):
            assert ("episode" in mine) == ("episode" in other)
            if "episode" in mine:
                assert np.array_equal(mine["terminal_observation"], other["terminal_observation"])
                assert mine["TimeLimit.truncated"] is other["TimeLimit.truncated"]
                assert mine["episode"]["l"] == other["episode"]["l"]
                assert mine["episode"]["r"] == pytest.approx(other["episode"]["r"], abs=1e-5)
                assert mine["is_success"] is not mine["TimeLimit.truncated"]
                cut += mine["TimeLimit.truncated"]
                stopped += mine["is_success"]
    assert cut > 5 and stopped > 5


def test_it_flies_as_bare_lanes_do_and_starts_again_by_itself():
    env, lanes = brief(), Lanes(RENDEZVOUS, BRIEF, 3)
    lanes.reset(range(7, 10))
    assert np.array_equal(env.reset(), lanes.rows)
    sums = np.zeros(3)
    for step, action in enumerate(pushes(env, 25), start=1):
        rows, rewards, done, infos = env.step(action)
        lanes.step(action)
        sums += lanes.rewards
        assert rewards == pytest.approx(lanes.rewards, rel=1e-6)
        assert done.tolist() == [step % 10 == 0] * 3
        if step % 10 == 0:
            for i, info in enumerate(infos):
                assert np.array_equal(info["terminal_observation"], lanes.rows[i])
                assert info["episode"]["r"] == pytest.approx(sums[i], rel=1e-12)
                assert info["episode"]["l"] == 10
                assert info["TimeLimit.truncated"] is False  # it ends by itself, at t_f
            lanes.reset()
            sums[:] = 0.0
        assert np.array_equal(rows, lanes.rows)


def test_what_is_returned_is_the_callers_to_keep():
    env = brief()
    rows, rewards, dones, infos = flown(env, pushes(env, 12))
    again = flown(env, pushes(env, 12))
    assert np.array_equal(rows, again[0]) and np.array_equal(rewards, again[1])
    kept = infos[9][0]["terminal_observation"].copy()
    env.step(pushes(env, 1)[0])
    assert np.array_equal(infos[9][0]["terminal_observation"], kept)
    assert dones.sum(axis=1).tolist() == [0] * 9 + [3] + [0] * 2


def test_the_space_of_a_view_is_the_views():
    task = load_task("visenvs/Tracking2D-v0")
    env = LaneVecEnv(task, task.scenarios["raw"], [0])
    assert env.observation_space.shape == (task.views["raw"].size,)
    assert env.reset().shape == (1, task.views["raw"].size)


def test_a_residual_adds_the_laws_action():
    law = load("lq", RENDEZVOUS, BRIEF).policy
    env, lanes = brief(residual=Residual(law, 0.25)), Lanes(RENDEZVOUS, BRIEF, 3)
    env.reset()
    lanes.reset(range(7, 10))
    for correction in pushes(env, 9):
        aim, _ = law.predict(lanes.rows)
        lanes.step(np.clip(aim + np.float32(0.25) * correction, -1.0, 1.0))
        assert np.array_equal(env.step(correction)[0], lanes.rows)


def test_a_network_that_is_told_reads_its_fields_and_the_laws_command():
    law = load("lq", RENDEZVOUS, BRIEF).policy
    reading = Reading(RENDEZVOUS, ("t_go", "v_V_N"))
    env, lanes = brief(residual=Residual(law, 0.25, reading)), Lanes(RENDEZVOUS, BRIEF, 3)
    lanes.reset(range(7, 10))

    def expected():
        row, columns = lanes.rows, RENDEZVOUS.observation.columns
        return np.hstack([row[:, columns(["t_go", "v_V_N"])], law.predict(row)[0]])

    rows, last = env.reset(), None
    assert env.observation_space.shape == rows.shape[1:] == (1 + 3 + 3,)
    for k, correction in enumerate(pushes(env, 12)):
        assert np.array_equal(rows, expected())
        lanes.step(np.clip(rows[:, -3:] + np.float32(0.25) * correction, -1.0, 1.0))
        if k == 9:
            last = expected()
            lanes.reset()
        rows, _, done, infos = env.step(correction)
        assert done.all() == (k == 9)
        if k == 9:
            assert np.array_equal([info["terminal_observation"] for info in infos], last)


def test_no_correction_is_the_law_itself():
    law = load("lq", RENDEZVOUS, BRIEF).policy
    still = np.zeros((10, 3, 3), np.float32)
    *_, infos = flown(brief(residual=Residual(law, 1.0)), still)
    costs = [-info["episode"]["r"] for info in infos[-1]]
    expected = rollout(law, RENDEZVOUS, BRIEF, range(7, 10)).returns
    assert costs == pytest.approx(-expected, rel=1e-12)


@pytest.mark.parametrize("scale", [0.0, -0.1, 1.5])
def test_a_residual_has_a_scale_within_the_box(scale):
    with pytest.raises(ValueError, match=rf"must lie in \(0, 1\], got {scale}"):
        Residual(load("lq", RENDEZVOUS, BRIEF).policy, scale)


def test_shaping_changes_a_return_by_the_potential_of_the_start_alone():
    potential = potential_of(RENDEZVOUS, BRIEF)
    env, bare = brief(potential=potential), brief()
    actions = pushes(env, 20)
    env.reset()
    starts = [potential(env.lanes.records)]
    _, shaped, dones, infos = flown(env, actions)
    *_, plain = flown(bare, actions)
    lanes = Lanes(RENDEZVOUS, BRIEF, 3)
    lanes.reset(range(7, 10))
    lanes.reset()
    starts.append(potential(lanes.records))
    for end, start in zip((9, 19), starts, strict=True):
        assert dones[end].all()
        bare_return = np.array([info["episode"]["r"] for info in plain[end]])
        told = np.array([info["episode"]["r"] for info in infos[end]])
        assert np.array_equal(told, bare_return)  # the log tells the cost as it is
        total = shaped[end - 9 : end + 1].sum(axis=0)
        assert np.abs(start).min() > 1.0
        assert total + start == pytest.approx(bare_return, rel=1e-5)


def test_rewards_stop_at_the_floor_and_the_log_does_not():
    env, bare = brief(reward_floor=-3.0), brief()
    actions = pushes(env, 10)
    _, cut, _, infos = flown(env, actions)
    _, whole, _, plain = flown(bare, actions)
    assert np.array_equal(cut, np.maximum(whole, -3.0))
    assert (whole < -3.0).any() and (whole > -3.0).any()
    assert [info["episode"]["r"] for info in infos[-1]] == [
        info["episode"]["r"] for info in plain[-1]
    ]


def test_what_is_cut_off_below_is_cut_off_above():
    """Else a potential lost at once and regained at once would pay."""

    def wave(lanes):
        return 10.0 * np.sin(2.0 * lanes["step"].astype(float))

    env, bare = brief(reward_floor=-3.0, potential=wave), brief(potential=wave)
    actions = pushes(env, 8) * 0.0
    _, cut, _, _ = flown(env, actions)
    _, whole, _, _ = flown(bare, actions)
    assert (whole > 3.0).any() and (whole < -3.0).any()
    assert np.array_equal(cut, np.clip(whole, -3.0, 3.0))


def test_a_seed_counts_from_the_next_reset_as_in_sb3():
    env = LaneVecEnv(CART, CARTS, [3, 1, 4])
    first = env.reset()
    assert env.seed() == [3, 1, 4]
    assert env.seed(20) == [20, 21, 22]
    rows = env.reset()
    assert (rows[:, 0] != first[:, 0]).all()
    assert np.array_equal(rows, LaneVecEnv(CART, CARTS, range(20, 23)).reset())
    assert np.array_equal(rows, env.reset())


def test_lanes_have_no_attributes_or_methods_of_their_own():
    env = brief()
    assert env.get_attr("num_envs", [0, 2]) == [3, 3]
    assert env.has_attr("action_space") and not env.has_attr("gravity")
    with pytest.raises(AttributeError, match="no attribute 'gravity' of their own; pass it in the"):
        env.set_attr("gravity", 9.81)
    with pytest.raises(AttributeError, match="no method 'reload'"):
        env.env_method("reload")
    assert env.env_is_wrapped(Monitor) == [False] * 3
    assert env.env_is_wrapped(Monitor, 1) == [False]
    assert env.render_mode is None


def test_a_bad_action_is_refused_before_any_lane_moves():
    env = brief()
    env.reset()
    before = env.lanes.snapshot()
    action = np.zeros((3, 3), np.float32)
    action[1, 0] = np.nan
    with pytest.raises(ValueError, match="action of lane 1 must be finite"):
        env.step(action)
    with pytest.raises(ValueError, match=r"actions must have shape \(3, 3\)"):
        env.step(action[:2])
    assert env.lanes.records.tobytes() == before.tobytes()


@pytest.mark.parametrize("env_id", ["visenvs/Rendezvous-v0", "visenvs/BearingsOnly-v0"])
def test_sb3s_checker_has_nothing_to_say(env_id):
    check_env(LaneEnv(env_id))  # warnings are errors


def test_sb3s_monitor_tells_the_same_returns():
    env = VecMonitor(brief())
    *_, infos = flown(env, pushes(env, 10))
    *_, own = flown(brief(), pushes(env, 10))
    for theirs, ours in zip(infos[-1], own[-1], strict=True):
        assert theirs["episode"]["l"] == ours["episode"]["l"] == 10
        assert theirs["episode"]["r"] == pytest.approx(ours["episode"]["r"], rel=1e-5)


def test_sb3s_normaliser_and_evaluation_run_on_it():
    env = VecNormalize(brief(), norm_reward=False)
    assert np.abs(env.reset()).max() <= 10.0
    model = PPO("MlpPolicy", brief(), n_steps=10, batch_size=30, device="cpu", seed=4)
    assert model.get_env().seed() == [4, 5, 6]
    returns, lengths = evaluate_policy(
        model, brief(), n_eval_episodes=6, warn=False, return_episode_rewards=True
    )
    assert lengths == [10] * 6
    lanes = Lanes(RENDEZVOUS, BRIEF, 3)
    lanes.reset(range(7, 10))
    expected = []
    for _ in range(2):
        sums = np.zeros(3)
        while not lanes.done.any():
            lanes.step(model.predict(lanes.rows, deterministic=True)[0])
            sums += lanes.rewards
        expected += sums.tolist()
        lanes.reset()
    assert returns == pytest.approx(expected, rel=1e-5)
