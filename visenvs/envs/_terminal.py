"""What a flight to a point at a given time costs: the thesis's (4.2) with (4.36), and (4.67)."""

from __future__ import annotations

import math

from visenvs.core.compile import kernel
from visenvs.core.outcome import MISS, SUCCESS
from visenvs.estimation.ekf import whiten

COSTS = ("cost_control", "cost_position", "cost_velocity")
METRICS = {
    "total_cost": "m^2/s^3",
    "terminal_cost": "m^2/s^3",
    "control_cost": "m^2/s^3",
    "miss_distance": "m",
    "range_error_end": "m",
    "nees_mean": "",
    "peak_acceleration": "m/s^2",
    "integrated_acceleration": "m/s",
}


@kernel
def score(lane, cfg, error):
    """Charge this step's cost, watch the filter, and end at the terminal time.

    Args:
        lane: record with r_TV_N, v_V_N, a_V_N and rhat_TV_N, (D,), chol, COSTS and METRICS.
        cfg: record with dt and t_f (s), s_x (1/s^3), s_v (1/s), success_radius (m).
        error: scratch, (D,).
    """
    steps = round(cfg["t_f"] / cfg["dt"])
    lane["t_go"] = (steps - lane["step"]) * cfg["dt"]
    r, rhat, effort = lane["r_TV_N"], lane["rhat_TV_N"], length(lane["a_V_N"])
    lane["cost_control"] = 0.5 * cfg["dt"] * effort * effort
    lane["control_cost"] += lane["cost_control"]
    lane["peak_acceleration"] = max(lane["peak_acceleration"], effort)
    lane["integrated_acceleration"] += cfg["dt"] * effort
    for i in range(r.shape[0]):
        error[i] = rhat[i] - r[i]
    lane["nees"] = whiten(lane["chol"], error, error)
    lane["nees_mean"] += (lane["nees"] - lane["nees_mean"]) / lane["step"]
    if lane["step"] >= steps:
        miss, speed = length(r), length(lane["v_V_N"])
        lane["cost_position"] = 0.5 * cfg["s_x"] * miss * miss
        lane["cost_velocity"] = 0.5 * cfg["s_v"] * speed * speed
        lane["terminal_cost"] = lane["cost_position"] + lane["cost_velocity"]
        lane["miss_distance"] = miss
        lane["range_error_end"] = length(rhat) - miss
        lane["outcome"] = SUCCESS if miss <= cfg["success_radius"] else MISS
    lane["total_cost"] = lane["control_cost"] + lane["terminal_cost"]


@kernel
def length(r):
    """Euclidean length of a vector (D,)."""
    square = 0.0
    for i in range(r.shape[0]):
        square += r[i] * r[i]
    return math.sqrt(square)
