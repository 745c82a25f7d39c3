"""What the faces share: lanes by name, pictures, and errors."""

from __future__ import annotations

from collections.abc import Mapping
from copy import deepcopy
from importlib import import_module
from importlib.util import find_spec
from typing import Any, cast

import numpy as np
from gymnasium import Space, logger
from gymnasium.error import ResetNeeded
from numpy.typing import NDArray

from visenvs.core.config import Config, override, pick
from visenvs.core.lanes import Lanes, Task
from visenvs.core.layout import Choices, Layout
from visenvs.core.registry import load_task

SEEDS = 2**63  # seeds drawn for a lane lie below


class OnLanes:
    """What every face tells about its lanes.

    Attributes:
        lanes: `lanes.records` is the whole state, by field name.
    """

    lanes: Lanes

    @property
    def task(self) -> Task:
        """The card of the task."""
        return self.lanes.task

    @property
    def config(self) -> Config:
        """The task's configuration."""
        return self.lanes.config

    @property
    def layout(self) -> Layout:
        """What the numbers of an observation are: `env.unwrapped.layout.unpack(observation)`."""
        return self.task.observation


def open_lanes(env_id: str, scenario: str | None, settings: Mapping[str, Any], count: int) -> Lanes:
    """`count` lanes of a task under a named preset (None for the first) with settings changed.

    Where several fly together, `count` such teams.
    """
    task = load_task(env_id)
    preset = next(iter(task.scenarios)) if scenario is None else scenario
    config = override(pick("scenario", preset, task.scenarios), settings)
    return Lanes(task, config, count * task.team(config))


def open_alone(env_id: str, scenario: str | None, settings: Mapping[str, Any], count: int) -> Lanes:
    """The same, or a ValueError where several lanes fly together."""
    lanes = open_lanes(env_id, scenario, settings, count)
    if lanes.team > 1:
        name = f"visenvs.{module_name(env_id)}"
        named = find_spec(name) is not None
        face, first = (name, "") if named else ("visenvs.faces.team", f'"{env_id}", ')
        asked = [repr(scenario)] if scenario else []
        asked += [f"{key}={value!r}" for key, value in settings.items()]
        raise ValueError(
            f"{lanes.team} agents fly {env_id} together under these settings; write "
            f"`import {face}` and `{face}.parallel_env({first}{', '.join(asked)})`"
        )
    return lanes


def module_name(env_id: str) -> str:
    """`visenvs/Formation-v0` -> `formation_v0`, as PettingZoo names its environments."""
    return env_id.removeprefix("visenvs/").replace("-", "_").lower()


def own_space(shown: Task | Layout | Choices) -> Space[Any]:
    """The space of observations, rows or choices, with a random generator of its own."""
    return cast("Space[Any]", deepcopy(shown.space))


def rendering(lanes: Lanes, metadata: Mapping[str, Any], chosen: str | None) -> dict[str, Any]:
    """The face's rendering metadata for this task; a ValueError for a mode that is not in it."""
    modes: list[str] = metadata["render_modes"] if lanes.task.picture else []
    if chosen is not None and chosen not in modes:
        choices = ", ".join(repr(mode) for mode in [None, *modes])
        raise ValueError(f"{lanes.task.id}: unknown render_mode {chosen!r}. Choices: {choices}")
    return {"render_modes": modes, "render_fps": max(1, round(1.0 / vars(lanes.config)["dt"]))}


def draw(lanes: Lanes, lane: int) -> NDArray[np.uint8]:
    """The picture of one lane, or of all that fly together with it, RGB, (height, width, 3)."""
    module, function = lanes.task.picture.split(":")
    record = lanes.records[lane]
    if lanes.team > 1:
        first = lane - lane % lanes.team
        record = lanes.records[first : first + lanes.team]
    return getattr(import_module(module), function)(record, lanes.config, lanes.task)


def reset_needed(why: str) -> ResetNeeded:
    """The error for an episode that has not begun or is over."""
    return ResetNeeded(f"{why}: write `observation, info = env.reset()` first")


def warn_no_render_mode(task: Task) -> None:
    """Say how to ask for pictures."""
    logger.warn(
        "render() was called on an environment without a render mode: "
        f'write `gymnasium.make("{task.id}", render_mode="rgb_array")`'
    )
