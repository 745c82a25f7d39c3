"""What Gymnasium promises to those who use an environment."""

from __future__ import annotations

import copy
import importlib.util
import pickle
import warnings

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env, data_equivalence

SEED = 31


def same(one, other):
    return data_equivalence(one, other, exact=True)


def stagger(envs, steps=5):
    """Begin anew in the first lane after some steps, so that lanes end at different times."""
    mask = np.zeros(envs.num_envs, bool)
    mask[0] = True
    for _ in range(steps):
        envs.step(np.zeros(envs.action_space.shape, np.float32))
    envs.reset(options={"reset_mask": mask})


def trajectory(envs, actions):
    return [envs.step(action) for action in actions]


def test_the_checker_finds_nothing(case, monkeypatch):
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    window = importlib.util.find_spec("pygame") is not None
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(case.single().unwrapped, skip_render_check=not window)


def test_pictures_are_rgb_arrays(case):
    if not case.task.picture:
        with pytest.raises(ValueError, match=r"unknown render_mode 'rgb_array'\. Choices: None"):
            case.single(render_mode="rgb_array")
        return
    env = case.single(render_mode="rgb_array")
    env.reset(seed=SEED)
    first = env.render()
    assert first.dtype == np.uint8 and first.ndim == 3 and first.shape[2] == 3
    for action in case.actions(3):
        env.step(action)
    assert (env.render() != first).any()
    assert env.render().shape == first.shape


def test_spaces_contain_what_comes_out(case):
    envs = case.vector(4)
    row, _ = envs.reset(seed=SEED)
    assert row in envs.observation_space
    assert envs.single_observation_space.is_bounded()
    for action in case.actions(450, 4):
        row, reward, terminated, truncated, _ = envs.step(action)
        assert row in envs.observation_space
        assert np.isfinite(reward).all()
        assert not (terminated & truncated).any()


@pytest.mark.parametrize("value", [1e300, -1e300, np.inf, np.nan])
def test_spaces_contain_rows_of_absurd_beliefs(case, value):
    lanes = case.lanes(1)
    lanes.reset([SEED])
    absurd = lanes.snapshot()
    for name in case.task.observation.names:
        absurd[name] = value
    lanes.restore(absurd)
    assert lanes.rows[0] in case.task.observation.space


def test_the_native_vector_is_the_loop_of_single_environments(case):
    native, loop = case.vector(3), case.loop(3)
    assert type(native).__name__ == "LaneVectorEnv" and type(loop) is gym.vector.SyncVectorEnv
    assert native.observation_space == loop.observation_space
    assert native.action_space == loop.action_space
    assert native.metadata["autoreset_mode"] == loop.metadata["autoreset_mode"]
    assert same(native.reset(seed=SEED), loop.reset(seed=SEED))
    stagger(native)
    stagger(loop)
    ends = 0
    for step, action in enumerate(case.actions(2000, 3)):
        ours, theirs = native.step(action), loop.step(action)
        assert same(ours, theirs)
        ends += (ours[2] | ours[3]).sum()
        if step >= 499 and (ends >= 3 or case.scenario == "endless"):
            break
    assert case.scenario == "endless" or ends >= 3


def test_results_do_not_depend_on_the_number_of_lanes(case):
    actions = case.actions(450, 64)
    rows = {}
    for count in (1, 3, 64):
        envs = case.vector(count)
        first, _ = envs.reset(seed=SEED)
        steps = trajectory(envs, actions[:, :count])
        rows[count] = [first[0].tobytes(), *(step[0][0].tobytes() for step in steps)]
        rows[count] += [step[1][0].tobytes() for step in steps]
    assert rows[1] == rows[3] == rows[64]


def test_a_seed_is_a_trajectory(case):
    actions = case.actions(1000)
    runs = []
    for seed in (SEED, SEED, SEED + 1):
        env = case.single()
        row, _ = env.reset(seed=seed)
        records = [env.unwrapped.snapshot()]
        seen = [row]
        for action in actions:
            row, reward, terminated, truncated, info = env.step(action)
            seen += [row, reward, info]
            records.append(env.unwrapped.snapshot())
            if terminated or truncated:
                seen.append(env.reset()[0])
        runs.append((seen, b"".join(record.tobytes() for record in records), records))
    (seen, raw, records), (seen_again, raw_again, _), (_, _, others) = runs
    assert same(seen, seen_again) and raw == raw_again
    names = [name for name in case.task.lane.names if name != "seed"]
    assert any(
        (one[name] != other[name]).any()
        for one, other in zip(records, others, strict=True)
        for name in names
    )


def test_the_next_episode_of_a_seed_is_another_one(case):
    env = case.single()
    env.reset(seed=SEED)
    first = [env.unwrapped.snapshot()]
    first += [env.step(a) and env.unwrapped.snapshot() for a in case.actions(3)]
    env.reset()
    second = [env.unwrapped.snapshot()]
    second += [env.step(a) and env.unwrapped.snapshot() for a in case.actions(3)]
    assert second[0]["seed"] == SEED and second[0]["episode"] == 1
    names = [name for name in case.task.lane.names if name != "episode"]
    assert any(
        (one[name] != other[name]).any()
        for one, other in zip(first, second, strict=True)
        for name in names
    )


def test_a_snapshot_replays(case):
    envs = case.vector(3)
    envs.reset(seed=SEED)
    trajectory(envs, case.actions(17, 3))
    actions = case.actions(300, 3, seed=8)
    before = envs.unwrapped.snapshot()
    flown = trajectory(envs, actions)
    envs.unwrapped.restore(before)
    assert same(flown, trajectory(envs, actions))
    fresh = case.vector(3)
    fresh.restore(before)
    assert same(flown, trajectory(fresh, actions))


@pytest.mark.parametrize("duplicate", [copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))])
def test_copies_and_pickles_fly_on_alone(case, duplicate):
    for env, shape in ((case.single(), ()), (case.vector(2), (2,))):
        env.reset(seed=SEED)
        trajectory(env, case.actions(3, *shape))
        actions = case.actions(20, *shape, seed=8)
        twin = duplicate(env)
        assert same(env.unwrapped.lanes.rewards, twin.unwrapped.lanes.rewards)
        assert same(env.unwrapped.lanes.terms, twin.unwrapped.lanes.terms)
        flown = trajectory(env, actions[:2])
        twin_flown = trajectory(twin, actions[:2])
        assert same(flown, twin_flown)
        assert same(twin.reset()[0], env.reset()[0])


def test_specs_survive_json(case):
    env = case.single()
    spec = gym.envs.registration.EnvSpec.from_json(env.spec.to_json())
    assert spec == env.spec
    again = gym.make(spec)
    assert again.unwrapped.config == env.unwrapped.config
    assert same(again.reset(seed=SEED), env.reset(seed=SEED))
    envs = case.vector(2)
    spec = gym.envs.registration.EnvSpec.from_json(envs.spec.to_json())
    assert same(gym.make_vec(spec).reset(seed=SEED), envs.reset(seed=SEED))
