"""Guesses of the cost that lanes have still to pay, from the truth; for reward shaping only.

Each is (lanes, settings, out) -> None: records of n lanes, the configuration's record (1,), and the
costs (n,), in the unit of the task's cost.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from visenvs.core.compile import kernel
from visenvs.dynamics.ground_robot import ACTIVE, ROBOTS
from visenvs.guidance.collision_cone import dot
from visenvs.guidance.herding_value import value, value_table
from visenvs.guidance.lq import cost_to_go, terminal_weight


@kernel
def terminal_costs(lanes, settings, out):
    """Least cost to go with perfect information for a batch of lanes, m^2/s^3 (thesis (4.10))."""
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


@kernel
def herd_costs(lanes, V, settings, out):
    """What the robots that are under way will cost if each is served now and then."""
    for i in range(lanes.shape[0]):
        lane, s, lost = lanes[i], settings[0], 0.0
        for k in range(ROBOTS):
            if lane["fate"][k] == ACTIVE:
                r, phase = lane["r_R_N"][k], lane["t"] - lane["reversal_t"][k]
                lost += 1.0 - value(V, r[0], r[1], lane["heading"][k], phase, lane["t_go"], s)
        out[i] = lost * (s["score_goal"] + 0.5 * s["score_lost"])


def herd_guess(lanes: NDArray[Any], settings: NDArray[Any], out: NDArray[np.float64]) -> None:
    """What the robots of an arena will cost by the value table of the index policy."""
    herd_costs(lanes, value_table(settings), settings, out)
