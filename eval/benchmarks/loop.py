"""The bare lane loop, resets included, against the Gymnasium faces that stand on it."""

from __future__ import annotations

import numpy as np

from visenvs.core.lanes import Lanes
from visenvs.core.registry import load_task

from . import ENV_ID, SEEDS, Budget, Portion, Row, faces, race, row

GROUP = "loop"
WANTS = "at least 300,000 lane-steps per CPU second with 1 lane, 3,000,000 with 1024"
UNIT = "lane-steps/CPU s"


def rows(budget: Budget) -> list[Row]:
    """One lane against the single face, 1024 lanes against the vector face."""
    out = duel(1, f"{faces.GROUP}/single", faces.single(ENV_ID), budget)
    out += duel(1024, f"{faces.GROUP}/vector/1024", faces.vector(ENV_ID, 1024), budget)
    return out


def duel(lanes: int, face: str, on_face: Portion, budget: Budget) -> list[Row]:
    """The loop with so many lanes and the face with as many."""
    bare = f"{GROUP}/lanes/{lanes}"
    rates = race({bare: loop(lanes), face: on_face}, budget)
    return [row(bare, UNIT, rates, face), row(face, faces.UNIT, rates)]


def loop(count: int) -> Portion:
    """Steps of `count` lanes with random actions drawn beforehand."""
    task = load_task(ENV_ID)
    lanes = Lanes(task, next(iter(task.scenarios.values())), count)
    shape = (faces.STEPS, count, task.action.size)
    actions = list(np.random.default_rng(0).uniform(-1.0, 1.0, shape).astype(np.float32))
    lanes.reset(SEEDS[:count])

    def portion() -> int:
        for action in actions:
            if lanes.step(action):
                lanes.reset(where=lanes.done)
        return faces.STEPS * count

    return portion
