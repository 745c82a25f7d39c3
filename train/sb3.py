"""Train a policy with stable-baselines3 on native lanes: `python -m train.sb3 --help`.

Lanes train on seeds below 90000 and are validated on seeds from 90000; the public evaluation seeds
(100000 and up) are never touched. The same command goes on where an interrupted run stopped.
"""

from __future__ import annotations

import time
from collections.abc import Generator
from contextlib import contextmanager
from typing import Any

import torch

from agents import registry
from visenvs.core.cli import launch
from visenvs.core.config import Config, override, pick
from visenvs.core.files import write_json
from visenvs.core.lanes import Task
from visenvs.core.layout import Choices
from visenvs.core.registry import load_task

from .build import build_lanes, build_model
from .callbacks import Bar, Keeper, checkpoint
from .imitation import imitate
from .options import Options
from .presets import Preset, preset_for
from .record import card, open_run, report
from .tutor import learn_from_truth, teacher_of
from .vec_env import LaneVecEnv


def train(options: Options, preset: Preset | None = None) -> None:
    """Train a policy with stable-baselines3; the same command goes on with an interrupted run."""
    check(options)
    torch.set_num_threads(1)  # two threads are eight times slower on two cores
    task, scenario, config = scene_of(options)
    preset = preset or preset_for(options.env, options.algo, task.frames is not None)
    config = override(config, preset.settings)
    run = open_run(options, task, scenario, config)
    lanes, validation = build_lanes(options, preset, task, config, run["sessions"])
    model = build_model(options, preset, lanes)
    fresh = options.imitate is not None and not model.num_timesteps
    if options.imitate is not None and fresh:
        law = registry.load_law(options.imitate, task, config)
        imitate(model.policy, lanes, law, preset.imitation)
    options.out.mkdir(parents=True, exist_ok=True)
    write_json(options.out / "run.json", run)

    def note(best: dict[str, Any]) -> None:
        run.update(steps=best["steps"], best=best)
        write_json(options.out / "run.json", run)
        write_json(options.out / "card.json", card(options, task, scenario, preset, run))

    every, curve = options.validate_every, run.setdefault("curve", [])
    keeper = Keeper(validation, every, options.out, run["best"], note, fresh, curve)
    with session(options, run, model, keeper) as bar:
        if options.tutor and model.num_timesteps == 0:
            begin_with_tutor(options.tutor, preset, model, lanes, task, config, keeper)
        model.learn(
            max(options.steps - model.num_timesteps, 0),
            callback=[keeper, bar],
            reset_num_timesteps=False,
            tb_log_name="run",
        )
        keeper.keep()
    report(run, options, task)


def scene_of(options: Options) -> tuple[Task, str, Config]:
    """The task as it is trained, the scenario's name, and its settings."""
    task = load_task(options.env)
    scenario = options.scenario or next(iter(task.scenarios))
    config = pick("scenario", scenario, task.scenarios)
    asked = {"estimator": options.estimator, "observation": options.observation}
    config = override(config, {name: value for name, value in asked.items() if value is not None})
    task = task.under(config)
    check_action(options, task)
    return task, scenario, config


@contextmanager
def session(options: Options, run: dict[str, Any], model: Any, keeper: Keeper) -> Generator[Bar]:
    """Show progress; write into run.json how far this session came, however it ends."""
    began, cpu, before = time.time(), time.process_time(), model.num_timesteps
    bar, finished = Bar(), False
    try:
        yield bar
        finished = True
    except KeyboardInterrupt:
        checkpoint(model, options.out)
        raise KeyboardInterrupt(
            f"{model.num_timesteps:,} steps are kept; the same command goes on from there"
        ) from None
    finally:
        bar.close()
        wall, cpu = time.time() - began, time.process_time() - cpu
        run |= {"steps": model.num_timesteps, "best": keeper.best, "finished": finished}
        run["sessions"] += 1
        run["wall_seconds"] += wall
        run["cpu_seconds"] += cpu
        run["frames_per_second"] = (model.num_timesteps - before) / max(wall, 1e-9)
        write_json(options.out / "run.json", run)


def begin_with_tutor(
    rounds: int,
    preset: Preset,
    model: Any,
    lanes: LaneVecEnv,
    task: Task,
    config: Config,
    keeper: Keeper,
) -> None:
    """Learn from the truth, count the steps that this took, and keep the result."""
    teacher = teacher_of(task, config)
    keeper.init_callback(model)
    keeper.keep()  # where the curve begins

    def watch(steps: int) -> None:
        model.num_timesteps = keeper.num_timesteps = steps
        keeper.watch()

    learn_from_truth(model, lanes, teacher, rounds, preset.tutoring, watch)
    keeper.keep()


def check(options: Options) -> None:
    """Refuse numbers that make no sense, before anything is built."""
    if (
        options.steps < 1
        or options.validate_every < 1
        or (options.lanes is not None and options.lanes < 1)
    ):
        raise ValueError(
            f"steps, lanes and validate-every must be at least 1, "
            f"got {options.steps}, {options.lanes}, "
            f"{options.validate_every}"
        )
    if options.seed < 0:
        raise ValueError(f"the seed must not be negative, got {options.seed}")
    if options.residual_scale is not None and options.residual is None:
        raise ValueError(
            f"--residual-scale {options.residual_scale:g} says how far a law is corrected; "
            "write --residual LAW too"
        )


def check_action(options: Options, task: Task) -> None:
    """Refuse an algorithm that cannot make this task's kind of decision."""
    chooses = isinstance(task.action, Choices)
    if chooses != (options.algo == "maskable_ppo"):
        what = "choices, some of which may be forbidden" if chooses else "numbers in [-1, 1]"
        able = "maskable_ppo" if chooses else "ppo"
        raise ValueError(
            f"the actions of {task.id} are {what}: {options.algo} cannot learn them; "
            f"write --algo {able}"
        )
    if chooses and options.residual is not None:
        raise ValueError(f"a choice cannot be corrected: {task.id} takes no --residual")
    if not chooses and options.imitate is not None:
        raise ValueError(f"only choices are imitated: write --residual {options.imitate}")


if __name__ == "__main__":
    launch("train.sb3", Options, train)
