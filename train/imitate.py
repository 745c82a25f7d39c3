"""A start for PPO: imitate what perfect information would command (DAgger).

The network flies; along its own way it learns, by least squares, the optimal command of somebody
who knows the truth. Given a row, the best guess of that command is the optimal one for a quadratic
cost and linear motion (certainty equivalence), so that what is left for PPO is the rest.
Ross, Gordon and Bagnell 2011, "A reduction of imitation learning to no-regret online learning".
"""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from stable_baselines3 import PPO

from .shaping import Teacher
from .vec_env import LaneVecEnv

BATCH, RATE = 2048, 1e-3
KEPT = 6  # rounds whose rows are kept


def imitate(model: PPO, lanes: LaneVecEnv, teacher: Teacher, rounds: int, steps: int) -> int:
    """Train the policy's mean in place; returns how many environment steps that took.

    Args:
        model: with a network for continuous actions.
        lanes: where it flies; each round goes on where the last one stopped.
        teacher: wanted actions over the longest one from lane records.
        rounds: how often the network flies and learns.
        steps: of every lane in a round.
    """
    policy: Any = model.policy
    optimiser = torch.optim.Adam(policy.parameters(), lr=RATE)
    row: Any = lanes.reset()
    kept: list[tuple[Any, Any]] = []
    for left in range(rounds, 0, -1):
        rows: list[Any] = []
        wanted: list[Any] = []
        for _ in range(steps):
            rows.append(row)
            wanted.append(lanes.correction(teacher(lanes.lanes.records)))
            actions, _ = model.predict(row, deterministic=True)
            row, _, _, _ = lanes.step(actions)
        kept = [*kept[-KEPT + 1 :], (np.concatenate(rows), np.concatenate(wanted))]
        for group in optimiser.param_groups:
            group["lr"] = RATE * left / rounds
        fit(policy, optimiser, *(np.concatenate(part) for part in zip(*kept, strict=True)))
    return rounds * steps * lanes.num_envs


def fit(policy: Any, optimiser: torch.optim.Optimizer, rows: Any, wanted: Any) -> None:
    """One pass over rows (n, k) and wanted means (n, size) in random order."""
    order = torch.randperm(len(rows))
    inputs, targets = torch.as_tensor(rows), torch.as_tensor(wanted)
    for start in range(0, len(order), BATCH):
        some = order[start : start + BATCH]
        mean = policy.get_distribution(inputs[some]).distribution.mean
        loss = torch.nn.functional.mse_loss(mean, targets[some])
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
