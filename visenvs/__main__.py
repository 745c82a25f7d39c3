"""`python -m visenvs`: what there is, a flight to look at, and whether the installation works."""

from __future__ import annotations

import argparse
from importlib import import_module
from pathlib import Path
from typing import get_args

from visenvs.core.cli import finish
from visenvs.core.config import Config, field_types, nearest, pick
from visenvs.core.files import check_writable
from visenvs.core.lanes import Task
from visenvs.core.layout import Layout
from visenvs.core.outcome import Outcome
from visenvs.core.registry import Law, environment_files, find_law, laws, load_task
from visenvs.guidance.policy import LawPolicy, lacking


def main() -> None:
    """Read the command line and do what it says."""
    parser = argparse.ArgumentParser("python -m visenvs", description=__doc__)
    commands = parser.add_subparsers(dest="command", required=True)
    commands.add_parser("list", help="the environments")
    info = commands.add_parser("info", help="one environment: rows, actions, costs, scenarios")
    info.add_argument("id")
    demo = commands.add_parser("demo", help="fly one episode with a guidance law")
    demo.add_argument("id")
    demo.add_argument("--policy", help="a guidance law; the environment's reference if not given")
    demo.add_argument("--scenario", help="a preset; the environment's first if not given")
    demo.add_argument("--seed", type=int, default=0)
    demo.add_argument("--video", type=Path, help="write the flight to this .gif or .mp4")
    commands.add_parser("doctor", help="whether this installation works")
    asked = parser.parse_args()
    run = {"list": listing, "info": describe, "demo": fly, "doctor": diagnose}[asked.command]
    finish(lambda: run(asked))


def listing(_asked: argparse.Namespace) -> None:
    """Print every id with its summary, scenarios and estimators, the defaults first."""
    for env_id in environment_files():
        task = load_task(env_id)
        config = next(iter(task.scenarios.values()))
        estimators = default_first(config)
        print(f"{env_id}\n  {task.summary}\n  scenarios: {', '.join(task.scenarios)}")
        if estimators:
            print(f"  estimators: {', '.join(estimators)}")


def describe(asked: argparse.Namespace) -> None:
    """Print the rows, the actions, the costs, the scenarios and the settings of an environment."""
    task = load_task(full(asked.id))
    print(f"{task.id}: {task.summary}")
    for name, view in (task.views or {"observation": task.observation}).items():
        print(f"\n{name}, {view.size} numbers\n{view.table()}")
    for name, action in {"action": task.action, **task.modes}.items():
        described = action.table() if isinstance(action, Layout) else ", ".join(action.names)
        print(f"\n{name}\n{described}")
    print(f"\ncost terms: {', '.join(name.removeprefix('cost_') for name in task.costs)}")
    print(f"metrics: {', '.join(task.metrics)}")
    for name, preset in task.scenarios.items():
        print(f"\nscenario {name}\n{preset}")


def fly(asked: argparse.Namespace) -> None:
    """Fly one episode with a law, print how it ended, and write a video if asked to."""
    film = import_module("visenvs.render.film")
    task = load_task(full(asked.id))
    scenario = asked.scenario or next(iter(task.scenarios))
    config = pick("scenario", scenario, task.scenarios)
    name = asked.policy or task.reference
    task = task.under(config)
    policy = LawPolicy(law_of(name, task, config), task, config)
    if asked.video is not None:
        film.check_suffix(asked.video)
        check_writable(asked.video)
    records = film.fly(policy.predict, task, config, asked.seed)
    (end,) = records[-1:].ravel()[:1]
    outcome = Outcome(int(end["outcome"])).name.lower()
    print(f"{task.id}, {scenario}, {name}, seed {asked.seed}: {outcome}, {len(records) - 1} steps")
    for metric, unit in task.metrics.items():
        print(f"  {metric} = {end[metric]:.4g} {unit}".rstrip())
    if asked.video is not None:
        film.write(asked.video, records, task, config)
        print(f"written: {asked.video}")


def default_first(config: Config) -> list[str]:
    """The estimators that there are, the scenario's own first; none if there is no choice."""
    known = get_args(field_types(type(config)).get("estimator"))
    return sorted(known, key=lambda name: name != getattr(config, "estimator", ""))


def law_of(name: str, task: Task, config: Config) -> Law:
    """The law of that name; a ValueError lists those that can fly here."""
    law = find_law(name)
    if law is None:
        able = [known for known, law in laws().items() if not lacking(law, task, config)]
        raise ValueError(
            f"unknown law {name!r}{nearest(name, able)} Laws that can fly {task.id}: "
            f"{', '.join(able)}; other policies fly with "
            f"`python -m eval.film --env {task.id} --policy {name} --out flight.gif`"
        )
    return law


def diagnose(_asked: argparse.Namespace) -> None:
    """Print every finding; an error if one of them has to be mended."""
    from visenvs.doctor import examine

    bad: list[str] = []
    for finding in examine():
        print(f"{'ok ' if finding.ok else 'BAD'} {finding.name}: {finding.text}", flush=True)
        bad += [] if finding.ok else [finding.name]
    if bad:
        raise ValueError(f"to be mended: {', '.join(bad)}")


def full(env_id: str) -> str:
    """The id with its namespace."""
    return env_id if "/" in env_id else f"visenvs/{env_id}"


if __name__ == "__main__":
    main()
