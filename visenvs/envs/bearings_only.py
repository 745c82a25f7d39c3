"""Bearings only: move so that the bearings of a moving target tell where it is.

The target flies at constant velocity, the observer at constant speed; the only action is its turn
rate. What is scored is the estimate: its position error and its consistency, step by step. That is
the belief-MDP of observer control (arXiv 2605.02120, with the posterior of a cubature filter as
belief and a reward between Euclidean and Mahalanobis distance).

The row is written in L, the frame of the estimated line of sight: first axis along it, second to
its right. North does not matter here, so a policy need not learn the same flight for every bearing.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from visenvs.core.bearing import bearing
from visenvs.core.compile import kernel
from visenvs.core.config import code, require, validate
from visenvs.core.lanes import Task, lane_dtype
from visenvs.core.layout import Field, Layout
from visenvs.core.noise import normal_pair, uniform_pair
from visenvs.core.outcome import MISS, RUNNING, SUCCESS
from visenvs.dynamics.turning import turn
from visenvs.estimation import moving
from visenvs.estimation.ekf import factorise, pack_lower, whiten
from visenvs.sensors.bearing import take_bearing

ENV_ID = "visenvs/BearingsOnly-v0"

PLACE, BEARING = 0, 1  # noise streams
CUT = 3.0  # standard deviations, where the prior is cut off


@dataclass(frozen=True)
class BearingsOnlyConfig:
    """Everything that defines a bearings-only task, SI and radians."""

    estimator: Literal["ukf", "ekf"] = "ukf"
    dt: float = 2.0  # control and measurement period, s
    t_f: float = 300.0  # end of the episode, s
    speed: float = 18.0  # of the observer, constant, m/s
    turn_max: float = math.radians(6.0)  # fastest turn, rad/s
    success_radius: float = 100.0  # a final position error no larger counts as success, m
    # cost: time mean of beta error / error_scale + (1 - beta) consistency + turn_weight turn^2
    beta: float = 0.7  # share of accuracy; the published trade-off, there as a geometric mean
    error_scale: float = 100.0  # a position error that costs 1, m
    # Mahalanobis distance of the position that costs nothing: a consistent filter is within 3 in
    # 98.9 % of all cases
    mahalanobis_free: float = 3.0
    turn_weight: float = 0.01  # of (turn rate / turn_max)^2
    # sensor
    sigma_bearing: float = math.radians(1.0)  # noise of a bearing, rad
    p_detect: float = 0.95  # chance that the target is seen
    min_range: float = 10.0  # nearer there is no measurement, m
    # filter
    kappa: float = 0.0  # of the unscented filter; 0 is the cubature filter
    # start
    range_drawn: tuple[float, float] = (2000.0, 4000.0)  # estimated range, m
    range_error: float = 0.3  # standard deviation of the true range over the estimated one
    cross_error: float = math.radians(2.0)  # the same across the line of sight, rad
    velocity_error: float = 5.0  # standard deviation of the target's velocity, each axis, m/s

    def __post_init__(self) -> None:
        validate(self)
        require(
            self,
            dt=self.dt > 0,
            t_f=self.t_f >= self.dt,
            speed=self.speed > 0,
            turn_max=0 < self.turn_max and self.turn_max * self.dt <= math.pi,
            success_radius=self.success_radius > 0,
            beta=0 <= self.beta <= 1,
            error_scale=self.error_scale > 0,
            mahalanobis_free=self.mahalanobis_free >= 0,
            turn_weight=self.turn_weight >= 0,
            sigma_bearing=self.sigma_bearing > 0,
            p_detect=0 <= self.p_detect <= 1,
            min_range=self.min_range > 0,
            kappa=self.kappa >= 0,
            range_drawn=0 < self.range_drawn[0] <= self.range_drawn[1],
            range_error=0 < self.range_error < 1 / CUT,
            cross_error=self.cross_error > 0,
            velocity_error=self.velocity_error > 0,
        )


SCENARIOS = {"random": BearingsOnlyConfig()}

UNSCENTED = code(BearingsOnlyConfig, "estimator", "ukf")

LANE = lane_dtype([
    ("r_TV_N", "f8", (2,)),  # target relative to the observer, truth
    ("v_T_N", "f8", (2,)),  # target, truth
    ("r_V_N", "f8", (2,)), ("v_V_N", "f8", (2,)),  # observer, known to itself
    ("turn_rate", "f8"),
    ("rhat_TV_N", "f8", (2,)), ("vhat_T_N", "f8", (2,)),
    ("P", "f8", (4, 4)),  # of the position, then the velocity
    ("range_hat", "f8"), ("vhat_T_L", "f8", (2,)),
    # rows of the lower Cholesky factor of P in L: of the position, and of the velocity
    ("chol_r", "f8", (3,)), ("chol_v", "f8", (7,)),
    ("v_V_L", "f8", (2,)),
    ("bearing", "f8", (1,)),  # last measured
    ("innovation", "f8"),
    ("seen", "f8"),  # 1 where the last look gave a measurement
    ("t_go", "f8"),
    ("cost_error", "f8"), ("cost_consistency", "f8"), ("cost_control", "f8"),
    ("total_cost", "f8"), ("control_cost", "f8"),
    ("position_error", "f8"), ("position_error_mean", "f8"), ("miss_distance", "f8"),
    ("mahalanobis", "f8"), ("mahalanobis_peak", "f8"),  # of the position
    ("nees", "f8"), ("nees_mean", "f8"),  # of position and velocity
])  # fmt: skip

OBSERVATION = Layout((
    Field("range_hat", 1, "m", "", 0.0, 20000.0, 2000.0,
          "estimated range of the target, along the first axis of L"),
    Field("vhat_T_L", 2, "m/s", "L", -50.0, 50.0, 5.0, "estimated velocity of the target"),
    Field("chol_r", 3, "m", "L", -5000.0, 5000.0, 500.0,
          "lower Cholesky factor of the covariance, row by row: rows of the position"),
    Field("chol_v", 7, "m/s", "L", -50.0, 50.0, 5.0, "and rows of the velocity"),
    Field("v_V_L", 2, "m/s", "L", -50.0, 50.0, 20.0, "own velocity"),
    Field("innovation", 1, "rad", "", -math.pi, math.pi, 0.05,
          "last innovation of the bearing, 0 without a measurement"),
    Field("seen", 1, "", "", 0.0, 1.0, 1.0, "1 where the last look gave a measurement"),
    Field("t_go", 1, "s", "", 0.0, 1000.0, 300.0, "time to go"),
))  # fmt: skip
ACTION = Layout((
    Field("turn_rate", 1, "turn_max", "", -1.0, 1.0, 1.0,
          "commanded turn rate over the fastest one, clockwise positive"),
))  # fmt: skip

WORK = np.dtype([
    ("filter", moving.SCRATCH),
    ("x", "f8", (4,)),  # the estimate as the filter's state
    ("x_L", "f8", (4,)), ("P_L", "f8", (4, 4)),  # estimate and covariance in L
    ("chol", "f8", (10,)),  # of P_L
    ("e", "f8", (4,)), ("e_L", "f8", (4,)),  # error of the estimate
    ("moved", "f8", (2,)),
])  # fmt: skip


@kernel
def step_lane(lane, action, cfg, work):
    """One step: act and move, sense and estimate, score."""
    fly(lane, action, cfg, work["moved"])
    gather(lane, work["x"])
    moving.predict(work["x"], lane["P"], work["moved"], cfg["dt"])
    look(lane, cfg, work)
    score(lane, cfg, work)


@kernel
def reset_lane(lane, cfg, work):
    """Start an episode from a zeroed record: place the target, tell the filter its prior, look."""
    place(lane, cfg, work)
    lane["t_go"] = cfg["t_f"]
    gather(lane, work["x"])
    look(lane, cfg, work)


@kernel
def gather(lane, x):
    """Write the estimated position and velocity side by side, as the filters' state (4,)."""
    for i in range(2):
        x[i] = lane["rhat_TV_N"][i]
        x[i + 2] = lane["vhat_T_N"][i]


