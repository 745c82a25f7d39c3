"""A guidance law as a policy: row to belief to command to action."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from visenvs.core.config import Config, field_types, to_record
from visenvs.core.lanes import Task
from visenvs.core.layout import Choices, Layout
from visenvs.core.registry import Law

Rows = NDArray[np.float32]
Actions = NDArray[Any]  # float32 rows (n, size), or the numbers of choices as integers (n,)
State = Any


class NotApplicable(ValueError):
    """This policy cannot fly this environment; the message says why. Tables print `n/a`."""


def lacking(law: Law, task: Task, config: Config) -> list[str]:
    """What a law needs and the environment does not give; empty where it can fly."""
    absent = [name for name in law.needs if name not in task.observation.names]
    absent += [name for name in law.settings if name not in field_types(type(config))]
    absent += [f"{name} > 0" for name in law.positive if getattr(config, name, None) == 0]
    absent += ["rows instead of pictures"] if task.frames is not None else []
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
    settings, start = to_record(config), 0
    out: list[tuple[slice, float]] = []
    for field in layout.fields:
        names = settings.dtype.names or ()
        limit = float(settings[field.unit if field.unit in names else law.limit][0])
        out.append((slice(start, start + field.size), limit))
        start += field.size
    return out
