"""Lanes as a stable-baselines3 VecEnv."""

from __future__ import annotations

import time
from collections.abc import Sequence
from copy import deepcopy
from typing import Any

import numpy as np
from numpy.typing import NDArray
from stable_baselines3.common.vec_env import VecEnv

from agents.residual import Residual
from visenvs.core.config import Config
from visenvs.core.lanes import Lanes, Task
from visenvs.core.layout import Choices
from visenvs.core.outcome import SUCCESS

from .shaping import Potential

MASKS = "action_masks"  # as sb3-contrib asks for it


class LaneVecEnv(VecEnv):
    """Lanes behind SB3's interface, with automatic reset in the same step.

    Args:
        task, config: what to fly. Where several lanes fly together, each agent is a row; the row of
            one that has ended stays, without reward, until all of its team have.
        seeds: one for each lane, or for each team.
        residual: adds a law's command to the learned one, or None.
        potential: shapes the reward as r + potential(after) - potential(before), with 0 at the end
            of an episode; the return changes only by the potential of the start. None for the cost
            as it is.
        reward_floor: shaped rewards below this, or above its opposite, are cut off there, m^2/s^3:
            one lost target in a thousand episodes costs more than all the others and would drown
            what they teach. Cut off below alone, to lose and to regain would pay.
        unit: shaped rewards are divided by it, so that values stay about 1.
    """

    def __init__(
        self,
        task: Task,
        config: Config,
        seeds: Sequence[int],
        residual: Residual | None = None,
        potential: Potential | None = None,
        reward_floor: float = -np.inf,
        unit: float = 1.0,
    ) -> None:
        count, task = len(seeds) * task.team(config), task.under(config)
        self.render_mode = None
        reading = None if residual is None else residual.reading
        self.task = task if reading is None else reading.task
        super().__init__(count, deepcopy(self.task.space), deepcopy(task.action.space))
        self.lanes = Lanes(task, config, count)
        self._starts = list(seeds)
        self._residual = residual
        self._potential = potential
        self._before = np.zeros(count)
        self._floor, self._unit = reward_floor, unit
        self._start = time.time()
        self._returns = np.zeros(count)
        self._actions: NDArray[Any] = np.zeros((count, task.action.size), np.float32)
        self._command = self._actions.copy()
        self._seen: NDArray[Any] = np.zeros((count, *self.task.space.shape), self.lanes.rows.dtype)

    def reset(self) -> NDArray[np.float32]:
        """Start the first episode of every lane's seed."""
        self.lanes.reset(self._starts)
        self._returns[:] = 0.0
        self._remember_potential()
        self._look()
        return self._seen.copy()

    def step_async(self, actions: NDArray[Any]) -> None:
        """Keep the actions for `step_wait`."""
        self._actions = actions

    def step_wait(self) -> tuple[Any, NDArray[np.float32], NDArray[np.bool_], list[dict[str, Any]]]:
        """Advance; lanes that end report their episode and start their next one."""
        actions = self._actions
        if self._residual is not None:
            actions = self._residual.combine(self._command, actions)
        ended = self.lanes.step(actions)
        self._returns += self.lanes.rewards
        done = self.lanes.over if ended else np.zeros(self.num_envs, bool)
        rewards = self.lanes.rewards.copy()
        if self._potential is not None:
            after = np.where(done, 0.0, self._potential(self.lanes.records))
            rewards += after - self._before
            self._before = after
        infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        self._look()
        if done.any():
            self._finish(done, infos)
        return (
            self._seen.copy(),
            (np.clip(rewards, self._floor, -self._floor) / self._unit).astype(np.float32),
            done,
            infos,
        )

    def correction(self, wanted: NDArray[np.float64]) -> NDArray[np.float32]:
        """What a network has to say now, within [-1, 1], so that the actions `wanted` come out."""
        if self._residual is not None:
            wanted = self._residual.missing(self._command, wanted)
        return np.clip(wanted, -1.0, 1.0).astype(np.float32)

    def _look(self, where: NDArray[np.bool_] | slice = slice(None)) -> None:
        """Write what the network reads of some lanes, and keep the law's commands for the step."""
        rows = self.lanes.rows[where]
        if self._residual is not None:
            self._command[where] = self._residual.command(rows)
            rows = self._residual.seen(rows, self._command[where])
        self._seen[where] = rows

    def _finish(self, done: NDArray[np.bool_], infos: list[dict[str, Any]]) -> None:
        elapsed = round(time.time() - self._start, 6)
        truncated = self.lanes.truncated
        for i in np.flatnonzero(done):
            length = int(self.lanes.records["step"][i])
            infos[i] = {
                "terminal_observation": self._seen[i].copy(),
                "TimeLimit.truncated": bool(truncated[i]),
                "episode": {"r": float(self._returns[i]), "l": length, "t": elapsed},
                "is_success": bool(self.lanes.outcome[i] == SUCCESS),
            }
        self._returns[done] = 0.0
        self.lanes.reset(where=done)
        self._look(done)
        self._remember_potential()

    def _remember_potential(self) -> None:
        if self._potential is not None:
            self._before = self._potential(self.lanes.records)

    def seed(self, seed: int | None = None) -> Sequence[int | None]:
        """Give lane (or team) i the seed `seed + i` at the next reset."""
        if seed is not None:
            self._starts = [seed + i for i in range(len(self._starts))]
        return list(self._starts)

    def close(self) -> None:
        """Nothing to release."""

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """An attribute of this adapter, once for each lane asked for."""
        return [getattr(self, attr_name) for _ in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Lanes share one configuration, so that no attribute can be set on one of them."""
        raise AttributeError(
            f"lanes have no attribute {attr_name!r} of their own; pass it in the configuration"
        )

    def env_method(
        self, method_name: str, *args: Any, indices: Any = None, **kwargs: Any
    ) -> list[Any]:
        """Lanes have one method: `action_masks`, which tells the choices that each may take."""
        if method_name != MASKS or not self.has_attr(MASKS):
            raise AttributeError(f"lanes have no method {method_name!r}")
        return list(self.lanes.allowed[list(self._get_indices(indices))])

    def has_attr(self, attr_name: str) -> bool:
        """Whether the adapter has an attribute; `action_masks` only where actions are choices."""
        if attr_name == MASKS:
            return isinstance(self.lanes.task.action, Choices)
        return hasattr(self, attr_name)

    def env_is_wrapped(self, wrapper_class: Any, indices: Any = None) -> list[bool]:
        """No lane is wrapped."""
        return [False for _ in self._get_indices(indices)]