@kernel
def fly(lane, action, cfg, moved):
    """Turn the observer and move both for one step; `moved` receives the observer's way (N, m)."""
    lane["turn_rate"] = cfg["turn_max"] * min(max(action[0], -1.0), 1.0)
    turn(lane["v_V_N"], lane["turn_rate"], cfg["dt"], moved)
    for i in range(2):
        lane["r_V_N"][i] += moved[i]
        lane["r_TV_N"][i] += cfg["dt"] * lane["v_T_N"][i] - moved[i]


@kernel
def look(lane, cfg, work):
    """Take a bearing, update the estimate, write it for the row."""
    x, P, out = work["x"], lane["P"], lane["bearing"]
    seed, episode, step = lane["seed"], lane["episode"], lane["step"]
    lane["innovation"] = lane["seen"] = 0.0
    if take_bearing(lane["r_TV_N"], cfg, seed, episode, step, BEARING, out):
        lane["seen"] = 1.0
        if cfg["estimator"] == UNSCENTED:
            lane["innovation"] = moving.update_unscented(x, P, out[0], cfg, work["filter"])
        else:
            lane["innovation"] = moving.update_extended(x, P, out[0], cfg, work["filter"])
    for i in range(2):
        lane["rhat_TV_N"][i] = x[i]
        lane["vhat_T_N"][i] = x[i + 2]
    describe(lane, work)


