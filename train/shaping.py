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
from visenvs.guidance.collision_cone import dot
from visenvs.guidance.lq import cost_to_go, terminal_weight

LANE = ("r_TV_N", "v_V_N", "t_go")
SETTINGS = ("s_x", "s_v")
SCENE = ("r_V_N", "v_V_N", "r_O_N", "v_O_N", "radius", "blocks", "closest")
PASSING = ("waypoint", "margin", "s_x", "s_violation", "s_divergence")
PLACE = ("leader", "v_V_N", "heading", "tracking_error", "offset_F", "offset_rate")
PLACE_SETTINGS = ("s_r",)
MAP = ("map_error", "map_deviation", "coverage", "t_go")
MAP_SETTINGS = ("w_error", "w_uncertainty", "w_uncovered", "t_f")
Potential = Callable[[NDArray[Any]], NDArray[np.float64]]


@kernel
def terminal_costs(lanes, settings, out):
    """Least cost to go with perfect information for a batch of lanes, m^2/s^3."""
    for i in range(lanes.shape[0]):
        lane, s = lanes[i], settings[0]
        out[i] = cost_to_go(lane["r_TV_N"], lane["v_V_N"], lane["t_go"], s["s_x"], s["s_v"])


@kernel
def passing_costs(lanes, settings, out):
    """Guess of the cost to go past spheres to a waypoint for a batch of lanes, m^2/s^3.

    The least cost of each on its own: to reach the waypoint, not to enter a sphere deeper than so
    far, and not to pass one that blocks the way wider than free of charge. What is charged at the
    end for spheres that are behind is counted from the moment of their passage.
    """
    r, zero, s = np.zeros(3), np.zeros(3), settings[0]
    for k in range(lanes.shape[0]):
        lane = lanes[k]
        v = lane["v_V_N"]
        for i in range(3):
            r[i] = s["waypoint"][i] - lane["r_V_N"][i]
        T = max(r[0] / v[0], 0.0) if v[0] > 0.0 else 0.0
        for i in range(3):
            r[i] -= T * v[i]
        out[k] = cost_to_go(r, zero, T, s["s_x"], 0.0)
        for j in range(lane["count"]):
            out[k] += passing_cost(lane, j, s, r, zero)


@kernel
def passing_cost(lane, j, s, X, W):
    """That of obstacle j alone; X, W: scratch (3,), its place and the velocity relative to it."""
    for i in range(3):
        X[i] = lane["r_O_N"][j, i] - lane["r_V_N"][i]
        W[i] = lane["v_V_N"][i] - lane["v_O_N"][j, i]
    T = max(dot(X, W) / max(dot(W, W), 1e-9), 0.0)  # until the closest approach
    for i in range(3):
        X[i] -= T * W[i]
        W[i] = 0.0
    radius, closest = lane["radius"][j], lane["closest"][j]
    nearest = min(closest, math.sqrt(dot(X, X)))
    before, after = max(radius - closest, 0.0), max(radius - nearest, 0.0)
    cost = 0.5 * terminal_weight(T, s["s_violation"], 0.0)[0] * (after * after - before * before)
    excess = nearest - (1.0 + s["margin"]) * radius
    if excess > 0.0 and lane["blocks"][j] > 0.0:
        cost += 0.5 * terminal_weight(T, s["s_divergence"], 0.0)[0] * excess * excess
    return cost


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
        e, v, own, w = (
            lane["tracking_error"], lane["leader"]["v_N"], lane["v_V_N"], lane["offset_rate"]
        )  # fmt: skip
        cosine, sine, c = math.cos(lane["heading"]), math.sin(lane["heading"]), lane["offset_F"]
        north, east, down = v[0] - own[0], v[1] - own[1], v[2] - own[2]
        ahead = cosine * north + sine * east + w * c[1]
        right = cosine * east - sine * north - w * c[0]
        square = e[0] * e[0] + e[1] * e[1] + e[2] * e[2]
        mixed = e[0] * ahead + e[1] * right + e[2] * down
        out[i] = 0.5 * error * square + both * mixed
        out[i] += 0.5 * rate * (ahead * ahead + right * right + down * down)


@kernel
def map_costs(lanes, settings, out):
    """Cost to go of a map that stays as it is for a batch of lanes, dimensionless."""
    s = settings[0]
    for i in range(lanes.shape[0]):
        lane = lanes[i]
        rate = s["w_error"] * lane["map_error"] + s["w_uncertainty"] * lane["map_deviation"]
        rate += s["w_uncovered"] * (1.0 - lane["coverage"])
        out[i] = rate * lane["t_go"] / s["t_f"]


# What a lane tells, what its settings tell, and the guess for tasks that tell both.
GUESSES = (
    (LANE, SETTINGS, terminal_costs),
    (SCENE, PASSING, passing_costs),
    (PLACE, PLACE_SETTINGS, place_costs),
    (MAP, MAP_SETTINGS, map_costs),
)


def potential_of(task: Task, config: Config) -> Potential | None:
    """Minus a guess of the cost to go with perfect information, or None: the names tell.

    For every task with a terminal cost of position and velocity the least cost (thesis (4.10)), for
    those with spheres to pass `passing_costs`, for those that charge the distance from a commanded
    place `place_costs`, for maps `map_costs`.
    """
    lane, known = set(task.lane.names or ()), set(field_types(type(config)))
    able = [costs for fields, names, costs in GUESSES if {*fields} <= lane and {*names} <= known]
    if not able:
        return None
    costs, settings = able[0], to_record(config)

    def potential(lanes: NDArray[Any]) -> NDArray[np.float64]:
        out = np.zeros(len(lanes))
        costs(lanes, settings, out)
        return -out

    return potential
