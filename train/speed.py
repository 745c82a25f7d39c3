"""Frames of SB3's PPO per CPU second, on our lanes and on an environment that does nothing.

`python -m train.speed` prints one line of JSON: {"lanes": [...], "noop": [...]}, a figure for each
round. Both sides have the preset of the environment and take turns in one process.
"""

from __future__ import annotations

import json
import time
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import VecEnv

from visenvs.core.cli import launch
from visenvs.core.lanes import Task
from visenvs.core.registry import load_task

from .presets import Preset, preset_for
from .shaping import potential_of
from .vec_env import LaneVecEnv


@dataclass(frozen=True)
class Options:
    """What to measure."""

    env: str = "visenvs/Rendezvous-v0"
    """environment id"""
    rounds: int = 7
    """turns of each side: one rollout and its update"""
    lanes: int | None = None
    """environments side by side; the preset's if left out"""


class NoOpVecEnv(VecEnv):
    """Lanes that never move: a task's spaces, and the same drawn rows and rewards at every step."""

    def __init__(self, task: Task, count: int) -> None:
        self.render_mode = None
        super().__init__(count, task.observation.space, task.action.space)
        rng, box = np.random.default_rng(0), task.observation.space
        shape = (count, task.observation.size)
        self._rows = rng.uniform(box.low, box.high, shape).astype(np.float32)
        self._rewards = rng.uniform(-1.0, 0.0, count).astype(np.float32)
        self._done = np.zeros(count, bool)
        self._infos: list[dict[str, Any]] = [{} for _ in range(count)]

    def reset(self) -> NDArray[np.float32]:
        """The drawn rows."""
        return self._rows

    def step_async(self, actions: NDArray[np.float32]) -> None:
        """Forget the actions."""

    def step_wait(self) -> tuple[Any, NDArray[np.float32], NDArray[np.bool_], list[dict[str, Any]]]:
        """The drawn rows and rewards; no lane ends."""
        return self._rows, self._rewards, self._done, self._infos

    def close(self) -> None:
        """Nothing to release."""

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """An attribute of this object, once for each lane asked for."""
        return [getattr(self, attr_name) for _ in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Lanes that never move have nothing to set."""
        raise AttributeError(f"lanes that never move have no attribute {attr_name!r}")

    def env_method(
        self, method_name: str, *args: Any, indices: Any = None, **kwargs: Any
    ) -> list[Any]:
        """Lanes that never move have no methods."""
        raise AttributeError(f"lanes that never move have no method {method_name!r}")

    def env_is_wrapped(self, wrapper_class: Any, indices: Any = None) -> list[bool]:
        """No lane is wrapped."""
        return [False for _ in self._get_indices(indices)]


def sides(task: Task, preset: Preset) -> dict[str, VecEnv]:
    """The task's first scenario with the rewards that `train.sb3` trains on, and nothing at all."""
    config = next(iter(task.scenarios.values()))
    potential, count = potential_of(task, config), preset.lanes
    lanes = LaneVecEnv(task, config, range(count), None, potential, preset.reward_floor)
    return {"lanes": lanes, "noop": NoOpVecEnv(task, count)}


def measure(task: Task, preset: Preset, rounds: int) -> dict[str, list[float]]:
    """Frames per CPU second of both sides in every round, after one round that is not counted."""
    models = {
        side: PPO(
            "MlpPolicy",
            lanes,
            policy_kwargs=dict(preset.policy),
            seed=0,
            device="cpu",
            **preset.model,
        )
        for side, lanes in sides(task, preset).items()
    }
    rates: dict[str, list[float]] = {side: [] for side in models}
    order = list(models)
    for _ in range(rounds + 1):
        for side in order:
            rates[side].append(learn(models[side]))
        order.reverse()
    return {side: values[1:] for side, values in rates.items()}


def learn(model: PPO) -> float:
    """Frames per CPU second of one rollout and its update."""
    frames = model.n_steps * model.n_envs
    began = time.process_time()
    model.learn(frames, reset_num_timesteps=False)
    return frames / (time.process_time() - began)


def run(options: Options) -> None:
    """Print the frames per CPU second of PPO on our lanes and on lanes that never move."""
    preset = preset_for(options.env, "ppo")
    lanes = preset.lanes if options.lanes is None else options.lanes
    if options.rounds < 1 or lanes < 1:
        raise ValueError(
            f"--rounds and --lanes must be at least 1, got {options.rounds} and {lanes}"
        )
    torch.set_num_threads(1)
    rates = measure(load_task(options.env), replace(preset, lanes=lanes), options.rounds)
    print(json.dumps(rates))


if __name__ == "__main__":
    launch("train.speed", Options, run)