@kernel
def describe(lane, work):
    """Write belief and own velocity in L, the axes along the estimated line of sight."""
    x, x_L, P_L, chol = work["x"], work["x_L"], work["P_L"], work["chol"]
    sight = bearing(x)
    moving.turn_axes(sight, x, lane["P"], x_L, P_L)
    pack_lower(P_L, chol)
    factorise(chol, 4)
    lane["range_hat"] = x_L[0]
    for i in range(2):
        lane["vhat_T_L"][i] = x_L[i + 2]
    for k in range(3):
        lane["chol_r"][k] = chol[k]
    for k in range(7):
        lane["chol_v"][k] = chol[k + 3]
    c, s, v = math.cos(sight), math.sin(sight), lane["v_V_N"]
    lane["v_V_L"][0], lane["v_V_L"][1] = c * v[0] + s * v[1], c * v[1] - s * v[0]


@kernel
def score(lane, cfg, work):
    """Charge error, inconsistency and turning as time means, and end at the terminal time."""
    steps, e = round(cfg["t_f"] / cfg["dt"]), work["e"]
    lane["t_go"] = (steps - lane["step"]) * cfg["dt"]
    for i in range(2):
        e[i] = lane["rhat_TV_N"][i] - lane["r_TV_N"][i]
        e[i + 2] = lane["vhat_T_N"][i] - lane["v_T_N"][i]
    error = math.sqrt(e[0] * e[0] + e[1] * e[1])
    moving.turn_axes(bearing(work["x"]), e, lane["P"], work["e_L"], work["P_L"])
    lane["position_error"] = error
    lane["position_error_mean"] += (error - lane["position_error_mean"]) / lane["step"]
    lane["nees"] = whiten(work["chol"], work["e_L"], e)
    lane["nees_mean"] += (lane["nees"] - lane["nees_mean"]) / lane["step"]
    # the leading rows of a Cholesky factor are the factor of the leading block
    lane["mahalanobis"] = math.sqrt(e[0] * e[0] + e[1] * e[1])
    lane["mahalanobis_peak"] = max(lane["mahalanobis_peak"], lane["mahalanobis"])
    excess = max(lane["mahalanobis"] - cfg["mahalanobis_free"], 0.0)
    turning = lane["turn_rate"] / cfg["turn_max"]
    lane["cost_error"] = cfg["beta"] * error / cfg["error_scale"] / steps
    lane["cost_consistency"] = (1.0 - cfg["beta"]) * excess / steps
    lane["cost_control"] = cfg["turn_weight"] * turning * turning / steps
    lane["control_cost"] += lane["cost_control"]
    lane["total_cost"] += lane["cost_error"] + lane["cost_consistency"] + lane["cost_control"]
    if lane["step"] >= steps:
        lane["miss_distance"] = error
        lane["outcome"] = SUCCESS if error <= cfg["success_radius"] else MISS


