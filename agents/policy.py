"""What every policy is: letter for letter stable-baselines3's `PolicyPredictor`."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from visenvs.guidance.policy import Actions, NotApplicable, Rows, State

__all__ = ["Actions", "NotApplicable", "Policy", "Rows", "State"]


class Policy(Protocol):
    """A batch of observation rows in, a batch of actions out."""

    def predict(
        self,
        observation: Rows,
        state: State | None = None,
        episode_start: NDArray[np.bool_] | None = None,
        deterministic: bool = True,
    ) -> tuple[Actions, State | None]:
        """Actions for observation rows (n, size), and the memory to hand back with the next rows.

        Args:
            observation: rows of the environment's observation layout, float32.
            state: memory from the call before; None at the first.
            episode_start: which rows begin an episode (their memory is cleared), shape (n,).
            deterministic: False samples from a stochastic policy.
        """
        ...
