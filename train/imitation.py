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
from tqdm import tqdm

from agents.policy import Policy

from .vec_env import LaneVecEnv

ROUNDS = 4  # of gathering and learning; the law flies in the first
PASSES = 12  # over all that was gathered, in every round; the last has twice as many
BATCH = 1024
RATE = 3e-3  # the largest: it rises for a third of a round and falls to nothing at its end
LONGEST = 1.0  # norm of a gradient


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
        for _ in tqdm(range(per_round), f"imitation, round {k + 1} of {ROUNDS}", leave=False):
            mask = lanes.lanes.allowed
            choice = law.predict(seen)[0]
            own = policy.predict(seen, action_masks=mask, deterministic=True)[0]
            same.append(np.mean(own == choice))
            rows.append(seen)
            masks.append(mask)
            wanted.append(choice)
            lanes.step_async(own if k else choice)
            seen = lanes.step_wait()[0]
        agreed = float(np.mean(same))
        passes = PASSES * (2 if k == ROUNDS - 1 else 1)
        fit(policy, np.concatenate(rows), np.concatenate(masks), np.concatenate(wanted), passes)
        print(f"imitation, round {k + 1} of {ROUNDS}: agreed in {agreed:.3f}", flush=True)
    return agreed


def fit(policy: Any, rows: Any, masks: Any, wanted: Any, passes: int) -> None:
    """Passes of cross entropy over all that was gathered; a rate of one cycle (Smith 2018)."""
    told, choice = torch.from_numpy(rows), torch.from_numpy(wanted)
    batches = -(-len(told) // BATCH) * passes
    optimizer = torch.optim.Adam(policy.parameters(), lr=RATE)
    rates = torch.optim.lr_scheduler.OneCycleLR(optimizer, RATE, total_steps=batches)
    policy.set_training_mode(True)
    for _ in range(passes):
        for part in torch.randperm(len(told)).split(BATCH):
            logits = policy.get_distribution(told[part], masks[part.numpy()]).distribution.logits
            loss = functional.cross_entropy(logits, choice[part])
            optimizer.zero_grad()
            loss.backward()
            torch.nn.utils.clip_grad_norm_(policy.parameters(), LONGEST)
            optimizer.step()
            rates.step()
    policy.set_training_mode(False)
