"""Many lanes as a Gymnasium vector environment, stepped by one compiled loop."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from visenvs.core.layout import Row, Values
from visenvs.faces import common
from visenvs.faces.infos import mask_infos, vector_infos

Mask = NDArray[np.bool_]
EVERY = np.True_
METADATA: dict[str, Any] = {
    "render_modes": ["rgb_array"],
    "autoreset_mode": AutoresetMode.SAME_STEP,
}


class LaneVectorEnv(common.OnLanes, VectorEnv[Row, Any, NDArray[Any]]):
    """`num_envs` vehicles, each flying the same task on its own seed.

    The same, bit for bit, as `gymnasium.vector.SyncVectorEnv` over as many `LaneEnv` in autoreset
    mode SAME_STEP: a lane that ends starts its next episode at once, and its last row and info are
    in `infos["final_obs"]` and `infos["final_info"]`.

    Args:
        env_id: which task, by its Gymnasium id.
        num_envs: number of lanes.
        scenario: which preset of the task, the first when None.
        render_mode: "rgb_array" or None.
        settings: fields of the task's configuration to change.
    """

    metadata = METADATA

    def __init__(
        self,
        env_id: str,
        num_envs: int = 1,
        scenario: str | None = None,
        render_mode: str | None = None,
        **settings: Any,
    ) -> None:
        self.lanes = common.open_alone(env_id, scenario, settings, num_envs)
        self.metadata = METADATA | common.rendering(self.lanes, METADATA, render_mode)
        self.render_mode = render_mode
        self.num_envs = num_envs
        observation = common.own_space(self.task)
        action = common.own_space(self.task.action)
        self.single_observation_space, self.single_action_space = observation, action
        self.observation_space = batch_space(observation, num_envs)
        self.action_space = batch_space(action, num_envs)
        self._begun: Mask = np.zeros(num_envs, bool)

    def reset(
        self,
        *,
        seed: int | Sequence[int | None] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[Row, dict[str, Any]]:
        """Start an episode in every lane.

        Args:
            seed: one integer, to which lane i adds i, or one for each lane. None starts the next
                episode of the lane's seed, which is drawn at its first reset.
            options: `{"reset_mask": mask}` resets only some lanes, shape (num_envs,).
        """
        if isinstance(seed, int | np.integer):
            super().reset(seed=int(seed))
        where = self._where(options)
        seeds = self._seeds(seed)
        first = where & (~self._begun | np.array([given is not None for given in seeds]))
        if first.any():
            named = [self._drawn() if seeds[i] is None else seeds[i] for i in np.flatnonzero(first)]
            self.lanes.reset(np.array(named, object), first)
        if (again := where & ~first).any():
            self.lanes.reset(None, again)
        self._begun |= where
        return self.lanes.rows.copy(), mask_infos(self.lanes, where)

    def step(self, actions: Any) -> tuple[Row, Values, Mask, Mask, dict[str, Any]]:
        """Advance every lane by one step, and start the next episode of every lane that has ended.

        Raises:
            ValueError: an action is not finite, outside [-1, 1], no choice that may be taken, or of
                the wrong shape; no lane has been touched then.
            ResetNeeded: a lane has never been reset.
        """
        self._check_begun()
        lanes = self.lanes
        ended = lanes.step(np.asarray(actions))
        rewards, done, truncated = lanes.rewards.copy(), lanes.done, lanes.truncated
        infos = vector_infos(lanes, done)
        if ended:
            lanes.reset(where=done)
        infos |= mask_infos(lanes, EVERY)
        return lanes.rows.copy(), rewards, done & ~truncated, truncated, infos

    def render(self) -> tuple[NDArray[np.uint8], ...] | None:
        """The pictures of all lanes, each (height, width, 3)."""
        self._check_begun()
        if self.render_mode is None:
            common.warn_no_render_mode(self.task)
            return None
        return tuple(common.draw(self.lanes, i) for i in range(self.num_envs))

    def snapshot(self) -> NDArray[Any]:
        """A copy of the whole state, for `restore`."""
        self._check_begun()
        return self.lanes.snapshot()

    def restore(self, snapshot: NDArray[Any]) -> None:
        """Return to a snapshot, of this environment or another of the same task and size."""
        self.lanes.restore(snapshot)
        self._begun[:] = True

    def _check_begun(self) -> None:
        if not self._begun.all():
            raise common.reset_needed(f"no episode has begun in lane {self._begun.argmin()}")

    def _drawn(self) -> int:
        return int(self.np_random.integers(common.SEEDS))

    def _seeds(self, seed: int | Sequence[int | None] | None) -> list[int | None]:
        if seed is None:
            return [None] * self.num_envs
        if isinstance(seed, int | np.integer):
            return [int(seed) + i for i in range(self.num_envs)]
        if np.asarray(seed, object).shape != (self.num_envs,):
            raise ValueError(
                f"expected a whole number, or {self.num_envs} of them, one for each lane, "
                f"got {seed!r}; write `seed=0`"
            )
        return list(seed)

    def _where(self, options: Mapping[str, Any] | None) -> Mask:
        mask = (options or {}).get("reset_mask")
        if mask is None:
            return np.ones(self.num_envs, bool)
        array = np.asarray(mask)
        if array.dtype != np.bool_ or array.shape != (self.num_envs,) or not array.any():
            raise ValueError(
                f"reset_mask must be {self.num_envs} booleans, one of them true, got {mask!r}; "
                "write `envs.reset(options={'reset_mask': terminated | truncated})`"
            )
        return array
