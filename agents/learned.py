"""Learned policies: a network flies, alone or as a residual on a law."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from visenvs.core.lanes import Task
from visenvs.core.layout import Choices

from .policy import Actions, Rows, State
from .residual import Residual


class LearnedPolicy:
    """A network, alone or as a residual on a law; among choices, it is told which may be taken."""

    def __init__(self, network: Any, task: Task, residual: Residual | None = None) -> None:
        self._network = network
        self._task = task
        self._residual = residual
        self._plain = task.frames is None and _is_plain(network)

    def predict(
        self,
        observation: Rows,
        state: State | None = None,
        episode_start: NDArray[np.bool_] | None = None,
        deterministic: bool = True,
    ) -> tuple[Actions, State | None]:
        """Actions of the network, plus the law's where it is a residual."""
        choices = self._task.action
        if isinstance(choices, Choices):
            allowed = choices.allowed(observation, self._task.observation)
            told = observation, state, episode_start, deterministic
            return self._network.predict(*told, action_masks=allowed)
        seen, command = observation, None
        if self._residual is not None:
            command = self._residual.command(observation)
            seen = self._residual.seen(observation, command)
        if self._plain and deterministic:
            action = np.clip(_mean(self._network, seen), -1.0, 1.0)
        else:
            action, state = self._network.predict(seen, state, episode_start, deterministic)
        if self._residual is not None and command is not None:
            action = self._residual.combine(command, action)
        return np.clip(action, -1.0, 1.0), state


def _is_plain(network: Any) -> bool:
    """Whether a network is PPO's own actor, whose mean action is one forward pass.

    Where actions are squashed (SB3's `squash_output`) it is not: that pass ends before the tanh. A
    class derived from it may do anything.
    """
    from stable_baselines3.common.policies import ActorCriticPolicy

    return type(network) is ActorCriticPolicy and not network.squash_output


def _mean(network: Any, observation: NDArray[Any]) -> Rows:
    """The mean action, as SB3's `predict` gives it, without its overhead for small networks."""
    import torch

    with torch.inference_mode():
        rows = torch.from_numpy(np.ascontiguousarray(observation))
        features = network.pi_features_extractor(rows)  # shared with the critic or not
        return network.action_net(network.mlp_extractor.forward_actor(features)).numpy()
