"""Flights as a Minari dataset, and a network cloned from it; needs the extra `offline`."""

from __future__ import annotations

import sys

import numpy as np
import pytest

from agents.registry import load
from eval.rollout import rollout
from train import clone, minari_export
from visenvs.core.cli import guarded
from visenvs.core.registry import load_task

ENV, NAME = "visenvs/Rendezvous-v0", "visenvs/rendezvous/lq-v0"
TASK = load_task(ENV)
CONFIG = TASK.scenarios["random"]


@pytest.fixture(autouse=True)
def shelf(tmp_path, monkeypatch):
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path / "datasets"))


def exported(episodes=8, **more):
    minari = pytest.importorskip("minari", reason="needs the extra `offline`")
    options = minari_export.Options(NAME, ENV, "lq", episodes=episodes, **more)
    assert guarded(lambda: minari_export.run(options)) == 0
    return minari.load_dataset(NAME)


def test_a_dataset_holds_the_flights_of_its_seeds(capsys):
    dataset = exported()
    flown = rollout(load("lq", TASK, CONFIG).policy, TASK, CONFIG, range(8))
    episodes = list(dataset.iterate_episodes())
    assert [len(episode.rewards) for episode in episodes] == flown.steps.tolist()
    totals = [episode.rewards.sum() for episode in episodes]
    np.testing.assert_allclose(totals, flown.returns, rtol=1e-6)
    for episode in episodes:
        assert len(episode.observations) == len(episode.actions) + 1
        ends = episode.terminations | episode.truncations
        assert ends[-1] and not ends[:-1].any()
    assert "train.clone" in capsys.readouterr().out


def test_its_environment_begins_as_its_episodes_do():
    dataset = exported()
    env = dataset.recover_environment()
    episode = next(dataset.iterate_episodes())
    row, _ = env.reset(seed=0)
    np.testing.assert_array_equal(row, episode.observations[0])
    row = env.step(episode.actions[0])[0]
    np.testing.assert_array_equal(row, episode.observations[1])


def test_a_clone_flies_like_its_expert_and_is_loaded_like_any_model(tmp_path):
    exported(60)
    out = tmp_path / "clone"
    assert guarded(lambda: clone.run(clone.Options(NAME, out, passes=60))) == 0
    seeds = range(100_000, 100_050)
    mine, expert, nothing = (
        np.median(
            rollout(load(name, TASK, CONFIG).policy, TASK, CONFIG, seeds).records["miss_distance"]
        )
        for name in (str(out), "lq", "zero")
    )
    assert mine < 0.1 * nothing
    assert mine < 20 * expert


@pytest.mark.parametrize(
    ("wrong", "told"),
    [
        ({"episodes": 0}, "--episodes must be from 1 to 90000, got 0"),
        ({"policy": "lqq"}, "unknown policy 'lqq'"),
        ({"env": "visenvs/Formation-v0", "policy": "follow", "scenario": "team"}, "flies a team"),
    ],
)
def test_a_mistake_in_an_export_is_one_line(capsys, wrong, told):
    pytest.importorskip("minari", reason="needs the extra `offline`")
    options = minari_export.Options(**{"dataset": NAME, "env": ENV, "policy": "lq", **wrong})
    assert guarded(lambda: minari_export.run(options)) == 1
    assert told in capsys.readouterr().err


def test_no_dataset_is_overwritten_and_none_is_made_up(tmp_path, capsys):
    exported(2)
    capsys.readouterr()
    assert guarded(lambda: minari_export.run(minari_export.Options(NAME, ENV, "lq"))) == 1
    assert "minari delete" in capsys.readouterr().err
    assert guarded(lambda: clone.run(clone.Options("visenvs/none-v0", tmp_path / "a"))) == 1
    assert f"there are: {NAME}" in capsys.readouterr().err
    assert guarded(lambda: clone.run(clone.Options(NAME, tmp_path / "a", passes=0))) == 1
    assert "passes must be at least 1" in capsys.readouterr().err


def test_without_minari_the_error_says_what_to_install(monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "minari", None)
    assert guarded(lambda: minari_export.run(minari_export.Options(NAME))) == 1
    assert 'pip install "visenvs[offline]"' in capsys.readouterr().err
