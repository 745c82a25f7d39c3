"""Flights of a policy as an offline dataset: `python -m train.minari_export --help`.

The dataset is one of Minari's (https://minari.farama.org): `minari.load_dataset(ID)` reads it. Each
episode is flown on a training seed of its own, below 90000, so that evaluation seeds stay unseen.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from importlib import import_module
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from agents import registry
from agents.policy import Policy
from visenvs.core.cli import launch
from visenvs.core.config import Config, pick
from visenvs.core.lanes import Lanes, Task
from visenvs.core.outcome import RUNNING
from visenvs.core.provenance import provenance
from visenvs.core.registry import load_task

from .options import TRAINING_SEEDS

AT_ONCE = 100  # episodes that fly side by side
INSTALL = 'Minari is missing: write `pip install "visenvs[offline]"`'


@dataclass(frozen=True)
class Options:
    """What to fly, and what to call it."""

    dataset: str
    """Minari's name, such as visenvs/rendezvous/osa-v0; it goes to MINARI_DATASETS_PATH"""
    env: str = "visenvs/Rendezvous-v0"
    """environment id"""
    policy: str = "osa"
    """name, model file or module:factory"""
    scenario: str | None = None
    """preset of the environment; its default if left out"""
    episodes: int = 500
    """how many, on the training seeds from 0"""
    trust: bool = False
    """run code that comes with a model file; only for files that you made yourself"""


def run(options: Options) -> None:
    """Fly a policy and keep what it saw and did as a Minari dataset."""
    minari = library()
    if not 1 <= options.episodes <= TRAINING_SEEDS:
        raise ValueError(
            f"--episodes must be from 1 to {TRAINING_SEEDS}, got {options.episodes}: "
            "there are so many training seeds"
        )
    if options.dataset in minari.list_local_datasets():
        raise ValueError(
            f"there is a dataset {options.dataset} already; write "
            f"`minari delete {options.dataset}`, or another name"
        )
    task = load_task(options.env)
    scenario = options.scenario or next(iter(task.scenarios))
    config = pick("scenario", scenario, task.scenarios)
    entry = registry.load(options.policy, task, config, options.trust)
    config, task = entry.config, task.under(entry.config)
    if task.team(config) > 1:
        raise ValueError(f"{scenario} of {task.id} flies a team; Minari keeps single agents")
    buffers: list[Any] = []
    for first in range(0, options.episodes, AT_ONCE):
        seeds = range(first, min(first + AT_ONCE, options.episodes))
        buffers += fly(entry.policy, task, config, seeds)
    settings: dict[str, Any] = {"scenario": scenario}
    if hasattr(config, "observation"):
        settings["observation"] = vars(config)["observation"]
    spec, made = gym.make(options.env, **settings).spec, provenance("train.minari_export")
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", ".*author_email.*", UserWarning)  # there is none
        dataset = minari.create_dataset_from_buffers(
            options.dataset,
            buffers,
            env=spec,
            eval_env=spec,
            observation_space=task.space,
            action_space=task.action.space,
            algorithm_name=entry.name,
            author="visenvs contributors",
            code_permalink=f"visenvs {made['versions']['visenvs']}, commit {made['commit']}",
            description=f"{options.env}, {scenario}: {entry.summary}",
            data_format="hdf5",
            requirements=["visenvs"],
            jpeg_encoding=False,
        )
    print(f"{dataset.total_episodes} episodes, {dataset.total_steps:,} steps: {options.dataset}")
    print(f"learn from it: python -m train.clone --dataset {options.dataset} --out runs/clone")


def library() -> Any:
    """Minari, or an ImportError that says what to install."""
    try:
        import_module("h5py")  # it keeps the files
        return import_module("minari")
    except ImportError as error:
        raise ImportError(INSTALL) from error


def fly(policy: Policy, task: Task, config: Config, seeds: Sequence[int]) -> list[Any]:
    """One episode for each seed as Minari's buffers: n actions, rewards and ends, n + 1 rows."""
    lanes = Lanes(task, config, len(seeds))
    lanes.reset(list(seeds))
    rows, actions, rewards, ends = [lanes.rows.copy()], [], [], []
    state, start = None, np.ones(lanes.count, bool)
    while (lanes.outcome == RUNNING).any():
        action, state = policy.predict(lanes.rows, state=state, episode_start=start)
        lanes.step(action)
        rows.append(lanes.rows.copy())
        actions.append(np.asarray(action, task.action.space.dtype))
        rewards.append(lanes.rewards.copy())
        ends.append(lanes.truncated.copy())
        start = np.zeros(lanes.count, bool)
    kept = [np.stack(part) for part in (rows, actions, rewards, ends)]
    lengths = lanes.records["step"]
    return [_buffer(i, int(seeds[i]), int(lengths[i]), *kept) for i in range(lanes.count)]


def _buffer(
    i: int,
    seed: int,
    n: int,
    rows: NDArray[Any],
    actions: NDArray[Any],
    rewards: NDArray[np.float64],
    cut: NDArray[np.bool_],
) -> Any:
    buffer = import_module("minari.data_collector").EpisodeBuffer
    truncated = bool(cut[n - 1, i])
    last = np.arange(n) == n - 1
    return buffer(
        seed=seed,
        observations=rows[: n + 1, i],
        actions=actions[:n, i],
        rewards=rewards[:n, i].tolist(),
        terminations=(last & (not truncated)).tolist(),
        truncations=(last & truncated).tolist(),
    )


if __name__ == "__main__":
    launch("train.minari_export", Options, run)