@kernel
def place(lane, cfg, work):
    """Draw the estimate and own course, then the truth from the prior that the filter is told.

    Each draw of the prior is cut off at 3 standard deviations, so that the target is always ahead.
    """
    seed, episode, e = lane["seed"], lane["episode"], work["e"]
    u_range, u_azimuth = uniform_pair(seed, episode, PLACE, 0, 0)
    course = 2.0 * math.pi * uniform_pair(seed, episode, PLACE, 0, 1)[0]
    e[0], e[1] = normal_pair(seed, episode, PLACE, 0, 2)
    e[2], e[3] = normal_pair(seed, episode, PLACE, 0, 3)
    for k in range(4):
        e[k] = min(max(e[k], -CUT), CUT)
    low, high = cfg["range_drawn"][0], cfg["range_drawn"][1]
    length = low + u_range * (high - low)
    c, s = math.cos(2.0 * math.pi * u_azimuth), math.sin(2.0 * math.pi * u_azimuth)
    along, cross = cfg["range_error"] * length, cfg["cross_error"] * length
    lane["rhat_TV_N"][0], lane["rhat_TV_N"][1] = length * c, length * s
    lane["r_TV_N"][0] = length * c + along * e[0] * c - cross * e[1] * s
    lane["r_TV_N"][1] = length * s + along * e[0] * s + cross * e[1] * c
    lane["v_V_N"][0] = cfg["speed"] * math.cos(course)
    lane["v_V_N"][1] = cfg["speed"] * math.sin(course)
    P = lane["P"]
    P[0, 0] = (along * c) ** 2 + (cross * s) ** 2
    P[0, 1] = P[1, 0] = (along * along - cross * cross) * c * s
    P[1, 1] = (along * s) ** 2 + (cross * c) ** 2
    for i in range(2):
        lane["v_T_N"][i] = cfg["velocity_error"] * e[i + 2]
        P[i + 2, i + 2] = cfg["velocity_error"] ** 2


@kernel
def reset_lanes(lanes, config):
    """Start every lane given."""
    work = np.zeros(1, WORK)
    for i in range(lanes.shape[0]):
        reset_lane(lanes[i], config[0], work[0])


@kernel
def step_lanes(lanes, actions, config):
    """Advance every lane that is running."""
    work = np.zeros(1, WORK)
    for i in range(lanes.shape[0]):
        if lanes[i]["outcome"] == RUNNING:
            step_lane(lanes[i], actions[i], config[0], work[0])


TASK = Task(
    id=ENV_ID,
    summary="move so that the bearings of a moving target tell where it is",
    scenarios=SCENARIOS,
    lane=LANE,
    observation=OBSERVATION,
    action=ACTION,
    costs=("cost_error", "cost_consistency", "cost_control"),
    metrics={
        "total_cost": "",
        "control_cost": "",
        "position_error_mean": "m",
        "miss_distance": "m",
        "mahalanobis_peak": "",
        "nees_mean": "",
    },
    reset_lanes=reset_lanes,
    step_lanes=step_lanes,
    picture="visenvs.render.bearings_only:draw",
    reference="straight",
    shown=("position_error_mean", "miss_distance"),
)
