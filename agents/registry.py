"""Policies by name, by file, or by `module:factory`."""

from __future__ import annotations

import importlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from visenvs.core.config import Config, nearest, override, pick
from visenvs.core.lanes import Task
from visenvs.core.registry import find_law, laws

from .card import read_card
from .classical import LawPolicy, RandomPolicy, ZeroPolicy, lacking
from .learned import LearnedPolicy
from .loading import load_network
from .policy import NotApplicable, Policy
from .residual import Reading, Residual

PRETRAINED = Path(__file__).resolve().parent / "pretrained"
BLIND = {
    "zero": ("no action at all", ZeroPolicy),
    "random": ("uniform random actions", RandomPolicy),
}


@dataclass(frozen=True)
class Entry:
    """A policy that is ready to fly, and how tables call it.

    Attributes:
        name: label.
        policy: the policy.
        information: what it decides on: "belief" (the filter's estimate and covariance), "raw"
            (measurements), "none".
        kind: "law", "learned", "residual", "blind" or "custom".
        summary: one line.
        config: the configuration that it was loaded for, with the observation that it reads.
    """

    name: str
    policy: Policy
    information: str
    kind: str
    summary: str
    config: Config


def names(task: Task, config: Config | None = None) -> tuple[str, ...]:
    """The policies that the leaderboard shows by default: those that can fly; default scenario."""
    config = config or next(iter(task.scenarios.values()))
    able = (name for name, law in laws().items() if not lacking(law, task, config))
    return (*BLIND, *able, *shipped(task.id))


def shipped(env_id: str) -> dict[str, Path]:
    """Name -> model file of the learned policies that come with an environment."""
    folder = PRETRAINED / env_id.rpartition("/")[2]
    return {path.parent.name: path for path in sorted(folder.glob("*/model.zip"))}


def load(spec: str, task: Task, config: Config, trust: bool = False) -> Entry:
    """The policy that a specification names.

    Args:
        spec: a name (`names`), the path of an SB3 zip or of a folder with model.zip, or
            `module:factory`, where `factory(task, config)` returns a policy.
        task, config: what it is to fly.
        trust: let a model file run the code that is pickled in it.

    Raises:
        NotApplicable: the policy cannot fly this environment.
        ValueError: there is no such policy, or the file is not one.
    """
    task = task.under(config)
    if spec in BLIND:
        summary, make = BLIND[spec]
        return Entry(spec, make(task), "none", "blind", summary, config)
    law = find_law(spec)
    if law is not None:
        return Entry(spec, LawPolicy(law, task, config), "belief", "law", law.summary, config)
    if spec in shipped(task.id):
        return _load_model(spec, shipped(task.id)[spec], task, config, trust)
    path = Path(spec)
    if path.suffix == ".zip" or path.is_dir():
        model = path / "model.zip" if path.is_dir() else path
        name = model.parent.name if model.name == "model.zip" else model.stem
        return _load_model(name or spec, model, task, config, trust)
    if ":" in spec:
        policy = _made(spec, task, config)
        return Entry(spec, policy, _information(config), "custom", "user's own", config)
    known = names(task, config)
    raise ValueError(
        f"unknown policy {spec!r}{nearest(spec, known)} Known: {', '.join(known)}; "
        "or the path of an SB3 .zip, or module:factory"
    )


def load_law(name: str, task: Task, config: Config) -> LawPolicy:
    """The guidance law of that name as a policy; nothing else goes under a learned correction."""
    return LawPolicy(find_law(name) or pick("law", name, laws()), task, config)


def _load_model(name: str, model: Path, task: Task, config: Config, trust: bool) -> Entry:
    if not model.exists():
        raise ValueError(f"no model {model}; expected what `python -m train.sb3 --out DIR` writes")
    card = read_card(model)
    if card and card["information"] != _information(config):
        config = override(config, {"observation": card["information"]})
        task = task.under(config)
    residual, kind, known = None, "learned", task
    if card.get("residual"):
        told, size = card["residual"], task.action.size
        if np.size(told["scale"]) not in (1, size):
            raise ValueError(
                f"{model.with_name('card.json')}: the scale of a residual on {task.id} "
                f"is one number or {size}, got {told['scale']!r}"
            )
        reading = Reading(task, told["reads"]) if "reads" in told else None
        residual = Residual(load_law(told["law"], task, config), told["scale"], reading)
        kind, known = "residual", task if reading is None else reading.task
    policy = LearnedPolicy(load_network(model, known, trust), task, residual)
    return Entry(name, policy, _information(config), kind, _summary(card), config)


def _information(config: Config) -> str:
    return getattr(config, "observation", "belief")


def _summary(card: dict[str, Any]) -> str:
    if not card:
        return "user's own network"
    on = f", residual on {card['residual']['law']}" if card.get("residual") else ""
    return f"{card['algo']}{on}, {card['steps']:,} steps"


def _made(spec: str, task: Task, config: Config) -> Policy:
    module, _, name = spec.rpartition(":")
    try:
        factory = getattr(importlib.import_module(module), name)
    except Exception as error:  # the module runs when it is imported
        raise ValueError(
            f"cannot import {spec!r} ({type(error).__name__}: {error}); "
            "write module:factory, factory(task, config)"
        ) from None
    try:
        return factory(task, config)
    except NotApplicable:
        raise
    except Exception as error:
        raise ValueError(
            f"policy {spec!r} cannot be made: {type(error).__name__}: {error}"
        ) from error
