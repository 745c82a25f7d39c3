"""What to train, and on which seeds."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from .presets import Algo

TRAINING_SEEDS = 90_000
VALIDATION_SEEDS = range(90_000, 91_000)


@dataclass(frozen=True)
class Options:
    """What to train, and where to write it."""

    out: Path
    """folder for model.zip, card.json, run.json, checkpoint.zip and TensorBoard's tb/"""
    env: str = "visenvs/Rendezvous-v0"
    """environment id"""
    algo: Algo = "ppo"
    """algorithm"""
    scenario: str | None = None
    """preset of the environment; its default if left out"""
    estimator: str | None = None
    """the filter in the loop; the scenario's if left out"""
    observation: str | None = None
    """what the policy sees where there is a choice, such as "pixels"; the scenario's if left out"""
    steps: int = 3_000_000
    """environment steps in total"""
    seed: int = 0
    """of the network, and of the lanes: lane i flies seed * lanes % (90000 - lanes) + i; each time
    that a run goes on after a break, seed counts 37 more there"""
    lanes: int | None = None
    """environments side by side, teams where agents fly together; the preset's if left out"""
    residual: str | None = None
    """a law that the network corrects, for example osa; a plain network if left out"""
    residual_scale: float | None = None
    """how far it may correct, over the longest action; the preset's if left out"""
    imitate: str | None = None
    """a law that a network that chooses imitates before it learns (maskable_ppo)"""
    validate_every: int = 250_000
    """steps between validations and checkpoints"""
    tutor: int | None = None
    """rounds of learning what perfect information would command, before PPO starts"""
