"""The network that chooses: in which order things are listed does not matter; files are safe."""

import numpy as np
import pytest
import torch
from gymnasium import Env
from sb3_contrib import MaskablePPO
from stable_baselines3 import PPO

from agents.choosing import SetChoicePolicy
from agents.learned import LearnedPolicy
from agents.loading import load_network
from train.vec_env import LaneVecEnv
from visenvs.core.config import override
from visenvs.core.registry import load_task

TASK = load_task("visenvs/Herding-v0")
LAYOUT, CHOICES = TASK.observation, TASK.action
NETWORK = {"choices": CHOICES, "layout": LAYOUT, "width": 16}


@pytest.fixture(scope="module")
def policy():
    torch.manual_seed(0)
    return SetChoicePolicy(LAYOUT.space, CHOICES.space, lambda _: 0.0, **NETWORK)


def answer(policy, rows):
    with torch.no_grad():
        told = torch.from_numpy(rows)
        return policy.get_distribution(told).distribution.logits.numpy(), policy.predict_values(
            told
        )


def test_another_order_of_things_gives_their_logits_in_that_order(policy):
    rng = np.random.default_rng(1)
    rows = rng.uniform(-1, 1, (5, LAYOUT.size)).astype(np.float32)
    _, listed = LAYOUT.members()
    order = rng.permutation(len(listed))
    shuffled = rows.copy()
    shuffled[:, listed] = rows[:, listed[order]]
    (logits, worth), (other, same) = answer(policy, rows), answer(policy, shuffled)
    own = np.arange(CHOICES.first, CHOICES.first + 10 * CHOICES.apiece).reshape(10, -1)
    expected = logits.copy()
    expected[:, own] = logits[:, own[order]]
    assert other == pytest.approx(expected, abs=1e-5)
    assert same.numpy() == pytest.approx(worth.numpy(), abs=1e-5)
    assert np.abs(other - logits).max() > 1e-3


def test_things_that_are_not_there_tell_nothing(policy):
    rng = np.random.default_rng(2)
    rows = rng.uniform(-1, 1, (3, LAYOUT.size)).astype(np.float32)
    _, listed = LAYOUT.members()
    rows[:, listed[4:]] = 0.0
    worth = answer(policy, rows)[1]
    moved = rows.copy()
    moved[:, listed[9]] = rows[:, listed[0]]
    moved[:, listed[0]] = 0.0
    assert answer(policy, moved)[1].numpy() == pytest.approx(worth.numpy(), abs=1e-5)


def test_a_file_is_rebuilt_without_running_it(tmp_path):
    lanes = LaneVecEnv(TASK, TASK.scenarios["firmware"], range(2))
    model = MaskablePPO(SetChoicePolicy, lanes, policy_kwargs=NETWORK, device="cpu", n_steps=8)
    model.save(tmp_path / "model.zip")
    network = load_network(tmp_path / "model.zip", TASK)
    rows = lanes.reset()
    masks = lanes.lanes.allowed
    ours, _ = network.predict(rows, action_masks=masks, deterministic=True)
    theirs, _ = model.predict(rows, action_masks=masks, deterministic=True)
    assert ours.tolist() == theirs.tolist()


@pytest.mark.parametrize("trust", [False, True])
def test_a_network_of_the_other_kind_of_action_is_told_which_setting_fits(trust, tmp_path):
    velocity = TASK.under(override(TASK.scenarios["firmware"], {"action_mode": "velocity"}))
    env = Env()
    env.observation_space, env.action_space = velocity.space, velocity.action.space
    model = PPO("MlpPolicy", env, n_steps=8, batch_size=8, device="cpu")
    model.save(tmp_path / "model.zip")
    words = 'on actions of numbers, .* takes the number of one of .*action_mode="velocity"'
    with pytest.raises(ValueError, match=words):
        load_network(tmp_path / "model.zip", TASK, trust)
    policy = LearnedPolicy(load_network(tmp_path / "model.zip", velocity, trust), velocity)
    rows = np.zeros((2, velocity.observation.size), np.float32)
    assert np.array_equal(policy.predict(rows)[0], model.predict(rows, deterministic=True)[0])
    env.action_space = CHOICES.space
    chooser = MaskablePPO("MlpPolicy", env, n_steps=8, batch_size=8, device="cpu")
    chooser.save(tmp_path / "chooser.zip")
    with pytest.raises(ValueError, match=r"was trained to choose, .* takes "):
        load_network(tmp_path / "chooser.zip", velocity, trust)
