"""Residuals: what a network reads that is told the law's command, and what comes of it."""

from __future__ import annotations

import json

import gymnasium as gym
import numpy as np
import pytest
from stable_baselines3 import PPO

from agents.card import digest
from agents.loading import load_network
from agents.registry import load
from agents.residual import Reading, Residual
from visenvs.core.lanes import Lanes
from visenvs.core.registry import load_task

TASK = load_task("visenvs/Mapping-v0")
CONFIG = TASK.scenarios["town"]
READS = ("v_V_N", "r_V_N")
LAW = load("zigzag", TASK, CONFIG).policy


@pytest.fixture
def rows():
    lanes = Lanes(TASK, CONFIG, 3)
    lanes.reset(range(3))
    for _ in range(4):
        lanes.step(LAW.predict(lanes.rows)[0])
    return lanes.rows


@pytest.fixture
def file(tmp_path):
    """A network that reads some fields and the law's command."""
    task = Reading(TASK, READS).task

    class Still(gym.Env):
        observation_space, action_space = task.observation.space, task.action.space

    PPO("MlpPolicy", Still(), n_steps=8, batch_size=8, seed=1).save(tmp_path / "model.zip")
    return tmp_path / "model.zip"


def carded(file, **residual):
    card = {"information": "belief", "algo": "ppo", "steps": 0, "sha256": digest(file)}
    card["residual"] = {"law": "zigzag", "scale": 0.25, "reads": list(READS)} | residual
    file.with_name("card.json").write_text(json.dumps(card))
    return str(file.parent)


def test_what_is_read_are_the_fields_as_asked_for_and_the_laws_commands(rows):
    reading, command = Reading(TASK, READS), LAW.predict(rows)[0]
    layout, si = reading.task.observation, TASK.observation.unpack(rows)
    assert layout.names == ("v_V_N", "r_V_N", "law_a_V_N", "law_tilt")
    read = layout.unpack(reading.rows(rows, command))
    assert np.array_equal(read["v_V_N"], si["v_V_N"]) and np.abs(si["v_V_N"]).max() > 1.0
    assert np.array_equal(read["r_V_N"], si["r_V_N"])
    assert np.array_equal(np.hstack([read["law_a_V_N"], read["law_tilt"]]), command)


def test_a_network_that_is_told_flies_the_law_and_its_share(file, rows):
    found, _ = load(carded(file, scale=[0.5, 0.5, 0.1, 0.1]), TASK, CONFIG).policy.predict(rows)
    reading, command = Reading(TASK, READS), LAW.predict(rows)[0]
    network = load_network(file, reading.task)
    net, _ = network.predict(reading.rows(rows, command), deterministic=True)
    share = np.array([0.5, 0.5, 0.1, 0.1], np.float32)
    assert found == pytest.approx(np.clip(command + share * net, -1.0, 1.0), abs=1e-6)
    assert np.abs(found - command).max() > 1e-3


def test_a_field_that_no_row_has_is_refused(file):
    with pytest.raises(ValueError, match="unknown field of the row 'v_V'; did you mean 'v_V_N'"):
        load(carded(file, reads=["v_V"]), TASK, CONFIG)


def test_as_many_scales_as_an_action_has_numbers_or_one(file):
    with pytest.raises(ValueError, match=r"one number or 4, got \[0.5, 0.5\]"):
        load(carded(file, scale=[0.5, 0.5]), TASK, CONFIG)
    with pytest.raises(ValueError, match=r"must lie in \(0, 1\], got \[0.5, 0.5, 0.1, 0.0\]"):
        load(carded(file, scale=[0.5, 0.5, 0.1, 0.0]), TASK, CONFIG)


def test_the_wanted_action_comes_out_of_what_is_missing(rows):
    residual, command = Residual(LAW, (0.5, 0.5, 0.1, 0.1)), LAW.predict(rows)[0]
    wanted = 0.5 * command.astype(float) + 0.01
    correction = residual.missing(command, wanted).astype(np.float32)
    assert residual.combine(command, correction) == pytest.approx(wanted, abs=1e-6)
