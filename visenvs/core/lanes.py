"""Lanes: many copies of one task in one structured array, and what advances them.

A task gives two compiled loops over its own lane kernels (reset and step). What every task shares
is typed once: seeds and episodes here, the loops over all lanes in `loop.py`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from gymnasium.spaces import Box
from numpy.typing import ArrayLike, NDArray

from visenvs.core.config import Config, to_record
from visenvs.core.layout import Choices, Frames, Layout, Row, Values, float_slots
from visenvs.core.loop import HEADER, begin, begin_chosen, settle, write_rows
from visenvs.core.outcome import RUNNING, TIME_LIMIT, Outcome
from visenvs.core.registry import load_named, load_task

FLOAT32 = np.dtype(np.float32)
Phase = Callable[..., None]


def lane_dtype(columns: list[Any]) -> np.dtype[Any]:
    """The record of one lane: the shared header, then a task's own columns (f8, i8, any shape)."""
    return np.dtype(HEADER + columns)


@dataclass(frozen=True)
class Task:
    """The card of one environment family. One file in `visenvs/envs/` makes one of these.

    Attributes:
        id: Gymnasium id.
        summary: one line for tables.
        scenarios: named presets, the default first. Each has `dt`, the period of a step in s.
        lane: record of one lane (`lane_dtype`).
        observation: layout of the rows.
        action: layout of the actions, or the choices that there are.
        costs: lane fields that hold this step's increase of each cost term; reward = - their sum.
        metrics: lane field -> unit, reported when an episode ends.
        reset_lanes: compiled (lanes, config) -> None; starts every lane
            given, zeroed but for its seed and episode.
        step_lanes: compiled (lanes, actions, config) -> None; advances every lane that is running.
        max_steps: from the config, after how many steps a running lane is cut off; 0 for never.
            Tasks that end by themselves need none.
        picture: "module:function" that draws one lane record, imported when a frame is asked for.
        views: observation layouts by the choices of the configuration's `observation`; empty where
            there is only one.
        pictures: for some choices of it, the pictures that are observed instead of rows.
        frames: those that a configuration asks for, None for rows.
        records: for some choices of the configuration's `navigation`, "module:name" of the lane
            record to use instead: a longer one, that begins like `lane`.
        perceptions: (reset_lanes, step_lanes) to use instead for some choices of the
            configuration's `perception`.
        modes: the same for `action`, by the configuration's `action_mode`.
        team: from the config, how many lanes make one episode together. Those of a team stand side
            by side, have one seed, and start together; lane i is agent i % team. A lane that has
            ended stays as it is until all of its team have. Randomness that belongs to an agent
            must tell agents apart.
        reference: the law that the leaderboard compares the others with.
        aside: scenario whose mean cost is a column beside the default scenario's, for comparison
            with its paper and not for ranking.
        shown: metrics that tables show beside the usual ones, mean and 99th percentile.
        lost_above: cost above which an episode was a disaster; tables show the share of these.
        episodes: how many public seeds the leaderboard flies unless asked for more or fewer: fewer
            where an episode is long.
    """

    id: str
    summary: str
    scenarios: Mapping[str, Config]
    lane: np.dtype[Any]
    observation: Layout
    action: Layout | Choices
    costs: tuple[str, ...]
    metrics: Mapping[str, str]
    reset_lanes: Callable[..., None]
    step_lanes: Callable[..., None]
    max_steps: Callable[[Any], int] = field(default=lambda _config: 0)
    picture: str = field(default="")
    views: Mapping[str, Layout] = field(default_factory=dict[str, Layout])
    pictures: Mapping[str, Frames] = field(default_factory=dict[str, Frames])
    frames: Frames | None = None
    records: Mapping[str, str] = field(default_factory=dict[str, str])
    perceptions: Mapping[str, tuple[Phase, Phase]] = field(
        default_factory=dict[str, tuple["Phase", "Phase"]]
    )
    modes: Mapping[str, Layout | Choices] = field(default_factory=dict[str, "Layout | Choices"])
    team: Callable[[Any], int] = field(default=lambda _config: 1)
    reference: str = "lq"
    aside: str = ""
    shown: tuple[str, ...] = ()
    lost_above: float = math.inf
    episodes: int = 1000

    def under(self, config: Config) -> Task:
        """The card with the observation, action and perception that a configuration asks for."""
        view = self.views.get(getattr(config, "observation", ""), self.observation)
        action = self.modes.get(getattr(config, "action_mode", ""), self.action)
        phases = self.reset_lanes, self.step_lanes
        seeing = self.perceptions.get(getattr(config, "perception", ""), phases)
        frames = self.pictures.get(getattr(config, "observation", ""))
        if frames is not None:
            frames = replace(frames, side=getattr(config, frames.setting))
        longer = self.records.get(getattr(config, "navigation", ""))
        lane = self.lane if longer is None else load_named(longer)
        chosen = view, action, seeing, frames, lane
        if chosen == (self.observation, self.action, phases, self.frames, self.lane):
            return self
        reset, step = seeing
        return replace(
            self,
            observation=view,
            action=action,
            reset_lanes=reset,
            step_lanes=step,
            frames=frames,
            lane=lane,
        )

    @property
    def space(self) -> Box:
        """The space of an observation: a row, or a picture."""
        return self.observation.space if self.frames is None else self.frames.space

    @property
    def takes(self) -> str:
        """What an action is, for error messages."""
        number = "the number of one of " if isinstance(self.action, Choices) else ""
        return f"{self.id} takes {number}{', '.join(self.action.names)}"


