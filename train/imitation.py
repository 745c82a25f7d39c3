"""A first guess for a network that chooses: imitate a law where the network itself gets to.

Dataset aggregation (Ross, Gordon and Bagnell 2011): first the law flies, then the network does, and
all the while the law says what it would have chosen.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch.nn import functional

from agents.policy import Policy

from .vec_env import LaneVecEnv

ROUNDS = 5  # of gathering and learning; the law flies in the first
PASSES = 2  # over all that was gathered, in every round; the last has twice as many
BATCH = 512
RATE = 1e-3


def imitate(policy: Any, lanes: LaneVecEnv, law: Policy, steps: int) -> float:
    """Fit an SB3 masked policy to a law; returns the share of choices in which it agrees at last.

    Args:
        policy: SB3 policy with `get_distribution` and an optimizer.
        lanes: to gather on.
        law: what to imitate.
        steps: of all lanes together.
    """
    per_round = max(steps // ROUNDS // lanes.num_envs, 1)
    rows: list[NDArray[np.float32]] = []
    masks: list[NDArray[np.bool_]] = []
    wanted: list[NDArray[np.int64]] = []
    agreed = 0.0
    seen = lanes.reset()
    for k in range(ROUNDS):
        same = []
        for _ in range(per_round):
            mask = lanes.lanes.allowed
            choice = law.predict(seen)[0]
            flown = choice if k == 0 else policy.predict(seen, action_masks=mask)[0]
            same.append(np.mean(flown == choice))
            rows.append(seen)
            masks.append(mask)
            wanted.append(choice)
            lanes.step_async(flown)
            seen = lanes.step_wait()[0]
        agreed = float(np.mean(same))
        last = k == ROUNDS - 1
        fit(policy, np.concatenate(rows), np.concatenate(masks), np.concatenate(wanted),
            PASSES * (2 if last else 1), RATE * (0.3 if last else 1.0))  # fmt: skip
        print(f"imitation, round {k + 1} of {ROUNDS}: agrees in {agreed:.3f}", flush=True)
    return agreed


def fit(policy: Any, rows: Any, masks: Any, wanted: Any, passes: int, rate: float) -> None:
    """Passes of cross entropy over all that was gathered."""
    optimizer = torch.optim.Adam(policy.parameters(), lr=rate)
    policy.set_training_mode(True)
    told, choice = torch.from_numpy(rows), torch.from_numpy(wanted)
    for _ in range(passes):
        for part in torch.randperm(len(told)).split(BATCH):
            logits = policy.get_distribution(told[part], masks[part.numpy()]).distribution.logits
            loss = functional.cross_entropy(logits, choice[part])
            optimizer.zero_grad()
            loss.backward()
            optimizer.step()
    policy.set_training_mode(False)
