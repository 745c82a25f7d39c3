from __future__ import annotations

import numpy as np
import pytest

from agents.classical import LawPolicy, ZeroPolicy
from eval import rollout as module
from eval.rollout import PUBLIC_SEEDS, public_seeds, rollout
from visenvs.core.outcome import Outcome
from visenvs.core.registry import laws, load_task

SEEDS = PUBLIC_SEEDS[:7]


@pytest.fixture(scope="module")
def task():
    return load_task("visenvs/Rendezvous-v0")


@pytest.fixture(scope="module")
def config(task):
    return task.scenarios["random"]


def test_every_seed_flies_once_to_its_end(task, config):
    flown = rollout(ZeroPolicy(task), task, config, SEEDS)
    np.testing.assert_array_equal(flown.records["seed"], SEEDS)
    assert (flown.records["outcome"] != Outcome.RUNNING).all()
    np.testing.assert_array_equal(flown.records["episode"], 0)
    np.testing.assert_array_equal(flown.steps, round(config.t_f / config.dt))


def test_results_do_not_depend_on_how_the_seeds_are_divided(task, config, monkeypatch):
    law = LawPolicy(laws()["osa"], task, config)
    together = rollout(law, task, config, SEEDS)
    monkeypatch.setattr(module, "SHARD", 2)
    divided = rollout(law, task, config, SEEDS)
    np.testing.assert_array_equal(together.records, divided.records)
    np.testing.assert_array_equal(together.returns, divided.returns)


def test_the_first_decision_is_not_timed(task, config):
    flown = rollout(ZeroPolicy(task), task, config, SEEDS)
    assert flown.decisions == len(SEEDS) * (round(config.t_f / config.dt) - 1)


def test_a_policy_that_breaks_is_named_as_the_cause(task, config):
    class Broken(ZeroPolicy):
        def predict(self, observation, state=None, episode_start=None, deterministic=True):
            raise KeyError("gain")

    with pytest.raises(ValueError, match=r"its predict\(\) failed: KeyError: 'gain'"):
        rollout(Broken(task), task, config, SEEDS)


def test_a_policy_that_asks_for_nan_is_refused(task, config):
    class Nan(ZeroPolicy):
        def predict(self, observation, state=None, episode_start=None, deterministic=True):
            return np.full((len(observation), 3), np.nan, np.float32), state

    with pytest.raises(ValueError, match="action of lane 0 must be finite"):
        rollout(Nan(task), task, config, SEEDS)


def test_memory_travels_and_is_cleared_at_the_start(task, config):
    class Counting(ZeroPolicy):
        def predict(self, observation, state=None, episode_start=None, deterministic=True):
            assert episode_start.all() == (state is None)
            seen.append(0 if state is None else state + 1)
            return super().predict(observation)[0], seen[-1]

    seen: list[int] = []
    rollout(Counting(task), task, config, SEEDS)
    assert seen == list(range(round(config.t_f / config.dt)))


@pytest.mark.parametrize("episodes", [0, -1, len(PUBLIC_SEEDS) + 1])
def test_there_are_no_more_public_seeds_than_the_public_seeds(episodes):
    with pytest.raises(ValueError, match=f"from 1 to 1000, got {episodes}"):
        public_seeds(episodes)


def test_fewer_episodes_are_the_first_public_seeds():
    assert list(public_seeds(3)) == [100_000, 100_001, 100_002]
    assert list(public_seeds(1000))[-1] == 100_999