class Lanes:
    """`count` lanes of one task under one configuration.

    Attributes:
        records: the whole state, one record per lane; read it by field name.
        rows: observation of every lane: float32, shape (count, observation.size), or pictures,
            uint8, shape (count, *task.space.shape).
        rewards: of the last step, shape (count,).
        terms: minus the cost terms of the last step, whose sums are the rewards, shape
            (count, len(task.costs)).
    """

    def __init__(self, task: Task, config: Config, count: int) -> None:
        if count < 1:
            raise ValueError(f"the number of lanes must be at least 1, got {count}")
        self.task = task = task.under(config)
        self.config = config
        self.team = team = task.team(config)
        if count % team:
            raise ValueError(f"{team} lanes of {task.id} fly together, {count} lanes do not divide")
        self.records: NDArray[Any] = np.zeros(count, task.lane)
        numbers: Row = np.zeros((count, task.observation.size), np.float32)
        self.rows: NDArray[Any] = numbers
        if task.frames is not None:
            self.rows = np.zeros((count, *task.space.shape), np.uint8)
        self.rewards: Values = np.zeros(count)
        self.terms: Values = np.zeros((count, len(task.costs)))
        self._shape = (count, task.action.size)
        self._record = to_record(config)
        self._slots = task.observation.slots(task.lane)
        self._integers, self._floats = as_integers(self.records), as_floats(self.records)
        costs, results = float_slots(task.lane, task.costs), (self.terms, self.rewards, numbers)
        # plain arrays rather than records: a call unpacks them faster
        seen = self._integers, self._floats, costs
        self._settle_with = *seen, self._slots, task.max_steps(config), *results
        self._begin: Callable[..., int] = begin
        self._begin_with: tuple[Any, ...] = seen
        if isinstance(task.action, Choices):
            mask = float_slots(task.lane, [task.action.mask] if task.action.mask else [])
            self._begin, self._begin_with = begin_chosen, (*seen, mask, len(task.action.names))

    @property
    def count(self) -> int:
        """How many lanes there are."""
        return len(self.records)

    @property
    def outcome(self) -> NDArray[np.int64]:
        """`Outcome` of every lane as integers, shape (count,)."""
        return self.records["outcome"]

    @property
    def done(self) -> NDArray[np.bool_]:
        """Which lanes have ended, shape (count,)."""
        return self.outcome != RUNNING

    @property
    def truncated(self) -> NDArray[np.bool_]:
        """Which lanes were cut off by the time limit, shape (count,)."""
        return self.outcome == TIME_LIMIT

    def reset(self, seeds: ArrayLike | None = None, where: NDArray[np.bool_] | None = None) -> None:
        """Start new episodes.

        Args:
            seeds: one non-negative integer for each lane that is reset (for each team where lanes
                fly together); the first episode of that seed begins. None: the next episode of the
                seed that the lane has.
            where: which lanes, shape (count,), whole teams; None for all.
        """
        chosen = slice(None) if where is None else where
        seed, episode = self.records["seed"][chosen], self.records["episode"][chosen]
        lanes = np.zeros(len(seed), self.task.lane)
        if seeds is None:
            lanes["seed"], lanes["episode"] = seed, episode + 1
        else:
            lanes["seed"] = np.repeat(checked_seeds(seeds, len(lanes) // self.team), self.team)
        self.task.reset_lanes(lanes, self._record)
        rows = np.zeros((len(lanes), *self.rows.shape[1:]), self.rows.dtype)
        self._observe(lanes, rows)
        self._integers[chosen] = as_integers(lanes)
        self.rows[chosen] = rows

    def step(self, actions: Row) -> int:
        """Advance every running lane by one step; returns how many lanes have ended.

        Args:
            actions: rows of the action layout in [-1, 1], float32, shape (count, action.size); or
                the numbers of choices, (count,) or (count, 1).

        Raises:
            ValueError: an action of a running lane is not finite, outside its box or no choice that
                may be taken, or the shape is wrong; no lane has been touched then.
        """
        if actions.shape != self._shape or actions.dtype != FLOAT32 or not actions.flags.carray:
            actions = self._shaped(actions)
        bad = self._begin(*self._begin_with, actions)
        if bad >= 0:
            raise self._refusal(bad, actions[bad].tolist())
        self.task.step_lanes(self.records, actions, self._record)
        ended = settle(*self._settle_with)
        if self.task.frames is not None:
            self._observe(self.records, self.rows)
        return ended

    @property
    def allowed(self) -> NDArray[np.bool_]:
        """Which choices each lane may take, shape (count, choices)."""
        action = self.task.action
        assert isinstance(action, Choices)
        if not action.mask:
            return np.ones((self.count, len(action.names)), bool)
        return self.records[action.mask] > 0.5

    @property
    def over(self) -> NDArray[np.bool_]:
        """Lanes whose whole team has ended, shape (count,)."""
        if self.team == 1:
            return self.done
        return np.repeat(self.done.reshape(-1, self.team).all(axis=1), self.team)

    def results(self, lane: int) -> dict[str, Any]:
        """Outcome and metrics of one lane, SI."""
        record = self.records[lane]
        metrics = {name: float(record[name]) for name in self.task.metrics}
        return {"outcome": Outcome(int(record["outcome"])), **metrics}

    def snapshot(self) -> NDArray[Any]:
        """A copy of the whole state, for `restore`."""
        return self.records.copy()

    def restore(self, snapshot: NDArray[Any]) -> None:
        """Return to a snapshot of the same task and number of lanes."""
        fits = getattr(snapshot, "dtype", None) == self.records.dtype
        if not fits or snapshot.shape != self.records.shape:
            raise ValueError(
                f"the snapshot is not of {self.count} lanes of {self.task.id}; "
                "write `snapshot = env.snapshot()` and later `env.restore(snapshot)`"
            )
        self.records[:] = snapshot
        self._observe(self.records, self.rows)

    def __reduce__(self) -> tuple[Any, ...]:
        """Copies and pickles name their task, so that no compiled code is in them."""
        return _revive, (self.task.id, self.config, self.records, self.rewards, self.terms)

    def _observe(self, lanes: NDArray[Any], rows: NDArray[Any]) -> None:
        """Write the observations of lane records."""
        if self.task.frames is not None:
            self.task.frames.drawing(lanes, self._record, rows)
        else:
            write_rows(as_floats(lanes), self._slots, rows)

    def _shaped(self, actions: ArrayLike) -> Row:
        with np.errstate(over="ignore"):
            array = np.array(actions, np.float32, order="C")
        chosen = isinstance(self.task.action, Choices)
        if chosen and array.ndim == 1:
            array = array[:, None]
        if array.shape != self._shape:
            shape = self._shape[:1] if chosen else self._shape
            raise ValueError(
                f"actions must have shape {shape}, got {array.shape}: {self.task.takes}"
            )
        return array

    def _refusal(self, lane: int, action: list[float]) -> ValueError:
        if not isinstance(self.task.action, Choices):
            return ValueError(
                f"action of lane {lane} must be finite and within [-1, 1], "
                f"got {action}; write `numpy.clip(action, -1, 1)`"
            )
        allowed = np.flatnonzero(self.allowed[lane]).tolist()
        return ValueError(
            f"action of lane {lane} must be the number of a choice that may be taken, one of "
            f"{allowed}, got {action}; write `space.sample(mask=info['action_mask'])`"
        )


def _revive(
    env_id: str, config: Config, records: NDArray[Any], rewards: Values, terms: Values
) -> Lanes:
    lanes = Lanes(load_task(env_id), config, len(records))
    lanes.restore(records)
    lanes.rewards[:], lanes.terms[:] = rewards, terms
    return lanes


def as_floats(lanes: NDArray[Any]) -> Values:
    """The same memory as float64, shape (count, record size / 8)."""
    return lanes.view(np.float64).reshape(len(lanes), lanes.dtype.itemsize // 8)


def as_integers(lanes: NDArray[Any]) -> NDArray[np.int64]:
    """The same memory as int64, shape (count, record size / 8)."""
    return lanes.view(np.int64).reshape(len(lanes), lanes.dtype.itemsize // 8)


def checked_seeds(seeds: ArrayLike, count: int) -> NDArray[np.uint64]:
    """`count` seeds as uint64, or a ValueError."""
    array = np.asarray(seeds, object)
    if array.shape != (count,) or not all(_is_seed(seed) for seed in array):
        raise ValueError(
            f"expected {count} integer seeds from 0 to 2**64 - 1, got {seeds!r}; "
            f"write `seed={0 if count == 1 else list(range(min(count, 3)))}`"
            + (f" with {count} of them" if count > 3 else "")
        )
    return array.astype(np.uint64)


def _is_seed(value: Any) -> bool:
    whole = isinstance(value, int | np.integer) and not isinstance(value, bool)
    return whole and 0 <= int(value) < 2**64
