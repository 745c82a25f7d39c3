"""Tracking in a plane: reach a stationary target whose range has to be earned (thesis 4.4).

Cost (4.67), measurement (4.68), filter (4.69). The camera's optical axis lies along x, so that an
image is one number z = (Y + nu) / X.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from visenvs.core.compile import kernel
from visenvs.core.config import code, require, validate
from visenvs.core.lanes import Task, lane_dtype
from visenvs.core.layout import Field, Layout
from visenvs.core.noise import normal, uniform
from visenvs.core.outcome import RUNNING
from visenvs.core.pinhole import pixel_variance
from visenvs.core.units import FOOT
from visenvs.dynamics.point_mass import fly
from visenvs.envs._terminal import COSTS, METRICS, score
from visenvs.estimation import grid, planar
from visenvs.estimation.ekf import factorise, pack_lower
from visenvs.estimation.stationary import predict
from visenvs.estimation.truth import reveal
from visenvs.sensors.camera import in_view

ENV_ID = "visenvs/Tracking2D-v0"

PLACE, IMAGE = 0, 1  # noise streams


@dataclass(frozen=True)
class Tracking2DConfig:
    """Everything that defines a tracking task in a plane, SI and radians."""

    # "ekf-thesis" is the literal one; "grid" is the exact posterior
    estimator: Literal["ekf", "ekf-thesis", "grid", "truth"] = "ekf"
    # the filter's belief, or images and own state alone: then a policy has to remember
    observation: Literal["belief", "raw"] = "belief"
    dt: float = 0.1  # control and camera period, s
    t_f: float = 10.0  # terminal time, s
    s_x: float = 1.0  # weight of the squared miss, 1/s^3 (4.67)
    s_v: float = 0.0  # weight of the squared terminal velocity, 1/s
    a_max: float = 5 * FOOT  # length of the longest acceleration, m/s^2
    success_radius: float = 1.0  # a miss no larger counts as success, m
    # camera
    camera: Literal["fixed"] = "fixed"  # optical axis along x
    half_width: float = 1e9  # of the picture in focal lengths: it sees whatever lies ahead
    min_range: float = 1 * FOOT  # nearer along the optical axis there is no measurement, m
    sigma_range: float = 1 * FOOT  # image noise is sigma_range / depth, m (4.68)
    sigma_angle: float = 0.0  # constant image noise beside it, dimensionless
    p_detect: float = 1.0  # chance that a target in view is measured; the first image is certain
    # filter; the exact posterior has no use for either
    q: float = 0.0  # process noise that the filter assumes, m^2/s (the target does not move)
    gate: float = 0.0  # innovations beyond so many standard deviations are left out; 0 for no gate
    # start
    start: Literal["drawn", "fixed"] = "drawn"  # whether the target's abscissa follows the prior
    prior_range: float = 80 * FOOT  # abscissa that the filter is told, m
    prior_deviation: float = 20 * FOOT  # its standard deviation, m
    target: tuple[float, float] = (100 * FOOT, 0.0)  # in N, m; the abscissa of a fixed start only
    velocity: tuple[float, float] = (10 * FOOT, 0.0)  # own, in N, m/s

    def __post_init__(self) -> None:
        validate(self)
        require(
            self,
            dt=self.dt > 0,
            t_f=self.t_f >= self.dt,
            s_x=self.s_x > 0,
            s_v=self.s_v >= 0,
            a_max=self.a_max > 0,
            success_radius=self.success_radius > 0,
            half_width=self.half_width > 0,
            min_range=self.min_range > 0,
            sigma_range=self.sigma_range > 0,
            sigma_angle=self.sigma_angle >= 0,
            p_detect=0 <= self.p_detect <= 1,
            q=self.q >= 0,
            gate=self.gate >= 0,
            prior_range=self.prior_range > grid.CUT * self.prior_deviation + self.min_range,
            prior_deviation=self.prior_deviation > 0,
            target=self.target[0] > self.min_range,
        )


# 4.4, with the process noise 0.1^2 ft^2/s of (4.70) and the gate that the published figures need.
# The target always lies where the vehicle would drift to without any control, so that a policy that
# remembers this (and any that does nothing) scores 0: this scenario reproduces the thesis and
# compares laws. It does not rank policies.
THESIS = Tracking2DConfig(
    estimator="ekf-thesis",
    a_max=1000 * FOOT,  # none that is ever reached
    min_range=0.1 * FOOT,
    q=0.01 * FOOT**2,
    gate=5.0,
    start="fixed",
)
SCENARIOS = {
    "random": Tracking2DConfig(),
    "thesis": THESIS,
    # `random` for policies with a memory of their own: the same episodes, but no filter in the row
    "raw": replace(Tracking2DConfig(), observation="raw"),
}

EKF_THESIS = code(Tracking2DConfig, "estimator", "ekf-thesis")
GRID = code(Tracking2DConfig, "estimator", "grid")
TRUTH = code(Tracking2DConfig, "estimator", "truth")
FIXED = code(Tracking2DConfig, "start", "fixed")

LANE = lane_dtype([
    ("r_T_N", "f8", (2,)),  # target, truth
    ("r_TV_N", "f8", (2,)),  # target relative to the vehicle, truth
    ("r_V_N", "f8", (2,)), ("v_V_N", "f8", (2,)),  # vehicle, known to itself
    ("a_V_N", "f8", (2,)),  # applied acceleration
    ("rhat_TV_N", "f8", (2,)), ("P", "f8", (2, 2)),  # estimate of r_TV_N
    ("chol", "f8", (3,)),  # rows of the lower Cholesky factor of P
    ("pixel", "f8"),  # last measured image point
    ("innovation", "f8"),
    ("seen", "f8"),  # 1 where the last image gave a measurement
    ("t_go", "f8"),
    ("cost_control", "f8"), ("cost_position", "f8"), ("cost_velocity", "f8"),
    ("total_cost", "f8"), ("control_cost", "f8"), ("terminal_cost", "f8"),
    ("miss_distance", "f8"), ("range_error_end", "f8"),
    ("nees", "f8"), ("nees_mean", "f8"),
    ("peak_acceleration", "f8"), ("integrated_acceleration", "f8"),
    ("posterior", grid.GRID),  # of the estimator "grid"
])  # fmt: skip

V_V_N = Field("v_V_N", 2, "m/s", "N", -50.0, 50.0, 5.0, "own velocity")
SEEN = Field("seen", 1, "", "", 0.0, 1.0, 1.0, "1 where the last image gave a measurement")
T_GO = Field("t_go", 1, "s", "", 0.0, 100.0, 10.0, "time to go")
BELIEF = Layout((
    Field("rhat_TV_N", 2, "m", "N", -100.0, 100.0, 25.0,
          "estimated position of the target relative to the vehicle"),
    Field("chol", 3, "m", "N", -50.0, 50.0, 5.0,
          "lower Cholesky factor of its covariance, row by row"),
    V_V_N,
    Field("innovation", 1, "", "C", -1.0, 1.0, 0.1,
          "last innovation of the image point, 0 without a measurement"),
    SEEN,
    T_GO,
))  # fmt: skip
RAW = Layout((
    Field("pixel", 1, "", "C", -1.0, 1.0, 0.1, "image point that was measured last"),
    SEEN,
    V_V_N,
    Field("r_V_N", 2, "m", "N", -100.0, 100.0, 25.0, "own position"),
    T_GO,
))  # fmt: skip
ACTION = Layout((
    Field("a_V_N", 2, "a_max", "N", -1.0, 1.0, 1.0,
          "commanded acceleration over the longest one"),
))  # fmt: skip

WORK = np.dtype([("filter", planar.SCRATCH), ("grid", grid.SCRATCH), ("u", "f8", (2,))])


@kernel
def step_lane(lane, action, cfg, work):
    """One step: act and move, sense and estimate, score."""
    fly(lane, action, cfg, work["u"])
    predict(lane["rhat_TV_N"], lane["P"], work["u"], cfg["q"] * cfg["dt"])
    estimate(lane, take_image(lane, cfg), cfg, work)
    score(lane, cfg, work["u"])


@kernel
def reset_lane(lane, cfg, work):
    """Start an episode from a zeroed record: place the target, tell the filter its prior, look.

    The first image is certain, because every filter starts from its direction. The abscissa is
    drawn from the prior, cut off at 3 standard deviations, so that the target is always ahead.
    """
    r = lane["r_T_N"]
    r[0], r[1] = cfg["target"][0], cfg["target"][1]
    if cfg["start"] != FIXED:
        n = normal(lane["seed"], lane["episode"], PLACE, 0, 0)
        r[0] = cfg["prior_range"] + cfg["prior_deviation"] * min(max(n, -grid.CUT), grid.CUT)
    for i in range(2):
        lane["r_TV_N"][i] = r[i]
        lane["v_V_N"][i] = cfg["velocity"][i]
    lane["t_go"] = cfg["t_f"]
    lane["seen"] = 1.0
    lane["pixel"] = image_point(lane, cfg)
    rhat, P, z = lane["rhat_TV_N"], lane["P"], lane["pixel"]
    if cfg["estimator"] == TRUTH:
        reveal(lane["r_TV_N"], rhat, P)
    elif cfg["estimator"] == GRID:
        grid.begin(lane["posterior"], z, lane["r_V_N"], cfg)
        grid.moments(lane["posterior"], lane["r_V_N"], rhat, P)
    elif cfg["estimator"] == EKF_THESIS:
        planar.begin_thesis(rhat, P, z, cfg)
    else:
        planar.begin(rhat, P, z, cfg)
    pack_lower(P, lane["chol"])
    factorise(lane["chol"], 2)


@kernel
def take_image(lane, cfg):
    """Measure the target's image point; False, and `pixel` untouched, where there is none."""
    X, Y = lane["r_TV_N"][0], lane["r_TV_N"][1]
    if not in_view(X, Y / X, 0.0, cfg["min_range"], cfg["half_width"]):
        return False
    if cfg["p_detect"] < 1.0 and (
        uniform(lane["seed"], lane["episode"], IMAGE, lane["step"], 1) >= cfg["p_detect"]
    ):
        return False
    lane["pixel"] = image_point(lane, cfg)
    return True


