"""One lane as a Gymnasium environment."""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from visenvs.core.layout import Choices, Row
from visenvs.faces import common
from visenvs.faces.infos import final_info, mask_info, term_names

WINDOW = "visenvs.render.window"  # imported when it is opened
METADATA: dict[str, Any] = {"render_modes": ["rgb_array", "human"]}


class LaneEnv(common.OnLanes, gym.Env[Row, Any]):
    """One vehicle flying one task.

    Args:
        env_id: which task, by its Gymnasium id.
        scenario: which preset of the task, the first when None.
        render_mode: "rgb_array", "human" or None.
        settings: fields of the task's configuration to change.
    """

    metadata = METADATA

    def __init__(
        self,
        env_id: str,
        scenario: str | None = None,
        render_mode: str | None = None,
        **settings: Any,
    ) -> None:
        self.lanes = common.open_alone(env_id, scenario, settings, 1)
        self.metadata = METADATA | common.rendering(self.lanes, METADATA, render_mode)
        self.render_mode = render_mode
        self.observation_space = common.own_space(self.task)
        self.action_space = common.own_space(self.task.action)
        self._shape = self.action_space.shape
        self._masked = isinstance(self.task.action, Choices)
        self._terms = term_names(self.task)
        self._begun = False
        self._running = False
        self._window: Any = None

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Row, dict[str, Any]]:
        """Start an episode: the first of `seed`, or the next one of the seed that the lane has.

        Without a seed the first reset draws one. No options are read. Where the action is a choice,
        `info["action_mask"]` tells which may be taken.
        """
        super().reset(seed=seed)
        if seed is None and not self._begun:
            seed = int(self.np_random.integers(common.SEEDS))
        self.lanes.reset(None if seed is None else [seed])
        self._begun = self._running = True
        if self.render_mode == "human":
            self.render()
        return self.lanes.rows[0].copy(), mask_info(self.lanes) if self._masked else {}

    def step(self, action: Any) -> tuple[Row, float, bool, bool, dict[str, Any]]:
        """Advance one step.

        `info["reward_terms"]` sums to the reward. At the end of an episode `info["outcome"]` names
        how it ended and `info["metrics"]` holds the task's metrics, SI.

        Raises:
            ValueError: the action is not finite, outside [-1, 1], no choice that may be taken, or
                of the wrong shape.
            ResetNeeded: no episode is running.
        """
        if not self._running:
            raise common.reset_needed(
                "the episode is over" if self._begun else "no episode has begun"
            )
        lanes, row = self.lanes, np.asarray(action)
        if row.shape != self._shape:
            raise ValueError(
                f"an action has shape {self._shape}, got {row.shape}: {self.task.takes}"
            )
        terminated = truncated = False
        ended = lanes.step(row[None])
        (terms,) = lanes.terms.tolist()
        info: dict[str, Any] = {"reward_terms": dict(zip(self._terms, terms, strict=True))}
        if self._masked:
            info |= mask_info(lanes)
        if ended:
            self._running = False
            truncated = bool(lanes.truncated[0])
            terminated = not truncated
            info |= final_info(lanes)
        if self.render_mode == "human":
            self.render()
        return lanes.rows[0].copy(), lanes.rewards.item(), terminated, truncated, info

    def render(self) -> NDArray[np.uint8] | None:
        """The picture (height, width, 3) for "rgb_array"; "human" shows it in a window."""
        if not self._begun:
            raise common.reset_needed("there is nothing to draw")
        if self.render_mode is None:
            common.warn_no_render_mode(self.task)
            return None
        frame = common.draw(self.lanes, 0)
        if self.render_mode == "rgb_array":
            return frame
        if self._window is None:
            self._window = import_module(WINDOW).Window(self.task.id)
        self._window.show(frame, self.metadata["render_fps"])
        return None

    def close(self) -> None:
        """Close the window, if there is one."""
        if self._window is not None:
            self._window.close()
            self._window = None

    @property
    def action_masks(self) -> Callable[[], NDArray[np.bool_]]:
        """Tells which choices may be taken, as sb3-contrib asks; only where there are choices."""
        if not self._masked:
            raise AttributeError(f"{self.task.id} has no choices to mask")
        return lambda: self.lanes.allowed[0]

    def snapshot(self) -> NDArray[Any]:
        """A copy of the whole state, for `restore`."""
        if not self._begun:
            raise common.reset_needed("there is no state to copy")
        return self.lanes.snapshot()

    def restore(self, snapshot: NDArray[Any]) -> None:
        """Return to a snapshot, of this environment or another of the same task."""
        self.lanes.restore(snapshot)
        self._begun = True
        self._running = not self.lanes.done[0]

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_window": None}
