"""Policies without learning: the guidance laws on an observation row, and two that do not look."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from visenvs.core.config import Config, field_types, to_record
from visenvs.core.lanes import Task
from visenvs.core.layout import Choices, Layout
from visenvs.core.registry import Law

from .policy import Actions, NotApplicable, Rows, State


def lacking(law: Law, task: Task, config: Config) -> list[str]:
    """What a law needs and the environment does not give; empty where it can fly."""
    absent = [name for name in law.needs if name not in task.observation.names]
    absent += [name for name in law.settings if name not in field_types(type(config))]
    if isinstance(task.action, Choices):
        absent += ["continuous actions"] if law.limit else []
    elif law.limit not in {field.unit for field in task.action.fields}:
        absent.append(f"actions in units of {law.limit}" if law.limit else "choices to make")
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
        layout = task.action if isinstance(task.action, Layout) else None
        self._parts = parts(law, layout, config) if layout and law.limit else []
        self._memory = law.memory(self._settings[0], task.action.size) if law.memory else 0

    def predict(
        self,
        observation: Rows,
        state: State | None = None,
        episode_start: NDArray[np.bool_] | None = None,
        deterministic: bool = True,
    ) -> tuple[Actions, State | None]:
        """Commands of the law over the largest ones; longer ones keep their direction.

        Of a law that chooses, the numbers of its choices, (n,).
        """
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
        if not self.law.limit:
            return commands[:, 0].astype(np.int64), state
        for columns, limit in self._parts:
            part = commands[:, columns] / limit
            length = np.linalg.norm(part, axis=1, keepdims=True)
            commands[:, columns] = part / np.maximum(length, 1.0)
        return commands.astype(np.float32), state


def parts(law: Law, layout: Layout, config: Config) -> list[tuple[slice, float]]:
    """Columns of every field of the action, and the setting that holds its largest command.

    That is the setting which the field's unit names, or else the law's.
    """
    settings, out, start = to_record(config), [], 0
    for field in layout.fields:
        names = settings.dtype.names or ()
        limit = float(settings[field.unit if field.unit in names else law.limit][0])
        out.append((slice(start, start + field.size), limit))
        start += field.size
    return out


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
