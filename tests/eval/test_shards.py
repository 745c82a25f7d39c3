"""Evaluations in shards: the same on every backend, and kept when broken off."""

import json
import shutil

import numpy as np
import pytest

from agents.registry import shipped
from eval import jobs, leaderboard, results, rollout, shards
from eval.leaderboard import Options, run
from eval.shards import Flight, Store, fly_shard
from visenvs.core.registry import load_task

ENV = "visenvs/Tracking2D-v0"
POLICIES = "random,lq,ppo-lq"


@pytest.fixture(autouse=True)
def small(monkeypatch, tmp_path):
    monkeypatch.setattr(results, "RESULTS", tmp_path / "results")
    monkeypatch.setattr(rollout, "SHARD", 20)


def evaluate(tmp_path, name, **options):
    path = tmp_path / f"{name}.json"
    run(Options(env=ENV, policies=POLICIES, estimator="ekf", json=path, **options))
    rows = json.loads(path.read_text())["rows"]
    return [{k: v for k, v in row.items() if k != "us_per_decision"} for row in rows]


def test_processes_come_to_the_same_as_one(tmp_path):
    local = evaluate(tmp_path, "local", episodes=30)
    spread = evaluate(tmp_path, "spread", episodes=30, backend="processes", workers=2)
    assert local == spread


def test_environments_take_turns_from_the_first_call_on():
    assert jobs.spread([[1, 2, 3, 4], [], ["a", "b"], ["A"]]) == [1, "a", "A", 2, 3, "b", 4]


def test_an_evaluation_that_was_broken_off_goes_on(tmp_path, monkeypatch):
    whole = evaluate(tmp_path, "whole", episodes=30)
    made = []

    def fragile(flight, seeds):
        if len(made) == 3:
            raise KeyboardInterrupt
        made.append((flight.policy, seeds[0]))
        return fly_shard(flight, seeds)

    monkeypatch.setattr(jobs, "fly_shard", fragile)
    with pytest.raises(KeyboardInterrupt, match="1 of 3 finished"):
        evaluate(tmp_path, "broken", episodes=30)
    kept = list((tmp_path / "results" / jobs.UNFINISHED).iterdir())
    assert len(kept) == 1 and not (tmp_path / "broken.json").exists()
    before = list(made)
    made.clear()
    monkeypatch.setattr(jobs, "fly_shard", lambda *call: made.append(call) or fly_shard(*call))
    assert evaluate(tmp_path, "again", episodes=30) == whole
    again = [(flight.policy, seeds[0]) for flight, seeds in made]
    assert (before[2] not in again) and len(again) == 5
    assert not list((tmp_path / "results" / jobs.UNFINISHED).iterdir())


def test_a_broken_shard_is_flown_again(tmp_path):
    task = load_task(ENV)
    store = Store(tmp_path)
    flight = Flight(ENV, task.scenarios["random"], "lq", False)
    path = store.path(flight, range(100_000, 100_005))
    flown = fly_shard(flight, range(100_000, 100_005))
    store.save(path, flown)
    kept = store.load(path)
    assert kept is not None
    np.testing.assert_array_equal(kept.records, flown.records)
    assert kept.decisions == flown.decisions
    path.write_bytes(path.read_bytes()[:100])
    assert store.load(path) is None
    assert store.load(tmp_path / "none.npz") is None


def test_shards_of_other_seeds_or_sources_are_other_shards(tmp_path, monkeypatch):
    store = Store(tmp_path)
    flight = Flight(ENV, load_task(ENV).scenarios["random"], "lq", False)
    path = store.path(flight, range(5))
    assert path != store.path(flight, range(6))
    monkeypatch.setattr(shards, "sources", lambda: "edited")
    assert path != store.path(flight, range(5))


def test_shards_of_another_model_or_card_are_other_shards(tmp_path):
    """A card says on which law, and how far, a network corrects."""
    config = load_task(ENV).scenarios["random"]
    folder = tmp_path / "ppo"
    shutil.copytree(shipped(ENV)["ppo-lq"].parent, folder)
    seen = set()
    for name in (None, "card.json", "model.zip"):
        if name is not None:
            with (folder / name).open("ab") as file:
                file.write(b" ")
        for policy in (str(folder), str(folder / "model.zip")):
            seen.add(Store(tmp_path).path(Flight(ENV, config, policy, False), range(5)))
    assert len(seen) == 6


def test_the_backend_is_checked_before_anything_flies(tmp_path, monkeypatch):
    monkeypatch.setattr(leaderboard, "make_boards", None)
    with pytest.raises(ValueError, match="--workers must be at least 1"):
        run(Options(env=ENV, policies="lq", workers=0))
