"""A start for PPO: learn what perfect information would command (DAgger).

The network flies; along its own way it learns, by least squares, the optimal command of somebody
who knows the truth. Given a row, the best guess of that command is the optimal one for a quadratic
cost and linear motion (certainty equivalence), so that what is left for PPO is the rest.
Ross, Gordon and Bagnell 2011, "A reduction of imitation learning to no-regret online learning".
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from stable_baselines3 import PPO
from tqdm import tqdm

from agents.registry import load_law
from visenvs.core.compile import kernel
from visenvs.core.config import Config, field_types, override, to_record
from visenvs.core.lanes import Task, as_floats
from visenvs.core.loop import write_rows
from visenvs.guidance.policy import NotApplicable

from .presets import Tutoring
from .vec_env import LaneVecEnv

RATE = 1e-3
PUSHED, HELD = 0.15, 0.9  # largest standard deviation of what pushes a tutor, kept from a step on
FIELDS = ("leader", "v_V_N", "heading", "tracking_error", "offset_F", "offset_rate")
SETTINGS = ("s_r", "a_max")
TEACHER = "dgg-open"  # of those who see pictures
Teacher = Callable[[NDArray[Any]], NDArray[np.float64]]


def learn_from_truth(
    model: PPO,
    lanes: LaneVecEnv,
    teacher: Teacher,
    rounds: int,
    how: Tutoring,
    watch: Callable[[int], None] = lambda _steps: None,
) -> int:
    """Train the policy's mean in place; returns how many environment steps that took.

    Args:
        model: with a network for continuous actions.
        lanes: where it flies; each round goes on where the last one stopped.
        teacher: wanted actions over the longest one from lane records.
        rounds: how often the network flies and learns.
        how: what a round is.
        watch: called after every round with the environment steps so far.
    """
    policy: Any = model.policy
    optimiser = torch.optim.Adam(policy.parameters(), lr=RATE)
    row: Any = lanes.reset()
    count, size = lanes.num_envs, how.steps * lanes.num_envs
    most = min(how.keep, rounds) * size  # the oldest are written over
    rows = np.empty((most, *row.shape[1:]), row.dtype)
    wanted = np.empty((most, lanes.action_space.shape[0]), np.float32)  # type: ignore[index]
    handover = Handover(count, wanted.shape[1], how.handover)
    for k in tqdm(range(rounds), "tutoring", leave=False):
        at = k * size % most
        for _ in range(how.steps):
            said = lanes.correction(teacher(lanes.lanes.records))
            rows[at : at + count] = row
            wanted[at : at + count] = np.clip(said, -how.largest, how.largest)
            own, _ = model.predict(row, deterministic=True)
            row, _, done, _ = lanes.step(handover.flown(said, own))
            handover.end(done, k)
            at += count
        for group in optimiser.param_groups:
            group["lr"] = RATE * (rounds - k) / rounds
        filled = min((k + 1) * size, most)
        fit(policy, optimiser, rows[:filled], wanted[:filled], how.batch, how.draws)
        watch((k + 1) * size)
    return rounds * size


class Handover:
    """Who flies: at first the tutor, then the network in more and more of the episodes.

    The tutor is pushed off its course, so that what it does there is seen before the network gets
    there (Laskey et al. 2017, "DART: noise injection for robust imitation learning").

    Args:
        lanes: how many.
        size: of an action.
        rounds: after which the network flies all; 0 for from the start.
    """

    def __init__(self, lanes: int, size: int, rounds: int) -> None:
        self._rounds = rounds
        self._tutor = torch.full((lanes, 1), rounds > 0)
        self._push = torch.zeros(lanes, size)
        self._strength = PUSHED * torch.rand(lanes, 1)

    def flown(self, said: NDArray[np.float32], own: NDArray[np.float32]) -> NDArray[np.float32]:
        """Actions: what the tutor said, pushed, or the network's own, (lanes, size)."""
        if not self._tutor.any():
            return own
        fresh = self._strength * torch.randn(self._push.shape)
        self._push = HELD * self._push + math.sqrt(1.0 - HELD * HELD) * fresh
        pushed = np.clip(said + self._push.numpy(), -1.0, 1.0)
        return np.where(self._tutor.numpy(), pushed, own)

    def end(self, done: NDArray[np.bool_], k: int) -> None:
        """Draw who flies the episodes that begin where lanes are done, in round k."""
        over = torch.from_numpy(done)[:, None]
        if self._tutor.any() and over.any():
            drawn = torch.rand(over.shape) < 1.0 - k / self._rounds
            self._tutor = torch.where(over, drawn, self._tutor)
            self._strength = torch.where(over, PUSHED * torch.rand(over.shape), self._strength)


