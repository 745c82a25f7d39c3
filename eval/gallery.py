"""The moving pictures of the documents: `python -m eval.gallery` flies them and writes them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from importlib import import_module
from pathlib import Path

from rich.console import Console

from agents import registry
from visenvs.core.cli import launch
from visenvs.core.config import pick
from visenvs.core.files import check_writable, replacing
from visenvs.core.registry import load_task

from .film import FILM
from .rollout import decide

PROGRAM = "eval.gallery"
DOCS = Path(__file__).resolve().parents[1] / "docs"


@dataclass(frozen=True)
class Flight:
    """What a picture shows: one episode of a policy."""

    env: str
    policy: str
    seed: int
    scenario: str | None = None


FLIGHTS = {
    "rendezvous": Flight("visenvs/Rendezvous-v0", "osa", 100_003),
    "tracking2d": Flight("visenvs/Tracking2D-v0", "nsa", 100_003),
    "bearings-only": Flight("visenvs/BearingsOnly-v0", "ppo", 100_004),
    "avoidance": Flight("visenvs/Avoidance-v0", "dgg", 100_009),
    "pixels": Flight("visenvs/Avoidance-v0", "ppo-pixels", 100_009),
    "formation": Flight("visenvs/Formation-v0", "follow-ff", 100_001),
    "team": Flight("visenvs/Formation-v0", "follow-ff", 100_001, "team"),
    "mapping": Flight("visenvs/Mapping-v0", "information-gain", 100_003),
    "herding": Flight("visenvs/Herding-v0", "index-look", 100_004),
}


@dataclass(frozen=True)
class Options:
    """Which pictures to make, and where."""

    out: Path = DOCS
    """folder for NAME.webp"""
    names: tuple[str, ...] = tuple(FLIGHTS)
    """which ones; all if not given"""


def run(options: Options) -> None:
    """Fly one episode of each environment and write it as a small moving picture."""
    film = import_module(FILM)
    for name in options.names:
        pick("picture", name, FLIGHTS)
        check_writable(options.out / f"{name}.webp")
    for name in options.names:
        flight = FLIGHTS[name]
        task = load_task(flight.env)
        scenario = flight.scenario or next(iter(task.scenarios))
        config = pick("scenario", scenario, task.scenarios)
        entry = registry.load(flight.policy, task, config)
        records = film.fly(partial(decide, entry.policy), task, entry.config, flight.seed)
        target = options.out / f"{name}.webp"
        with replacing(target) as temporary:
            temporary.write_bytes(film.clip(records, task, entry.config))
        Console().print(f"written: {target}", soft_wrap=True, highlight=False)


if __name__ == "__main__":
    launch(PROGRAM, Options, run)
