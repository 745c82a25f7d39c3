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

from agents.registry import load_law
from visenvs.core.compile import kernel
from visenvs.core.config import Config, field_types, override, to_record
from visenvs.core.lanes import Task, as_floats
from visenvs.core.loop import write_rows
from visenvs.guidance.policy import NotApplicable

from .vec_env import LaneVecEnv

BATCH, RATE = 2048, 1e-3
FIELDS = ("leader", "v_V_N", "heading", "tracking_error", "offset_F", "offset_rate")
SETTINGS = ("s_r", "a_max")
TEACHER = "dgg-open"  # of those who see pictures
Teacher = Callable[[NDArray[Any]], NDArray[np.float64]]


def learn_from_truth(
    model: PPO,
    lanes: LaneVecEnv,
    teacher: Teacher,
    rounds: int,
    steps: int = 600,
    batch: int = BATCH,
    keep: int = 6,
    watch: Callable[[int], None] = lambda _steps: None,
) -> int:
    """Train the policy's mean in place; returns how many environment steps that took.

    Args:
        model: with a network for continuous actions.
        lanes: where it flies; each round goes on where the last one stopped.
        teacher: wanted actions over the longest one from lane records.
        rounds: how often the network flies and learns.
        steps: of every lane in a round.
        batch: rows of one step of the optimiser.
        keep: how many rounds' rows are learnt from.
        watch: called after every round with the environment steps so far.
    """
    policy: Any = model.policy
    optimiser = torch.optim.Adam(policy.parameters(), lr=RATE)
    row: Any = lanes.reset()
    kept: list[tuple[Any, Any]] = []
    for left in range(rounds, 0, -1):
        rows: list[Any] = []
        wanted: list[Any] = []
        for _ in range(steps):
            rows.append(row)
            wanted.append(lanes.correction(teacher(lanes.lanes.records)))
            actions, _ = model.predict(row, deterministic=True)
            row, _, _, _ = lanes.step(actions)
        kept = [
            *kept[max(len(kept) - keep + 1, 0) :],
            (np.concatenate(rows), np.concatenate(wanted)),
        ]
        for group in optimiser.param_groups:
            group["lr"] = RATE * left / rounds
        told, means = (np.concatenate(part) for part in zip(*kept, strict=True))
        fit(policy, optimiser, told, means, batch)
        watch((rounds - left + 1) * steps * lanes.num_envs)
    return rounds * steps * lanes.num_envs


def fit(
    policy: Any, optimiser: torch.optim.Optimizer, rows: Any, wanted: Any, batch: int = BATCH
) -> None:
    """One pass over rows (n, k) and wanted means (n, size) in random order."""
    order = torch.randperm(len(rows))
    targets = torch.as_tensor(wanted)
    for start in range(0, len(order), batch):
        some = order[start : start + batch]
        inputs, _ = policy.obs_to_tensor(rows[some.numpy()])  # channels of pictures first
        mean = policy.get_distribution(inputs).distribution.mean
        loss = torch.nn.functional.mse_loss(mean, targets[some])
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
