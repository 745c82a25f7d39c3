"""Train a policy with stable-baselines3 on native lanes: `python -m train.sb3 --help`.

Lanes train on seeds below 90000 and are validated on seeds from 90000; the public evaluation seeds
(100000 and up) are never touched. The same command goes on where an interrupted run stopped.
"""

from __future__ import annotations

import time
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import torch
from sb3_contrib import MaskablePPO, RecurrentPPO
from stable_baselines3 import PPO, SAC, TD3
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.utils import set_random_seed

from agents import registry
from agents.card import digest, read_card
from agents.networks import choice_network, picture_network, set_network
from agents.residual import Reading, Residual, Scale
from visenvs.core.cli import launch
from visenvs.core.config import Config, override, pick, to_json
from visenvs.core.files import read_json, write_json
from visenvs.core.lanes import Task
from visenvs.core.layout import Choices
from visenvs.core.provenance import provenance
from visenvs.core.registry import load_task

from .callbacks import Bar, Keeper, checkpoint
from .imitation import imitate
from .presets import Algo, Preset, preset_for
from .shaping import potential_of
from .tutor import learn_from_truth, teacher_of
from .vec_env import LaneVecEnv

ALGORITHMS: dict[str, type[BaseAlgorithm]] = {
    "ppo": PPO,
    "sac": SAC,
    "td3": TD3,
    "recurrent_ppo": RecurrentPPO,
    "maskable_ppo": MaskablePPO,
}
POLICIES = {"recurrent_ppo": "MlpLstmPolicy"}
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
    """of the network, and of the lanes: lane i flies seed * lanes + i"""
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


def train(options: Options, preset: Preset | None = None) -> None:
    """Train a policy with stable-baselines3; the same command goes on with an interrupted run."""
    check(options)
    torch.set_num_threads(1)  # two threads are eight times slower on two cores
    task = load_task(options.env)
    scenario = options.scenario or next(iter(task.scenarios))
    config = pick("scenario", scenario, task.scenarios)
    asked = {"estimator": options.estimator, "observation": options.observation}
    config = override(config, {name: value for name, value in asked.items() if value is not None})
    task = task.under(config)
    check_action(options, task)
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
    began, cpu, before = time.time(), time.process_time(), model.num_timesteps
    bar, finished = Bar(), False
    try:
        if options.tutor and before == 0:
            begin_with_tutor(options.tutor, preset, model, lanes, task, config, keeper)
            before = model.num_timesteps
        model.learn(
            max(options.steps - before, 0),
            callback=[keeper, bar],
            reset_num_timesteps=False,
            tb_log_name="run",
        )
        keeper.keep()
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
    report(run, options, task)


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


def build_lanes(
    options: Options, preset: Preset, task: Task, config: Config, session: int
) -> tuple[LaneVecEnv, LaneVecEnv]:
    """Training lanes with shaped rewards, and validation lanes with the bare cost."""
    count = options.lanes or max(preset.lanes // task.team(config), 1)
    if count >= TRAINING_SEEDS:
        raise ValueError(f"there are {TRAINING_SEEDS} training seeds, got {count} lanes")
    first = (options.seed + 37 * session) * count % (TRAINING_SEEDS - count)
    residual = None
    if options.residual is not None:
        law = registry.load_law(options.residual, task, config)
        reading = Reading(task, preset.reads) if preset.reads else None
        residual = Residual(law, scale_of(options, preset), reading)
    lanes = LaneVecEnv(
        task,
        config,
        range(first, first + count),
        residual,
        potential_of(task, config),
        preset.reward_floor,
        preset.unit,
    )
    return lanes, LaneVecEnv(task, config, VALIDATION_SEEDS[: preset.validation], residual)


def scale_of(options: Options, preset: Preset) -> Scale:
    """How far a residual may correct, over the longest action."""
    return preset.residual_scale if options.residual_scale is None else options.residual_scale


def build_model(options: Options, preset: Preset, lanes: LaneVecEnv) -> BaseAlgorithm:
    """A new SB3 model, or the checkpoint's with its replay buffer where a run broke off."""
    algorithm = ALGORITHMS[options.algo]
    set_random_seed(options.seed)
    if all((options.out / name).exists() for name in ("run.json", "checkpoint.zip")):
        model = algorithm.load(options.out / "checkpoint.zip", env=lanes, device="cpu")
        if (options.out / "replay.pkl").exists():
            model.load_replay_buffer(options.out / "replay.pkl")  # type: ignore[attr-defined]
        return model
    start = preset.model["learning_rate"]

    def schedule(left: float) -> float:
        return start * max(left, 0.05)

    settings: dict[str, Any] = preset.model | {"learning_rate": schedule}
    task, policy = lanes.task, POLICIES.get(options.algo, "MlpPolicy")
    sets: dict[str, Any] = {}
    if task.frames is not None:
        policy = policy.replace("Mlp", "Cnn")
        sets = picture_network(preset.pictures) if preset.pictures else {}
    elif preset.sets and isinstance(task.action, Choices):
        policy, sets = choice_network(task, preset.sets)
    elif preset.sets:
        sets = set_network(task.observation, preset.sets)
    return algorithm(
        policy,
        lanes,
        policy_kwargs=preset.policy | sets,
        tensorboard_log=str(options.out / "tb"),
        device="cpu",
        **settings,
    )


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


if __name__ == "__main__":
    launch("train.sb3", Options, train)
