"""The network that chooses: in which order things are listed does not matter; files are safe."""

import numpy as np
import pytest
import torch
from sb3_contrib import MaskablePPO

from agents.choosing import SetChoicePolicy
from agents.loading import load_network
from train.vec_env import LaneVecEnv
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
