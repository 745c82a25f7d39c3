"""What is written of a training: its run.json while it goes on, the card of its best model."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Any

from agents.card import digest, read_card
from visenvs.core.config import Config, to_json
from visenvs.core.files import read_json
from visenvs.core.lanes import Task
from visenvs.core.provenance import provenance

from .build import scale_of
from .options import TRAINING_SEEDS, VALIDATION_SEEDS, Options
from .presets import Preset


def open_run(options: Options, task: Task, scenario: str, config: Config) -> dict[str, Any]:
    """The record of this run: new and not yet written, or of the one in the same folder."""
    path = options.out / "run.json"
    asked = {k: str(v) if isinstance(v, Path) else v for k, v in asdict(options).items()}
    if not path.exists():
        fresh = {
            "steps": 0,
            "sessions": 0,
            "best": None,
            "finished": False,
            "wall_seconds": 0.0,
            "cpu_seconds": 0.0,
        }
        made = provenance("train.sb3")
        return {
            "options": asked,
            "env": task.id,
            "scenario": scenario,
            "config": to_json(config),
            **fresh,
            **made,
        }
    run = read_json(path)
    other = [k for k, v in asked.items() if run["options"].get(k) != v and k != "out"]
    if run["finished"] or other:
        what = f"was started with other {', '.join(other)}" if other else "is finished"
        raise ValueError(
            f"the training in {options.out} {what}; write --out {options.out}-2 for a new one"
        )
    if not has_card(options.out):  # killed between writing the model and its card
        run["best"] = None
    return run


def has_card(out: Path) -> bool:
    """Whether the best model in a folder and its card belong together."""
    try:
        return bool(read_card(out / "model.zip"))
    except (OSError, ValueError):
        return False


def card(
    options: Options, task: Task, scenario: str, preset: Preset, run: dict[str, Any]
) -> dict[str, Any]:
    """What somebody must know of the model: what it flies, how it was made, what it reached."""
    residual: dict[str, Any] | None = None
    if options.residual is not None:
        residual = {"law": options.residual, "scale": scale_of(options, preset)}
        residual |= {"reads": list(preset.reads)} if preset.reads else {}
    best = dict(run["best"])
    return {
        "env": task.id,
        "scenario": scenario,
        "estimator": run["config"].get("estimator"),
        "information": run["config"].get("observation", "belief"),
        "algo": options.algo,
        "residual": residual,
        "policy": preset.policy
        | {name: getattr(preset, name) for name in ("sets", "pictures") if getattr(preset, name)},
        "steps": best.pop("steps"),
        "reached": best,
        "curve": run["curve"],
        "seeds": {
            "training": [0, TRAINING_SEEDS - 1],
            "validation": [VALIDATION_SEEDS[0], VALIDATION_SEEDS[: preset.validation][-1]],
        },
        "sha256": digest(options.out / "model.zip"),
        **{key: run[key] for key in ("command", "versions", "commit", "date")},
    }


def report(run: dict[str, Any], options: Options, task: Task) -> None:
    """Say what the best model reached, and how to compare it."""
    best = run["best"] or {}
    print(
        f"best of {run['steps']:,} steps: mean cost {best['cost_mean']:.4g}, "
        f"success {best['success_rate']:.3f}"
    )
    print(
        f"try it: python -m eval.leaderboard --env {options.env} "
        f"--policies {task.reference},{options.out / 'model.zip'}"
    )
