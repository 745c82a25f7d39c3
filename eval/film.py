"""Film: `python -m eval.film` flies one seed and writes a video or a picture of it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from importlib import import_module
from pathlib import Path

from rich.console import Console

from agents import registry
from visenvs.core.cli import launch
from visenvs.core.config import override, pick
from visenvs.core.files import check_writable
from visenvs.core.registry import load_task

from .rollout import PUBLIC_SEEDS, decide

PROGRAM = "eval.film"
SPEEDS = 0.01, 1e6  # how many times real time; a GIF holds a picture for 655 s at most
FILM = "visenvs.render.film"  # imported when it is needed


@dataclass(frozen=True)
class Options:
    """What to fly and where to write it."""

    env: str
    """Gymnasium id."""
    policy: str
    """Name, model file or module:factory."""
    out: Path
    """File to write: .gif or .mp4 for the whole episode, .png for one moment of it."""
    scenario: str | None = None
    """Named preset; the environment's first if not given."""
    estimator: str | None = None
    """Estimator in the loop; the scenario's if not given."""
    seed: int = PUBLIC_SEEDS[0]
    """Which episode."""
    speed: float = 1.0
    """How many times faster than real time a video runs, from 0.01 to 1,000,000."""
    at: float | None = None
    """Moment of a .png in seconds from the start; the end if not given."""
    trust: bool = False
    """Run code that comes with a model file. Only for files that you made yourself."""


def run(options: Options) -> None:
    """Fly a policy on one seed and write a video (.gif, .mp4) or a picture (.png) of it."""
    film = import_module(FILM)
    _check(options)
    task = load_task(options.env)
    if not task.picture:
        raise ValueError(f"{task.id} has no pictures to film")
    config = pick("scenario", options.scenario or next(iter(task.scenarios)), task.scenarios)
    if options.estimator is not None:
        config = override(config, {"estimator": options.estimator})
    entry = registry.load(options.policy, task, config, options.trust)
    records = film.fly(partial(decide, entry.policy), task, entry.config, options.seed)
    film.write(options.out, records, task, entry.config, options.speed, options.at)
    Console().print(f"written: {options.out}", soft_wrap=True, highlight=False)


def _check(options: Options) -> None:
    import_module(FILM).check_suffix(options.out)
    if not SPEEDS[0] <= options.speed <= SPEEDS[1]:
        raise ValueError(
            f"--speed must lie in [{SPEEDS[0]:g}, {SPEEDS[1]:g}], got {options.speed:g}"
        )
    if options.at is not None and (options.out.suffix != ".png" or not options.at >= 0):
        raise ValueError(f"--at is the moment of a .png, 0 s or later, got {options.at}")
    check_writable(options.out)


if __name__ == "__main__":
    launch(PROGRAM, Options, run)
