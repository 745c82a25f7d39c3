"""Potentials for reward shaping in training; the environments themselves know nothing of it.

A potential is minus a guess of the cost still to pay. It may read the truth, since it is gone when
the policy flies: what it adds to the return does not depend on the policy (Ng, Harada and Russell
1999).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from visenvs.core.compile import kernel
from visenvs.core.config import Config, field_types, to_record
from visenvs.core.lanes import Task
from visenvs.guidance.lq import cost_to_go

LANE = ("r_TV_N", "v_V_N", "t_go")
SETTINGS = ("s_x", "s_v")
PLACE = ("leader", "v_V_N", "heading", "tracking_error", "offset_F", "offset_rate")
PLACE_SETTINGS = ("s_r", "a_max")
Potential = Callable[[NDArray[Any]], NDArray[np.float64]]
Teacher = Callable[[NDArray[Any]], NDArray[np.float64]]


@kernel
def terminal_costs(lanes, settings, out):
    """Least cost to go with perfect information for a batch of lanes, m^2/s^3."""
    for i in range(lanes.shape[0]):
        lane, s = lanes[i], settings[0]
        out[i] = cost_to_go(lane["r_TV_N"], lane["v_V_N"], lane["t_go"], s["s_x"], s["s_v"])


@kernel
def place_rates(lane):
    """Rates of the true tracking error along the axes of F, m/s."""
    v, own, w, c = lane["leader"]["v_N"], lane["v_V_N"], lane["offset_rate"], lane["offset_F"]
    cosine, sine = math.cos(lane["heading"]), math.sin(lane["heading"])
    north, east = v[0] - own[0], v[1] - own[1]
    ahead, right = cosine * north + sine * east, cosine * east - sine * north
    return ahead + w * c[1], right - w * c[0], v[2] - own[2]


@kernel
def place_commands(lanes, settings, out):
    """The command that pays just `place_costs`, over the longest one, shape (n, 3)."""
    s, a_max = settings[0]["s_r"], settings[0]["a_max"]
    kp, kd = math.sqrt(s), math.sqrt(2.0) * s**0.25
    for i in range(lanes.shape[0]):
        lane = lanes[i]
        e, a, w, c = (
            lane["tracking_error"], lane["leader"]["a_N"], lane["offset_rate"], lane["offset_F"]
        )  # fmt: skip
        cosine, sine = math.cos(lane["heading"]), math.sin(lane["heading"])
        ahead, right, down = place_rates(lane)
        out[i, 0] = cosine * a[0] + sine * a[1] + w * w * c[0] + kp * e[0] + kd * ahead
        out[i, 1] = cosine * a[1] - sine * a[0] + w * w * c[1] + kp * e[1] + kd * right
        out[i, 2] = a[2] + kp * e[2] + kd * down
        for j in range(3):
            out[i, j] /= a_max


@kernel
def place_costs(lanes, settings, out):
    """Least cost to go of keeping a place without an end and without a lag, m^2/s^3.

    For 1/2 integral of s |e|^2 + |e''|^2 the Riccati equation has the solution
    [[sqrt(2) s^(3/4), sqrt(s)], [sqrt(s), sqrt(2) s^(1/4)]] for each axis.
    """
    s = settings[0]["s_r"]
    both, error, rate = math.sqrt(s), math.sqrt(2.0) * s**0.75, math.sqrt(2.0) * s**0.25
    for i in range(lanes.shape[0]):
        lane = lanes[i]
        e = lane["tracking_error"]
        ahead, right, down = place_rates(lane)
        square = e[0] * e[0] + e[1] * e[1] + e[2] * e[2]
        mixed = e[0] * ahead + e[1] * right + e[2] * down
        out[i] = 0.5 * error * square + both * mixed
        out[i] += 0.5 * rate * (ahead * ahead + right * right + down * down)


def potential_of(task: Task, config: Config) -> Potential | None:
    """Minus the least cost to go with perfect information, or None.

    For every task with a terminal cost of position and velocity (thesis (4.10)), and for those that
    charge the distance from a commanded place: the names tell.
    """
    if _has(task, config, LANE, SETTINGS):
        costs = terminal_costs
    elif _has(task, config, PLACE, PLACE_SETTINGS):
        costs = place_costs
    else:
        return None
    settings = to_record(config)

    def potential(lanes: NDArray[Any]) -> NDArray[np.float64]:
        out = np.zeros(len(lanes))
        costs(lanes, settings, out)
        return -out

    return potential


def teacher_of(task: Task, config: Config) -> Teacher:
    """What perfect information would command, for tasks that charge the distance from a place."""
    if not _has(task, config, PLACE, PLACE_SETTINGS):
        raise ValueError(f"nobody can be imitated on {task.id}; leave --imitate out")
    settings = to_record(config)

    def teacher(lanes: NDArray[Any]) -> NDArray[np.float64]:
        out = np.zeros((len(lanes), task.action.size))
        place_commands(lanes, settings, out)
        return out

    return teacher


def _has(task: Task, config: Config, fields: tuple[str, ...], settings: tuple[str, ...]) -> bool:
    given = field_types(type(config))
    return set(fields) <= set(task.lane.names or ()) and set(settings) <= set(given)
