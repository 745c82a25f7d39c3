"""What a formation flight costs, how it ends, and how well its filter does."""

from __future__ import annotations

import math

from visenvs.core.compile import kernel
from visenvs.core.outcome import COLLISION, LOST, SUCCESS
from visenvs.estimation.ekf import factorise, pack_lower, whiten
from visenvs.estimation.formation import SUBSTEPS


@kernel
def point(lane, r):
    """Write the true position of the leader relative to the follower, N, m."""
    for i in range(3):
        r[i] = lane["leader"]["r_N"][i] - lane["r_V_N"][i]


@kernel
def turn_into(c, s, x, out):
    """Write a vector of N in F."""
    out[0], out[1], out[2] = c * x[0] + s * x[1], c * x[1] - s * x[0], x[2]


@kernel
def score(lane, cfg, work):
    """Charge error and effort, watch the filter, and end at the end, out of sight or in a crash."""
    dt, steps, step = cfg["dt"], round(cfg["t_f"] / cfg["dt"]), lane["step"]
    lane["t_go"] = (steps - step) * dt
    lane["t_kept"] = step * dt
    lane["seen_share"] += (lane["seen"] - lane["seen_share"]) / step
    error, effort = off_place(lane, work)
    lane["tracking_square"] += (error - lane["tracking_square"]) / step
    lane["tracking_rms"] = math.sqrt(lane["tracking_square"])
    lane["cost_tracking"] = 0.5 * dt * cfg["s_r"] * error
    lane["cost_control"] = 0.5 * dt * effort
    lane["control_cost"] += lane["cost_control"]
    watch_filter(lane, cfg, work)
    left = 0.5 * lane["t_go"] * cfg["s_r"] * cfg["lost_error"] ** 2
    point(lane, work["r"])
    r = work["r"]
    distance = math.sqrt(r[0] * r[0] + r[1] * r[1] + r[2] * r[2])
    if lane["separation"] < cfg["wingspan"]:
        lane["outcome"], lane["cost_collision"] = COLLISION, left
    elif lane["age"] > cfg["lost_after"] - 1e-9 or distance > cfg["lost_range"]:
        lane["outcome"], lane["cost_lost"] = LOST, left
    elif step >= steps:
        lane["outcome"] = SUCCESS
    lane["total_cost"] += lane["cost_tracking"] + lane["cost_control"]
    lane["total_cost"] += lane["cost_lost"] + lane["cost_collision"]


@kernel
def off_place(lane, work):
    """Squared tracking error, m^2, and squared acceleration beyond the leader's, m^2/s^4."""
    r, e = work["r"], lane["tracking_error"]
    point(lane, r)
    turn_into(math.cos(lane["heading"]), math.sin(lane["heading"]), r, e)
    error = effort = 0.0
    for i in range(3):
        e[i] -= lane["offset_F"][i]
        error += e[i] * e[i]
        mean = 0.0
        for k in range(SUBSTEPS):
            mean += lane["push"][k, i] / SUBSTEPS
        effort += (mean - lane["leader"]["a_N"][i]) ** 2
    return error, effort


@kernel
def watch_filter(lane, cfg, work):
    """NEES of position and velocity, and their errors along the axes of F once these count."""
    belief, leader, e, factor = lane["belief"], lane["leader"], work["e"], work["factor"]
    for i in range(3):
        e[i] = belief["r_LV_N"][i] - (leader["r_N"][i] - lane["r_V_N"][i])
        e[3 + i] = belief["v_LV_N"][i] - (leader["v_N"][i] - lane["v_V_N"][i])
    c, s = math.cos(lane["heading"]), math.sin(lane["heading"])
    if lane["step"] * cfg["dt"] >= cfg["score_from"]:
        lane["scored"] += 1.0
        share = 1.0 / lane["scored"]
        turn_into(c, s, e[:3], work["mean"])
        for i in range(3):
            lane["bias_r"][i] += share * (work["mean"][i] - lane["bias_r"][i])
            lane["square_r"][i] += share * (work["mean"][i] ** 2 - lane["square_r"][i])
        turn_into(c, s, e[3:], work["mean"])
        for i in range(3):
            lane["square_v"][i] += share * (work["mean"][i] ** 2 - lane["square_v"][i])
        square = lane["square_r"]
        lane["position_rms"] = math.sqrt(square[0] + square[1] + square[2])
        a = belief["a_L_N"]
        v_n, v_e = leader["v_N"][0], leader["v_N"][1]
        lateral = (v_n * a[1] - v_e * a[0]) / math.hypot(v_n, v_e)
        lane["a_lat_mean"] += share * (lateral - lane["a_lat_mean"])
    pack_lower(belief["C"], factor)
    factorise(factor, 6)
    lane["nees"] = whiten(factor, e, e)
    lane["nees_mean"] += (lane["nees"] - lane["nees_mean"]) / lane["step"]
