"""Evaluations under faults: what is finished is kept, and goes on to the same result."""

from __future__ import annotations

import json
import signal

import pytest

from eval import jobs, results, rollout
from eval.leaderboard import Options
from eval.leaderboard import run as evaluate
from eval.shards import fly_shard
from tests.faults.conftest import FULL

ENV = "visenvs/Rendezvous-v0"
EVALUATION = """
import os, signal, sys
from pathlib import Path
import numpy as np
from eval import results, rollout, shards
from eval.leaderboard import Options, run
from visenvs.core.cli import finish
results.RESULTS, out = Path(sys.argv[1]), Path(sys.argv[2])
rollout.SHARD = 10
asked = Options(env="visenvs/Rendezvous-v0", policies="lq", estimator="ekf", episodes=30, json=out)
"""
GO = "finish(lambda: run(asked))\n"
KILLED = """
savez, times = np.savez, []
def save(path, **arrays):
    times.append(path)
    if len(times) == 2:  # in the middle of keeping the second shard
        path.write_bytes(b"PK half a shard")
        os.kill(os.getpid(), signal.SIGKILL)
    savez(path, **arrays)
np.savez = save
"""
SHORT = f"{FULL}\nfill(2000)\n"


def rows(path):
    found = json.loads(path.read_text())["rows"]
    return [{k: v for k, v in row.items() if k != "us_per_decision"} for row in found]


@pytest.fixture
def here(tmp_path, monkeypatch):
    """Evaluate in this process, into a folder of its own unless told; rows and shards flown."""
    monkeypatch.setattr(rollout, "SHARD", 10)

    def here(name, folder=None):
        monkeypatch.setattr(results, "RESULTS", folder or tmp_path / f"{name}-results")
        flown, out = [], tmp_path / f"{name}.json"
        monkeypatch.setattr(jobs, "fly_shard", lambda *call: flown.append(call) or fly_shard(*call))
        evaluate(Options(env=ENV, policies="lq", estimator="ekf", episodes=30, json=out))
        return rows(out), len(flown)

    return here


def test_an_evaluation_that_is_killed_goes_on_to_the_same_result(tmp_path, run, here):
    folder = tmp_path / "results"
    code, _, err = run(EVALUATION + KILLED + GO, folder, tmp_path / "killed.json")
    assert code == -signal.SIGKILL, err
    assert not (tmp_path / "killed.json").exists()
    assert len(list((folder / jobs.UNFINISHED).glob("[!.]*.npz"))) == 1
    again, flown = here("again", folder)
    whole, all_of_them = here("whole")
    assert again == whole
    assert (flown, all_of_them) == (2, 3)


def test_a_full_disk_is_one_line(tmp_path, run):
    code, _, err = run(EVALUATION + SHORT + GO, tmp_path / "results", tmp_path / "a.json")
    assert code == 1
    assert err.splitlines()[-1].startswith("error: ") and "File too large" in err
    assert "Traceback" not in err and not (tmp_path / "a.json").exists()


def test_a_results_folder_without_the_right_to_write_is_told_first(locked, run, powerless):
    code, out, err = run(EVALUATION + GO, locked / "results", "a.json", before=powerless)
    assert (code, out) == (1, "")
    assert err.startswith("error: ") and "Permission denied" in err and err.count("\n") == 1


def test_two_evaluations_in_one_folder_come_to_the_same(tmp_path, start, here):
    folder, outs = tmp_path / "results", [tmp_path / "one.json", tmp_path / "two.json"]
    both = [start(EVALUATION + GO, folder, out) for out in outs]
    errors = [child.communicate(timeout=300)[1] for child in both]
    assert [child.returncode for child in both] == [0, 0], errors
    whole, _ = here("whole")
    assert rows(outs[0]) == rows(outs[1]) == whole
    assert not [path for path in folder.rglob("*") if path.suffix in (".npz", ".tmp")]
