"""Frames of SB3's PPO on our lanes against the same PPO on an environment that does nothing."""

from __future__ import annotations

import json
import subprocess
import sys
from importlib.util import find_spec

from visenvs.core.provenance import CHECKOUT

from . import Budget, Row, left_out, row

GROUP = "training"
WANTS = "PPO at least 0.85 of the frames that it makes with an environment that does nothing"
UNIT = "frames/CPU s"
PPO, NOOP = "training/ppo", "training/noop"


def rows(budget: Budget) -> list[Row]:
    """The preset of the rendezvous; a turn is one rollout and its update."""
    if find_spec("torch") is None or find_spec("stable_baselines3") is None:
        left_out(PPO, "pip install 'visenvs[train]'")
        return []
    return measured("--rounds", str(budget.rounds))


def measured(*arguments: str) -> list[Row]:
    """What one process of `python -m train.speed`, in which both sides take turns, has found."""
    command = [sys.executable, "-m", "train.speed", *arguments]
    done = subprocess.run(command, cwd=CHECKOUT, capture_output=True, text=True, check=False)
    if done.returncode:
        what = " ".join(["python", *command[1:]])
        raise ValueError(f"`{what}` failed: {done.stderr.strip()[-300:]}")
    measured = json.loads(done.stdout.splitlines()[-1])
    rates = {PPO: measured["lanes"], NOOP: measured["noop"]}
    return [row(PPO, UNIT, rates, NOOP), row(NOOP, UNIT, rates)]
