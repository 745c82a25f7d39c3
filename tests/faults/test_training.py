"""Training under faults: a killed run goes on from its checkpoint, a full disk loses none."""

from __future__ import annotations

import json
import signal
import zipfile

import pytest

from agents.card import read_card
from agents.loading import load_network
from tests.faults.conftest import FULL
from visenvs.core.registry import load_task

TRAINING = """
import os, signal, sys, warnings
from pathlib import Path
warnings.simplefilter("ignore")
from train import build, callbacks, sb3
from train.presets import Preset
from visenvs.core.cli import finish
model = {"n_steps": 64, "batch_size": 256, "n_epochs": 1, "gamma": 1.0, "learning_rate": 1e-3}
build.VALIDATION_SEEDS = range(90_000, 90_003)
preset = Preset(8, model, {"net_arch": [8]}, validation=3)
asked = sb3.Options(out=Path(sys.argv[1]), steps=1536, validate_every=512)
"""
GO = "finish(lambda: sb3.train(asked, preset))\n"
KILLED = """
kept, times = callbacks.checkpoint, []
class Half:  # in the middle of writing the second checkpoint
    def save(self, path):
        path.write_bytes(b"PK half a checkpoint")
        os.kill(os.getpid(), signal.SIGKILL)
def checkpoint(model, out):
    times.append(out)
    kept(Half() if len(times) == 2 else model, out)
callbacks.checkpoint = checkpoint
"""
WITHOUT_CARD = """
card, times = sb3.card, []
def killed(*told):  # the second model is there, its card is not
    times.append(told)
    if len(times) == 2:
        os.kill(os.getpid(), signal.SIGKILL)
    return card(*told)
sb3.card = killed
found, costs = callbacks.validate, iter([3.0, 2.0])
callbacks.validate = lambda *told: {**found(*told), "cost_mean": next(costs)}
"""
SHORT = (
    FULL
    + """
kept, times = callbacks.checkpoint, []
def checkpoint(model, out):
    times.append(out)
    if len(times) == 2:
        fill(3000)
    kept(model, out)
callbacks.checkpoint = checkpoint
"""
)


@pytest.mark.parametrize(
    "fault, code",
    [(KILLED, -signal.SIGKILL), (WITHOUT_CARD, -signal.SIGKILL), (SHORT, 1)],
    ids=["killed", "killed before the card", "full disk"],
)
def test_a_run_that_broke_off_goes_on_from_its_checkpoint(tmp_path, run, fault, code):
    out = tmp_path / "run"
    found, _, err = run(TRAINING + fault + GO, out)
    assert found == code, err
    assert "Traceback" not in err
    with zipfile.ZipFile(out / "checkpoint.zip") as checkpoint:  # the first one, whole
        assert checkpoint.testzip() is None
        assert json.loads(checkpoint.read("data"))["num_timesteps"] == 512
    found, _, err = run(TRAINING + GO, out)
    assert found == 0, err
    record = json.loads((out / "run.json").read_text())
    assert (record["steps"], record["finished"]) == (1536, True)
    load_network(out / "model.zip", load_task("visenvs/Rendezvous-v0"))
    assert read_card(out / "model.zip")["steps"] in (512, 1024, 1536)
