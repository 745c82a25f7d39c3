"""Fly a policy once on every seed and keep what happened, seed by seed."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from agents.policy import Policy, State
from visenvs.core.config import Config
from visenvs.core.lanes import Lanes, Task
from visenvs.core.layout import Row
from visenvs.core.outcome import Outcome

PUBLIC_SEEDS = range(100_000, 101_000)
SHARD = 500  # seeds that fly at once, on every backend


@dataclass(frozen=True)
class Rollout:
    """One episode for each seed.

    Attributes:
        seeds: shape (n,).
        records: the final lane record of each seed, read by field name; where several fly together,
            that of `together`.
        returns: undiscounted sum of rewards (minus the cost, SI), shape (n,).
            Of a team, the mean over its agents.
        steps: episode lengths, shape (n,).
        decision_seconds: CPU time inside `predict`, summed; the first call of every batch is left
            out, since it may compile.
        decisions: how many rows were decided in that time.
    """

    seeds: NDArray[np.int64]
    records: NDArray[Any]
    returns: NDArray[np.float64]
    steps: NDArray[np.int64]
    decision_seconds: float
    decisions: int


def public_seeds(episodes: int) -> Sequence[int]:
    """The first public evaluation seeds; training never sees them."""
    if not 1 <= episodes <= len(PUBLIC_SEEDS):
        raise ValueError(
            f"--episodes must be from 1 to {len(PUBLIC_SEEDS)}, got {episodes}: "
            f"there are {len(PUBLIC_SEEDS)} public seeds, {PUBLIC_SEEDS[0]} to {PUBLIC_SEEDS[-1]}"
        )
    return PUBLIC_SEEDS[:episodes]


def rollout(
    policy: Policy, task: Task, config: Config, seeds: Sequence[int] = PUBLIC_SEEDS
) -> Rollout:
    """Each seed once: a lane for each seed, none begun twice, so short episodes win no seats."""
    if not len(seeds):
        raise ValueError("a rollout needs at least one seed")
    return join([_fly(policy, task, config, shard) for shard in shards(seeds)])


def shards(seeds: Sequence[int]) -> list[Sequence[int]]:
    """The seeds in the portions in which they fly."""
    return [seeds[i : i + SHARD] for i in range(0, len(seeds), SHARD)]


def join(parts: Sequence[Rollout]) -> Rollout:
    """One rollout of all."""
    return Rollout(
        seeds=np.concatenate([part.seeds for part in parts]),
        records=np.concatenate([part.records for part in parts]),
        returns=np.concatenate([part.returns for part in parts]),
        steps=np.concatenate([part.steps for part in parts]),
        decision_seconds=sum(part.decision_seconds for part in parts),
        decisions=sum(part.decisions for part in parts),
    )


def decide(
    policy: Policy, rows: Row, state: State | None, start: NDArray[np.bool_]
) -> tuple[Row, State | None]:
    """Actions of a policy and its memory; a ValueError says what went wrong inside it."""
    try:
        actions, state = policy.predict(rows, state=state, episode_start=start)
    except Exception as error:
        raise ValueError(f"its predict() failed: {type(error).__name__}: {error}") from error
    return np.asarray(actions, np.float32), state


def _fly(policy: Policy, task: Task, config: Config, seeds: Sequence[int]) -> Rollout:
    lanes = Lanes(task, config, len(seeds) * task.team(config))
    lanes.reset(list(seeds))
    returns = np.zeros(lanes.count)
    start = np.ones(lanes.count, bool)
    state, seconds, decisions, ended = None, 0.0, 0, 0
    while ended < lanes.count:
        began = time.process_time()
        actions, state = decide(policy, lanes.rows, state, start)
        if not start.any():
            seconds += time.process_time() - began
            decisions += lanes.count
        ended = lanes.step(actions)
        returns += lanes.rewards
        start = np.zeros(lanes.count, bool)
    records = together(lanes)
    returns = returns.reshape(-1, lanes.team).mean(axis=1)
    steps = records["step"].astype(np.int64)
    return Rollout(np.asarray(seeds, np.int64), records, returns, steps, seconds, decisions)


def together(lanes: Lanes) -> NDArray[Any]:
    """One final record for each team: the mean of its agents' metrics, the longest episode.

    The outcome is a success if all agents succeeded, else the first other one; a team with an agent
    that diverged has diverged.
    """
    teams = lanes.records.reshape(-1, lanes.team)
    records = teams[:, 0].copy()
    if lanes.team == 1:
        return records
    for name in lanes.task.metrics:
        records[name] = teams[name].mean(axis=1)
    records["step"] = teams["step"].max(axis=1)
    outcomes = teams["outcome"]
    first = (outcomes != Outcome.SUCCESS).argmax(axis=1)
    records["outcome"] = outcomes[np.arange(len(teams)), first]
    records["outcome"][(outcomes == Outcome.DIVERGED).any(axis=1)] = Outcome.DIVERGED
    return records
