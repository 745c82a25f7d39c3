"""Steps of the Gymnasium faces against Gymnasium's own CartPole-v1, resets included."""

from __future__ import annotations

from typing import Any

import gymnasium

import visenvs  # noqa: F401  registers the environments

from . import ENV_ID, SEEDS, Budget, Portion, Row, race, row

GROUP = "faces"
WANTS = (
    "the single face at least as fast as CartPole-v1's, "
    "1024 native lanes at least 0.2 of CartPole-v1's 1024"
)
UNIT = "steps/CPU s"
YARDSTICK = "CartPole-v1"
LANES = (1, 16, 256, 1024)
STEPS = 200  # of one portion: an episode of the rendezvous


def rows(budget: Budget) -> list[Row]:
    """The single face, then the native vector face with more and more lanes."""
    out = duel("single", single(ENV_ID), single(YARDSTICK), budget)
    for lanes in LANES:
        out += duel(f"vector/{lanes}", vector(ENV_ID, lanes), vector(YARDSTICK, lanes), budget)
    return out


def duel(face: str, ours: Portion, theirs: Portion, budget: Budget) -> list[Row]:
    """One face of ours and the same face of CartPole-v1."""
    here, there = f"{GROUP}/{face}", f"{GROUP}/cartpole/{face}"
    rates = race({here: ours, there: theirs}, budget)
    return [row(here, UNIT, rates, there), row(there, UNIT, rates)]


def single(env_id: str, **settings: Any) -> Portion:
    """Steps of one environment with random actions drawn beforehand."""
    env = gymnasium.make(env_id, **settings)
    env.action_space.seed(0)
    actions = [env.action_space.sample() for _ in range(STEPS)]
    env.reset(seed=SEEDS[0])

    def portion() -> int:
        for action in actions:
            _, _, terminated, truncated, _ = env.step(action)
            if terminated or truncated:
                env.reset()
        return STEPS

    return portion


def vector(env_id: str, lanes: int, **settings: Any) -> Portion:
    """Steps of a native vector environment, which resets by itself; counted lane by lane."""
    envs = gymnasium.make_vec(env_id, lanes, vectorization_mode="vector_entry_point", **settings)
    envs.action_space.seed(0)
    actions = [envs.action_space.sample() for _ in range(STEPS)]
    envs.reset(seed=SEEDS[0])

    def portion() -> int:
        for action in actions:
            envs.step(action)
        return STEPS * lanes

    return portion
