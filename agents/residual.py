"""A learned correction on top of a law."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from visenvs.core.config import pick
from visenvs.core.lanes import Task
from visenvs.core.layout import Layout

from .policy import Policy, Rows

Scale = float | Sequence[float]


class Reading:
    """What a residual network reads that is told the law's command: some fields, then that.

    A network that reads the row alone can push to a side, but not fly the command more gently.

    Args:
        task: what is flown.
        fields: names of fields of its row.

    Attributes:
        task: the same, with the layout of what is read as its observation.
    """

    def __init__(self, task: Task, fields: Sequence[str]) -> None:
        known = {field.name: field for field in task.observation.fields}
        chosen = [pick("field of the row", name, known) for name in fields]
        action = task.action
        assert isinstance(action, Layout)  # a choice cannot be corrected
        commands = [
            replace(field, name=f"law_{field.name}", doc=f"the law's: {field.doc}")
            for field in action.fields
        ]
        self.task = replace(task, observation=Layout((*chosen, *commands)))
        self._columns = task.observation.columns(fields)

    def rows(self, observation: Rows, command: Rows) -> Rows:
        """What the network reads, (n, k), of rows of the task and commands of the law."""
        return np.hstack([observation[:, self._columns], command])


class Residual:
    """A learned correction on top of a law: action = clip(law + scale x correction).

    Args:
        law: what is corrected; its memory is not used.
        scale: how far, over the longest action; one for all numbers of an action, or one for each.
        reading: what the network reads; None for the row as it is.
    """

    def __init__(self, law: Policy, scale: Scale, reading: Reading | None = None) -> None:
        scales = np.asarray(scale, np.float32)
        if not ((scales > 0.0) & (scales <= 1.0)).all():
            raise ValueError(f"the scale of a residual must lie in (0, 1], got {scale}")
        self._law = law
        self._scale = scales
        self.reading = reading

    def command(self, observation: Rows) -> Rows:
        """What the law commands, (n, size)."""
        return self._law.predict(observation)[0]

    def seen(self, observation: Rows, command: Rows) -> Rows:
        """What the network reads of rows and the law's commands."""
        return observation if self.reading is None else self.reading.rows(observation, command)

    def combine(self, command: Rows, correction: Rows) -> Rows:
        """Actions (n, size) from the law's commands and corrections in [-1, 1]."""
        action = command + self._scale * correction
        return np.clip(action, -1.0, 1.0).astype(np.float32, copy=False)

    def missing(self, command: Rows, wanted: NDArray[np.float64]) -> NDArray[np.float64]:
        """The corrections that make `combine` give the wanted actions, (n, size), not clipped."""
        return (wanted - command) / self._scale
