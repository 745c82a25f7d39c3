"""Search for the gains of a linear residual on a law: `python -m train.search --help`.

The correction is a sum of the vectors that the network reads, each times a gain: no direction is
preferred, and a handful of numbers is all that there is to learn. Every episode flies gains of its
own, drawn about the best guess (Sehnke et al. 2010, "Parameter-exploring policy gradients"); a
quadratic is fitted to what all of them cost, and its least point within reach is the next guess
(response surfaces, Box and Wilson 1951). Seeds are those of `train.sb3`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from stable_baselines3 import PPO

from agents import registry
from agents.card import digest
from agents.residual import Reading, Residual
from visenvs.core.cli import launch
from visenvs.core.config import pick
from visenvs.core.files import replacing, write_json
from visenvs.core.lanes import Task
from visenvs.core.layout import Layout
from visenvs.core.provenance import provenance
from visenvs.core.registry import load_task

from .callbacks import validate
from .options import TRAINING_SEEDS, VALIDATION_SEEDS
from .presets import Preset, preset_for
from .vec_env import LaneVecEnv

Values = NDArray[np.float64]
SPREAD = 0.5  # deviation of the gains in the first round, over the residual's scale
NARROWER = 0.75  # from one round to the next
REACH = 1.5  # deviations by which the guess moves at most in a round
LANES = 200  # side by side
LINEAR: dict[str, Any] = {"net_arch": []}


@dataclass(frozen=True)
class Options:
    """What to train, and where to write it."""

    out: Path
    """folder for model.zip and card.json"""
    env: str = "visenvs/Mapping-v0"
    """environment id"""
    scenario: str | None = None
    """preset of the environment; its default if left out"""
    residual: str = "information-gain"
    """the law that is corrected"""
    rounds: int = 5
    """of flying and fitting"""
    episodes: int = 2000
    """in a round, each with gains of its own"""
    seed: int = 0
    """of the gains, and the first of the episodes"""


def train(options: Options) -> None:
    """Search for the gains of a linear residual on a law, validate it, and write it."""
    torch.set_num_threads(1)
    seeds = training_seeds(options)
    task, preset = load_task(options.env), preset_for(options.env, "ppo")
    scenario = options.scenario or next(iter(task.scenarios))
    config = pick("scenario", scenario, task.scenarios)
    if not preset.reads:
        raise ValueError(f"the preset of {task.id} for ppo does not say what a residual reads")
    law = registry.load_law(options.residual, task, config)
    residual = Residual(law, preset.residual_scale, Reading(task.under(config), preset.reads))
    lanes = LaneVecEnv(task, config, VALIDATION_SEEDS[: preset.validation], residual)
    pattern, steps = tied(lanes.task), 0

    def cost(gains: Values, some: range) -> Values:
        nonlocal steps
        flown = LaneVecEnv(task, config, some, residual)
        costs, taken = fly(flown, np.tensordot(gains, pattern, 1))
        steps += taken
        return costs

    gains = descend(cost, len(pattern), seeds, options.rounds)
    model = linear_model(lanes, np.tensordot(gains, pattern, 1))
    reached = validate(model, lanes)
    found = {"steps": steps, "reached": reached, "gains": gains.tolist()}
    options.out.mkdir(parents=True, exist_ok=True)
    with replacing(options.out / "model.zip") as path:
        model.save(path)
    flies = {
        "env": task.id,
        "scenario": scenario,
        "estimator": getattr(config, "estimator", None),
        "information": getattr(config, "observation", "belief"),
    }
    write_json(options.out / "card.json", flies | card(options, preset, found, seeds))
    print(
        f"mean cost {reached['cost_mean']:.4g}\n"
        f"try it: python -m eval.leaderboard --env {options.env} "
        f"--policies {task.reference},{options.out / 'model.zip'}"
    )


def training_seeds(options: Options) -> range:
    """The seeds of all rounds, or a ValueError."""
    total = options.rounds * options.episodes
    if min(options.rounds, options.episodes) < 1 or not 0 <= options.seed <= TRAINING_SEEDS - total:
        raise ValueError(
            "rounds and episodes must be at least 1, and the seeds up to seed + rounds * episodes "
            f"within 0 to {TRAINING_SEEDS}, "
            f"got {options.rounds}, {options.episodes}, {options.seed}"
        )
    return range(options.seed, options.seed + total)


def card(options: Options, preset: Preset, found: dict[str, Any], seeds: range) -> dict[str, Any]:
    """How a model was made and what it reached; beside what it flies."""
    return {
        "algo": "search",
        "residual": {
            "law": options.residual,
            "scale": preset.residual_scale,
            "reads": list(preset.reads),
        },
        "policy": LINEAR,
        **found,
        "seeds": {
            "training": [seeds[0], seeds[-1]],
            "validation": [VALIDATION_SEEDS[0], VALIDATION_SEEDS[: preset.validation][-1]],
        },
        "sha256": digest(options.out / "model.zip"),
        **provenance("train.search"),
    }


def tied(task: Task) -> Values:
    """The matrix that each gain multiplies, (gains, action size, row size).

    One for each field of the action and each that is read: axis k of the one goes to axis k of the
    other. What is read is a number in the row, as the action is.
    """
    assert isinstance(task.action, Layout)
    inputs, outputs = task.observation, task.action
    out: list[Values] = []
    for wanted in outputs.fields:
        for told in inputs.fields:
            both = min(wanted.size, told.size)
            matrix = np.zeros((outputs.size, inputs.size))
            matrix[outputs.columns([wanted.name])[:both], inputs.columns([told.name])[:both]] = 1.0
            out.append(matrix)
    return np.array(out)


def fly(lanes: LaneVecEnv, matrices: Values) -> tuple[Values, int]:
    """What every lane's first episode costs under its own linear correction, and all their steps.

    Args:
        matrices: one for each lane, (lanes, action size, row size).
    """
    rows, cost, steps = lanes.reset(), np.full(lanes.num_envs, np.nan), 0
    while np.isnan(cost).any():
        wanted = np.einsum("nij,nj->ni", matrices, rows)
        lanes.step_async(np.clip(wanted, -1.0, 1.0).astype(np.float32))
        rows, _, done, infos = lanes.step_wait()
        for i in np.flatnonzero(done & np.isnan(cost)):
            cost[i] = -infos[i]["episode"]["r"]
            steps += infos[i]["episode"]["l"]
    return cost, steps


def descend(
    cost: Callable[[Values, range], Values], size: int, seeds: range, rounds: int
) -> Values:
    """The gains that cost least by a quadratic through all that was flown, (size,).

    Args:
        cost: (gains (n, size), n seeds) -> costs (n,).
        size: how many gains.
        seeds: one for each episode, in equal rounds; the first also seeds the draws.
        rounds: of flying and fitting.
    """
    rng, guess, spread = np.random.default_rng(seeds[0]), np.zeros(size), SPREAD
    flown, paid = np.zeros((0, size)), np.zeros(0)
    each = len(seeds) // rounds
    for k in range(rounds):
        tried = guess + spread * rng.standard_normal((each, size))
        for i in range(0, each, LANES):
            some = seeds[k * each + i : k * each + min(i + LANES, each)]
            paid = np.append(paid, cost(tried[i : i + LANES], some))
        flown = np.concatenate([flown, tried])
        guess, expected = least(flown, paid, guess, spread)
        print(
            f"round {k + 1} of {rounds}: cost {paid[-each:].mean():.4f} +- "
            f"{paid[-each:].std() / each**0.5:.4f}, expected at "
            f"{np.round(guess, 3).tolist()}: {expected:.4f}",
            flush=True,
        )
        spread *= NARROWER
    return guess


def least(flown: Values, paid: Values, guess: Values, spread: float) -> tuple[Values, float]:
    """Where a quadratic through costs is least, within reach of a guess, and what it is there.

    Episodes count less the farther they are from the guess: by exp(-|z|^2 / 2 size), z deviations.
    """
    z = (flown - guess) / spread
    size = z.shape[1]
    i, j = np.triu_indices(size)
    weight = np.exp(-0.25 * np.sum(z * z, axis=1) / size)  # its square is the weight
    columns = np.hstack([np.ones((len(z), 1)), z, z[:, i] * z[:, j]])
    fit = np.linalg.lstsq(columns * weight[:, None], paid * weight, rcond=None)[0]
    slope, bend = fit[1 : size + 1], np.zeros((size, size))
    bend[i, j] += fit[size + 1 :]
    bend = bend + bend.T
    step = downhill(slope, bend)
    return guess + spread * step, float(fit[0] + slope @ step + 0.5 * step @ bend @ step)


def downhill(slope: Values, bend: Values) -> Values:
    """The least point of slope' x + x' bend x / 2 with |x| <= REACH, (n,).

    It is -(bend + damping I)^-1 slope, with no damping or with what makes it as long as the reach.
    """
    values, axes = np.linalg.eigh(bend)
    along = axes.T @ slope

    def length(damping: float) -> float:
        return float(np.linalg.norm(along / (values + damping)))

    low = max(0.0, 1e-9 - float(values.min()))
    high = low + float(np.linalg.norm(along)) / REACH + 1e-9
    if low == 0.0 and length(low) <= REACH:
        return axes @ (-along / values)
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if length(middle) > REACH else (low, middle)
    return axes @ (-along / (values + high))


def linear_model(lanes: LaneVecEnv, matrix: Values) -> Any:
    """An SB3 model whose mean action is a matrix (action size, row size) times the row."""
    model = PPO("MlpPolicy", lanes, policy_kwargs=LINEAR, device="cpu", seed=0)
    mean: Any = model.policy.action_net
    with torch.no_grad():
        mean.weight[:] = torch.from_numpy(matrix)
        mean.bias[:] = 0.0
    return model


if __name__ == "__main__":
    launch("train.search", Options, train)