@kernel
def image_point(lane, cfg):
    """Image point of the target with its noise (4.68)."""
    X, Y = lane["r_TV_N"][0], lane["r_TV_N"][1]
    sd = math.sqrt(pixel_variance(X, cfg["sigma_range"], cfg["sigma_angle"]))
    return Y / X + sd * normal(lane["seed"], lane["episode"], IMAGE, lane["step"], 0)


@kernel
def estimate(lane, seen, cfg, work):
    """Give the image, or its absence, to the filter; factor its covariance for the row."""
    rhat, P, z = lane["rhat_TV_N"], lane["P"], lane["pixel"]
    lane["seen"] = 1.0 if seen else 0.0
    lane["innovation"] = 0.0
    if cfg["estimator"] == TRUTH:
        reveal(lane["r_TV_N"], rhat, P)
    elif cfg["estimator"] == GRID:
        if seen:
            lane["innovation"] = z - rhat[1] / max(rhat[0], cfg["min_range"])
        grid.update(lane["posterior"], seen, z, lane["r_V_N"], cfg, work["grid"])
        grid.moments(lane["posterior"], lane["r_V_N"], rhat, P)
    elif seen and cfg["estimator"] == EKF_THESIS:
        lane["innovation"] = planar.update_thesis(rhat, P, z, cfg, work["filter"])
    elif seen:
        lane["innovation"] = planar.update(rhat, P, z, cfg, work["filter"])
    pack_lower(P, lane["chol"])
    factorise(lane["chol"], 2)


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
    summary="reach a target in a plane whose range has to be earned by manoeuvring",
    scenarios=SCENARIOS,
    lane=LANE,
    observation=BELIEF,
    views={"belief": BELIEF, "raw": RAW},
    action=ACTION,
    costs=COSTS,
    metrics=METRICS,
    reset_lanes=reset_lanes,
    step_lanes=step_lanes,
    picture="visenvs.render.tracking2d:draw",
    aside="thesis",
    lost_above=200 * FOOT**2,
)
