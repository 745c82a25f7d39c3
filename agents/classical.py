"""Policies without learning: the guidance laws on an observation row, and two that do not look."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from visenvs.core.lanes import Task
from visenvs.core.layout import Choices
from visenvs.guidance.policy import LawPolicy, lacking

from .policy import Actions, Rows, State

__all__ = ["LawPolicy", "RandomPolicy", "ZeroPolicy", "lacking"]


class ZeroPolicy:
    """No action at all."""

    def __init__(self, task: Task) -> None:
        self._shape: tuple[int, ...] = task.action.space.shape or ()

    def predict(
        self,
        observation: Rows,
        state: State | None = None,
        episode_start: NDArray[np.bool_] | None = None,
        deterministic: bool = True,
    ) -> tuple[Actions, State | None]:
        """Zeros; among choices, the first."""
        return np.zeros((len(observation), *self._shape), np.float32), state


class RandomPolicy:
    """Uniform actions: draws of a generator for each call, whose number is the memory."""

    def __init__(self, task: Task, seed: int = 0) -> None:
        self._task = task
        self._seed = seed

    def predict(
        self,
        observation: Rows,
        state: State | None = None,
        episode_start: NDArray[np.bool_] | None = None,
        deterministic: bool = True,
    ) -> tuple[Actions, State | None]:
        """Independent draws in [-1, 1] or of what may be chosen, `deterministic` or not."""
        action, calls = self._task.action, 0 if state is None else state
        rng = np.random.default_rng([self._seed, calls])
        if isinstance(action, Choices):
            allowed = action.allowed(observation, self._task.observation)
            return (rng.random(allowed.shape) * allowed).argmax(axis=1), calls + 1
        shape = (len(observation), action.size)
        return rng.uniform(-1.0, 1.0, shape).astype(np.float32), calls + 1
