"""Search for hyperparameters: `python -m train.sweep --help`.

An Optuna study over the preset of an environment and algorithm. Each trial trains several seeds,
since a single one tells little; its value is their mean validation cost. The study lives in a
database, so the same command goes on where it stopped, and several machines may share one.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import optuna
from optuna.trial import Trial, TrialState

from visenvs.core.cli import launch
from visenvs.core.files import check_writable, read_json, write_json
from visenvs.core.parallel import Workers, check, completed
from visenvs.core.provenance import provenance

from . import sb3
from .presets import Algo, Preset, preset_for

SEED = 2008  # of the sampler


@dataclass(frozen=True)
class Options(Workers):
    """What to search, how long, and where to keep it."""

    out: Path = Path("runs/sweep")
    """folder for the trainings, the study and best.json"""
    env: str = "visenvs/Rendezvous-v0"
    """environment id"""
    algo: Algo = "ppo"
    """algorithm"""
    scenario: str | None = None
    """preset of the environment; its default if left out"""
    residual: str | None = None
    """a law that the network corrects; a plain network if left out"""
    trials: int = 30
    """how many sets of hyperparameters in all, those of earlier calls included"""
    seeds: int = 2
    """trainings of each set"""
    steps: int = 500_000
    """environment steps of each training"""
    storage: str | None = None
    """database of the study, as Optuna writes it; SQLite in --out if left out"""


def sweep(options: Options) -> None:
    """Search for hyperparameters; the same command goes on with an interrupted search."""
    check(options)
    if min(options.trials, options.seeds, options.steps) < 1:
        raise ValueError(
            "trials, seeds and steps must be at least 1, "
            f"got {options.trials}, {options.seeds}, {options.steps}"
        )
    options.out.mkdir(parents=True, exist_ok=True)
    check_writable(options.out / "best.json")
    study = open_study(options)
    while (left := options.trials - finished(study)) > 0:
        round_of_trials(study, options, min(left, options.workers or 1))
    best = {"value": study.best_value, "params": study.best_params, "trials": finished(study)}
    write_json(options.out / "best.json", best | provenance("train.sweep"))
    print(f"best of {best['trials']} trials: mean cost {best['value']:.4g}")
    for name, value in study.best_params.items():
        print(f"  {name} = {value:.4g}" if isinstance(value, float) else f"  {name} = {value}")
    print(f"written: {options.out / 'best.json'}")


def open_study(options: Options) -> optuna.Study:
    """The study, new or from its database; trials that a crash cut off have failed."""
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    storage = options.storage or f"sqlite:///{options.out.resolve() / 'study.db'}"
    name = "-".join([options.env.rpartition("/")[2], options.algo, options.residual or "plain"])
    sampler = optuna.samplers.TPESampler(seed=SEED)
    try:
        study = optuna.create_study(
            storage=storage, study_name=name, sampler=sampler, load_if_exists=True
        )
    except Exception as error:  # of whatever database it is
        raise ValueError(f"cannot open the study at {storage}: {error}") from error
    if options.storage is None:  # nobody else works on it
        for trial in study.get_trials(states=(TrialState.RUNNING,)):
            study.tell(trial.number, state=TrialState.FAIL)
    return study


def finished(study: optuna.Study) -> int:
    """How many trials have a value."""
    return len(study.get_trials(deepcopy=False, states=(TrialState.COMPLETE,)))


def round_of_trials(study: optuna.Study, options: Options, count: int) -> None:
    """Train some sets of hyperparameters, each with every seed, and tell the study."""
    trials = [study.ask() for _ in range(count)]
    presets = [suggested(trial, options) for trial in trials]
    calls = [
        (training(options, trial.number, seed), preset)
        for trial, preset in zip(trials, presets, strict=True)
        for seed in range(options.seeds)
    ]
    costs = np.zeros((count, options.seeds))
    try:
        for index, cost in completed(train_once, calls, options):
            costs.flat[index] = cost
    except BaseException:
        for trial in trials:
            study.tell(trial, state=TrialState.FAIL)
        raise
    for trial, cost in zip(trials, costs.mean(axis=1), strict=True):
        study.tell(trial, cost)


def training(options: Options, number: int, seed: int) -> sb3.Options:
    """The options of one training."""
    return sb3.Options(
        out=options.out / f"trial-{number}-seed-{seed}",
        env=options.env,
        algo=options.algo,
        scenario=options.scenario,
        steps=options.steps,
        seed=seed,
        residual=options.residual,
        validate_every=max(1, options.steps // 4),
    )


def train_once(options: sb3.Options, preset: Preset) -> float:
    """Mean validation cost of the best model of one training."""
    sb3.train(options, preset)
    return float(read_json(options.out / "run.json")["best"]["cost_mean"])


def suggested(trial: Trial, options: Options) -> Preset:
    """The preset of this environment and algorithm with a trial's values."""
    preset = preset_for(options.env, options.algo)
    values = dict(space(trial, preset, options.residual is not None))
    width = values.pop("width")
    scale = values.pop("residual_scale", preset.residual_scale)
    spread = {k: values.pop(k) for k in ("log_std_init",) if k in values}
    policy = preset.policy | spread | {"net_arch": [width, width]}
    return replace(preset, model=preset.model | values, policy=policy, residual_scale=scale)


def space(trial: Trial, preset: Preset, residual: bool) -> Iterator[tuple[str, Any]]:
    """Name and value of everything that is searched."""
    yield "learning_rate", trial.suggest_float("learning_rate", 1e-4, 3e-3, log=True)
    yield "width", trial.suggest_categorical("width", [32, 64, 128])
    if "n_steps" in preset.model:
        n_steps = trial.suggest_categorical("n_steps", [50, 100, 200, 400])
        parts = trial.suggest_categorical("minibatches", [8, 16, 32])
        yield "n_steps", n_steps
        yield "batch_size", max(1, preset.lanes * n_steps // parts)
        yield "n_epochs", trial.suggest_int("n_epochs", 3, 10)
        yield "gae_lambda", trial.suggest_float("gae_lambda", 0.9, 1.0)
        yield "ent_coef", trial.suggest_float("ent_coef", 1e-6, 1e-2, log=True)
        if "log_std_init" in preset.policy:
            yield "log_std_init", trial.suggest_float("log_std_init", -3.0, 0.0)
    else:
        yield "batch_size", trial.suggest_categorical("batch_size", [256, 512, 1024, 2048])
        yield "gradient_steps", trial.suggest_categorical("gradient_steps", [1, 2, 4, 8])
    if residual:
        yield "residual_scale", trial.suggest_float("residual_scale", 0.05, 0.6, log=True)


if __name__ == "__main__":
    launch("train.sweep", Options, sweep)
