"""What an avoidance flight costs, how it ends, and how well its filters hold."""

from __future__ import annotations

import math

from visenvs.core.compile import kernel
from visenvs.core.outcome import MISS, SUCCESS, Outcome
from visenvs.envs._avoidance_config import K
from visenvs.envs._avoidance_sightings import GOAL, relative
from visenvs.estimation.ekf import whiten

COLLISION = int(Outcome.COLLISION)


@kernel
def watch(lane, cfg, u):
    """Update the closest approach to every obstacle; returns what deeper intrusions cost."""
    cost = 0.0
    lane["min_separation"] = math.inf
    for i in range(lane["count"]):
        relative(lane, i, cfg, u)
        distance = math.sqrt(u[0] * u[0] + u[1] * u[1] + u[2] * u[2])
        if distance < lane["closest"][i]:
            before = max(lane["radius"][i] - lane["closest"][i], 0.0)
            after = max(lane["radius"][i] - distance, 0.0)
            cost += 0.5 * cfg["s_violation"] * (after * after - before * before)
            lane["closest"][i] = distance
            lane["t_closest"][i] = lane["step"] * cfg["dt"]
        separation = lane["closest"][i] / lane["radius"][i]
        lane["min_separation"] = min(lane["min_separation"], separation)
    return cost


@kernel
def score(lane, cfg, work):
    """Charge this step's cost, watch the filters, and end behind the waypoint's plane."""
    a, r, moved = lane["a_V_N"], work["u"], work["moved"]
    effort = a[0] * a[0] + a[1] * a[1] + a[2] * a[2]
    lane["cost_control"] = 0.5 * cfg["dt"] * effort
    lane["cost_violation"] = watch(lane, cfg, r)
    lane["control_cost"] += lane["cost_control"]
    lane["peak_acceleration"] = max(lane["peak_acceleration"], math.sqrt(effort))
    watch_filters(lane, cfg, work["u"])
    relative(lane, GOAL, cfg, r)
    passed = r[0] <= 1e-6 * moved[0]  # rounding must not cost a step
    back = r[0] / moved[0] if passed else 0.0  # to the plane, along the last displacement
    lane["flight_time"] += (1.0 + back) * cfg["dt"]
    lane["cost_time"] = (1.0 + back) * cfg["s_time"] * cfg["dt"]
    if passed or lane["step"] >= longest(cfg):
        ahead, y, z = (0.0 if passed else r[0]), r[1] - back * moved[1], r[2] - back * moved[2]
        miss = math.sqrt(ahead * ahead + y * y + z * z)
        lane["miss_distance"] = miss
        lane["cost_miss"] = 0.5 * cfg["s_x"] * miss * miss
        lane["cost_divergence"] = divergence(lane, cfg)
        lane["ghosts"] = lane["tracks"]["ghosts"]
        if lane["min_separation"] < 1.0 - cfg["margin"]:
            lane["outcome"] = COLLISION
        elif passed:
            lane["outcome"] = SUCCESS if miss <= cfg["success_radius"] else MISS
    lane["total_cost"] += lane["cost_control"] + lane["cost_violation"]
    lane["total_cost"] += lane["cost_divergence"] + lane["cost_miss"] + lane["cost_time"]


@kernel
def watch_filters(lane, cfg, u):
    """Mean over tracks and steps of the squared error in standard deviations: 3 if they hold."""
    T = lane["tracks"]
    for k in range(K):
        j = int(lane["slot_O"][k])
        if lane["valid_O"][k] > 0.0 and T["owner"][j] >= 0.0:
            relative(lane, int(T["owner"][j]), cfg, u)
            for i in range(3):
                u[i] = T["r"][j, i] - u[i]
            lane["nees_count"] += 1.0
            nees = whiten(lane["chol_OV"][k], u, u)
            lane["nees_mean"] += (nees - lane["nees_mean"]) / lane["nees_count"]


@kernel
def divergence(lane, cfg):
    """Cost of having passed the blocking spheres wider than needed; counts the violations, too."""
    cost = 0.0
    for i in range(lane["count"]):
        if lane["closest"][i] < (1.0 - cfg["margin"]) * lane["radius"][i]:
            lane["violations"] += 1.0
        excess = lane["closest"][i] - (1.0 + cfg["margin"]) * lane["radius"][i]
        if excess > 0.0 and lane["blocks"][i]:
            cost += 0.5 * cfg["s_divergence"] * excess * excess
    return cost


@kernel
def blocks(lane, i, cfg):
    """Whether a straight flight to the waypoint at constant speed enters the sphere of obstacle i.

    r - s w is the obstacle relative to that flight, from s = 0 at its start to s = 1 at its end.
    """
    r, square, along, distance = lane["r_O_N"][i], 0.0, 0.0, 0.0
    t = cfg["waypoint"][0] / lane["speed"]
    for j in range(3):
        w = cfg["waypoint"][j] - t * lane["v_O_N"][i, j]
        square += w * w
        along += r[j] * w
    s = min(max(along / square, 0.0), 1.0)
    for j in range(3):
        distance += (r[j] - s * (cfg["waypoint"][j] - t * lane["v_O_N"][i, j])) ** 2
    return distance < lane["radius"][i] ** 2


@kernel
def longest(cfg):
    """After how many steps a flight is cut off."""
    slowest = cfg["velocity"][0] - cfg["velocity_drawn"][0]
    return math.ceil(cfg["patience"] * cfg["waypoint"][0] / slowest / cfg["dt"] - 1e-6)
