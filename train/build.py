"""The lanes and the model of a training."""

from __future__ import annotations

from typing import Any

from sb3_contrib import MaskablePPO, RecurrentPPO
from stable_baselines3 import PPO, SAC, TD3
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.utils import set_random_seed

from agents import registry
from agents.networks import choice_network, picture_network, set_network
from agents.residual import Reading, Residual, Scale
from visenvs.core.config import Config
from visenvs.core.lanes import Task
from visenvs.core.layout import Choices

from .options import TRAINING_SEEDS, VALIDATION_SEEDS, Options
from .presets import Preset
from .shaping import potential_of
from .vec_env import LaneVecEnv

ALGORITHMS: dict[str, type[BaseAlgorithm]] = {
    "ppo": PPO,
    "sac": SAC,
    "td3": TD3,
    "recurrent_ppo": RecurrentPPO,
    "maskable_ppo": MaskablePPO,
}
POLICIES = {"recurrent_ppo": "MlpLstmPolicy"}


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
