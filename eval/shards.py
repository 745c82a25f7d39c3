"""The unit of a long evaluation: one policy on some of the seeds.

A shard is flown in the same way wherever it runs, so that results do not depend on the backend.
What is finished is kept at once, and an evaluation that is broken off goes on from there.
"""

from __future__ import annotations

import hashlib
import json
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np

from agents import registry
from agents.card import digest
from agents.policy import Policy
from visenvs.core.config import Config, to_json
from visenvs.core.files import replacing
from visenvs.core.provenance import CHECKOUT, versions
from visenvs.core.registry import load_task

from .rollout import Rollout, rollout

SOURCES = ("visenvs", "agents", "eval")
FIELDS = ("seeds", "records", "returns", "steps", "decision_seconds", "decisions")


@dataclass(frozen=True)
class Flight:
    """Who flies what, in words that another process understands.

    Attributes:
        env: Gymnasium id.
        config: of the environment.
        policy: as typed on the command line.
        trust: whether code in a model file may run.
    """

    env: str
    config: Config
    policy: str
    trust: bool


@cache
def pilot(flight: Flight) -> Policy:
    """The policy of a flight, loaded once in each process."""
    task = load_task(flight.env)
    return registry.load(flight.policy, task, flight.config, trust=flight.trust).policy


def fly_shard(flight: Flight, seeds: Sequence[int]) -> Rollout:
    """Fly one shard; a ValueError names the policy and the environment."""
    policy = pilot(flight)
    if torch := sys.modules.get("torch"):
        torch.set_num_threads(1)  # threads that wait for so little work would count as its time
    try:
        return rollout(policy, load_task(flight.env), flight.config, seeds)
    except ValueError as error:
        raise ValueError(f"policy {flight.policy!r} on {flight.env}: {error}") from error


class Store:
    """Finished shards of evaluations that are not finished yet.

    A shard is known by everything that decides its result: environment, configuration, policy,
    seeds, the sources of this checkout, and the versions of what it stands on.

    Args:
        folder: where they are kept.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def path(self, flight: Flight, seeds: Sequence[int]) -> Path:
        """Where the shard of these seeds is kept."""
        told = {
            "env": flight.env,
            "config": to_json(flight.config),
            "policy": [flight.policy, _content(flight.policy)],
            "seeds": [int(seeds[0]), int(seeds[-1]), len(seeds)],
            "sources": sources(),
            "versions": versions(),
        }
        key = hashlib.sha256(json.dumps(told, sort_keys=True).encode()).hexdigest()
        return self._folder / f"{key[:32]}.npz"

    def save(self, path: Path, flown: Rollout) -> None:
        """Keep a finished shard, whole or not at all."""
        path.parent.mkdir(parents=True, exist_ok=True)
        with replacing(path) as temporary:
            np.savez(temporary, **{name: getattr(flown, name) for name in FIELDS})

    def load(self, path: Path) -> Rollout | None:
        """A kept shard; None where there is none, or the file is broken."""
        try:
            with path.open("rb") as file, np.load(file, allow_pickle=False) as kept:
                found: dict[str, Any] = {name: kept[name] for name in FIELDS}
        except (OSError, ValueError, KeyError, EOFError, BadZipFile):
            return None
        seconds, decisions = float(found.pop("decision_seconds")), int(found.pop("decisions"))
        return Rollout(**found, decision_seconds=seconds, decisions=decisions)


@cache
def sources() -> str:
    """sha256 of every Python file that decides what a shard comes to."""
    digest = hashlib.sha256()
    for name in SOURCES:
        for path in sorted((CHECKOUT / name).rglob("*.py")):
            digest.update(path.relative_to(CHECKOUT).as_posix().encode() + path.read_bytes())
    return digest.hexdigest()


def _content(policy: str) -> str:
    """sha256 of what a policy is loaded from, its card too, where it is a file."""
    path = Path(policy)
    path = path / "model.zip" if path.is_dir() else path
    if not path.is_file():
        return ""
    read = path, path.with_name("card.json")
    return " ".join(digest(file) for file in read if file.is_file())
