"""Policies without learning: the guidance laws on an observation row, and two that do not look."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from visenvs.core.config import Config, field_types, to_record
from visenvs.core.lanes import Task
from visenvs.core.registry import Law

from .policy import NotApplicable, Rows, State


def lacking(law: Law, task: Task, config: Config) -> list[str]:
    """What a law needs and the environment does not give; empty where it can fly."""
    absent = [name for name in law.needs if name not in task.observation.names]
    absent += [name for name in law.settings if name not in field_types(type(config))]
    if law.limit not in {field.unit for field in task.action.fields}:
        absent.append(f"actions in units of {law.limit}")
    return absent


class LawPolicy:
    """A guidance law as a policy: row to belief to command to action row.

    Built from the environment's public configuration and layouts only.
    """

    def __init__(self, law: Law, task: Task, config: Config) -> None:
        if absent := lacking(law, task, config):
            raise NotApplicable(
                f"{law.name} needs {', '.join(absent)}, which {task.id} does not give"
            )
        self.law = law
        self._task = task
        self._settings = to_record(config)
        self._parts = parts(task, config)
        self._memory = law.memory(self._settings[0], task.action.size) if law.memory else 0

    def predict(
        self,
        observation: Rows,
        state: State | None = None,
        episode_start: NDArray[np.bool_] | None = None,
        deterministic: bool = True,
    ) -> tuple[Rows, State | None]:
        """Commands of the law over the largest ones; longer ones keep their direction."""
        beliefs = self._task.observation.records(observation)
        commands = np.zeros((len(beliefs), self._task.action.size))
        if self._memory:
            if state is None:
                state = np.zeros((len(beliefs), self._memory))
            elif episode_start is not None:
                state[episode_start] = 0.0
            self.law.decide(beliefs, self._settings, state, commands)
        else:
            self.law.decide(beliefs, self._settings, commands)
        for columns, limit in self._parts:
            length = np.linalg.norm(commands[:, columns], axis=1, keepdims=True)
            commands[:, columns] /= np.maximum(length, limit)
        return commands.astype(np.float32), state


def parts(task: Task, config: Config) -> list[tuple[slice, float]]:
    """Columns of every field of the action, and its largest command: the setting of its unit."""
    settings, out, start = to_record(config), [], 0
    for field in task.action.fields:
        limit = float(settings[field.unit][0])
        out.append((slice(start, start + field.size), limit))
        start += field.size
    return out


class ZeroPolicy:
    """No action at all."""

    def __init__(self, task: Task) -> None:
        self._size = task.action.size

    def predict(
        self,
        observation: Rows,
        state: State | None = None,
        episode_start: NDArray[np.bool_] | None = None,
        deterministic: bool = True,
    ) -> tuple[Rows, State | None]:
        """Zeros."""
        return np.zeros((len(observation), self._size), np.float32), state


class RandomPolicy:
    """Uniform actions from a generator of its own, seeded at construction."""

    def __init__(self, task: Task, seed: int = 0) -> None:
        self._size = task.action.size
        self._rng = np.random.default_rng(seed)

    def predict(
        self,
        observation: Rows,
        state: State | None = None,
        episode_start: NDArray[np.bool_] | None = None,
        deterministic: bool = True,
    ) -> tuple[Rows, State | None]:
        """Independent draws in [-1, 1]; `deterministic` makes no difference."""
        return self._rng.uniform(-1.0, 1.0, (len(observation), self._size)).astype(
            np.float32
        ), state