def fit(
    policy: Any,
    optimiser: torch.optim.Optimizer,
    rows: Any,
    wanted: Any,
    batch: int,
    draws: int = 0,
) -> None:
    """Fit the mean to what is wanted, by least squares.

    Args:
        policy: SB3's.
        optimiser: of its parameters.
        rows: (n, k), or pictures (n, height, width, channels).
        wanted: actions, (n, size).
        batch: rows of one step of the optimiser.
        draws: so many rows, drawn anew each; 0 for each row once, in random order.
    """
    order = torch.randint(len(rows), (draws,)) if draws else torch.randperm(len(rows))
    for some in order.split(batch):
        inputs, _ = policy.obs_to_tensor(rows[some.numpy()])  # channels of pictures first
        mean = policy.get_distribution(inputs).distribution.mean
        loss = torch.nn.functional.mse_loss(mean, torch.from_numpy(wanted[some.numpy()]))
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()


@kernel
def place_commands(lanes, settings, out):
    """The command that pays just `guesses.place_costs`, over the longest one, shape (n, 3)."""
    s, a_max = settings[0]["s_r"], settings[0]["a_max"]
    kp, kd = math.sqrt(s), math.sqrt(2.0) * s**0.25
    for i in range(lanes.shape[0]):
        lane = lanes[i]
        e, w, c = lane["tracking_error"], lane["offset_rate"], lane["offset_F"]
        v, a, own = lane["leader"]["v_N"], lane["leader"]["a_N"], lane["v_V_N"]
        cosine, sine = math.cos(lane["heading"]), math.sin(lane["heading"])
        north, east = kd * (v[0] - own[0]) + a[0], kd * (v[1] - own[1]) + a[1]
        out[i, 0] = cosine * north + sine * east + kd * w * c[1] + w * w * c[0] + kp * e[0]
        out[i, 1] = cosine * east - sine * north - kd * w * c[0] + w * w * c[1] + kp * e[1]
        out[i, 2] = a[2] + kd * (v[2] - own[2]) + kp * e[2]
        for j in range(3):
            out[i, j] /= a_max


def teacher_of(task: Task, config: Config) -> Teacher:
    """What perfect information would command, where the distance from a place is charged.

    Where pictures are observed, what the task's law commands that knows all.
    """
    if task.frames is not None:
        try:
            return Told(task, config)
        except NotApplicable as error:
            raise ValueError(f"no tutor for pictures of {task.id}; leave --tutor out") from error
    known = set(task.lane.names or ()), set(field_types(type(config)))
    if not set(FIELDS) <= known[0] or not set(SETTINGS) <= known[1]:
        raise ValueError(f"there is no tutor for {task.id}; leave --tutor out")
    settings = to_record(config)

    def teacher(lanes: NDArray[Any]) -> NDArray[np.float64]:
        out = np.zeros((len(lanes), task.action.size))
        place_commands(lanes, settings, out)
        return out

    return teacher


class Told:
    """The law called TEACHER, told the truth, for whoever sees pictures only."""

    def __init__(self, task: Task, config: Config) -> None:
        told = override(config, {"observation": "belief", "estimator": "truth"})
        self._task = task.under(told)
        self._law = load_law(TEACHER, self._task, told)
        self._slots = self._task.observation.slots(task.lane)
        self._state: Any = None

    def __call__(self, lanes: NDArray[Any]) -> NDArray[np.float64]:
        """What it would command the lanes whose records these are, over the longest action."""
        rows = np.zeros((len(lanes), self._task.observation.size), np.float32)
        write_rows(as_floats(lanes), self._slots, rows)
        actions, self._state = self._law.predict(rows, self._state, lanes["step"] == 0)
        return actions.astype(float)
