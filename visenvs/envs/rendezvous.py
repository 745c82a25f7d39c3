"""Rendezvous: fly to a stationary target seen by one camera, and be there at a given time.

Thesis 4.2.3: cost (4.2) with the weights (4.36), measurement (2.6) with the noise (4.37).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from visenvs.core.compile import kernel
from visenvs.core.config import code, require, validate
from visenvs.core.frames import camera_towards, direction, identity
from visenvs.core.lanes import Task, lane_dtype
from visenvs.core.layout import Field, Layout
from visenvs.core.noise import normal, normal_pair, uniform_pair
from visenvs.core.outcome import RUNNING
from visenvs.core.units import FOOT
from visenvs.dynamics.point_mass import fly
from visenvs.envs._terminal import COSTS, METRICS, score
from visenvs.estimation.ekf import factorise, pack_lower
from visenvs.estimation.stationary import SCRATCH, predict, update
from visenvs.estimation.truth import reveal
from visenvs.sensors.camera import take_image

ENV_ID = "visenvs/Rendezvous-v0"

PLACE, IMAGE = 0, 1  # noise streams


@dataclass(frozen=True)
class RendezvousConfig:
    """Everything that defines a rendezvous, SI and radians."""

    estimator: Literal["ekf", "truth"] = "ekf"
    dt: float = 0.1  # control and camera period, s
    t_f: float = 20.0  # terminal time, s
    s_x: float = 100.0  # weight of the squared miss, 1/s^3 (4.36)
    s_v: float = 10.0  # weight of the squared terminal velocity, 1/s (4.36)
    a_max: float = 10 * FOOT  # length of the longest acceleration, m/s^2
    success_radius: float = 0.5  # a miss no larger counts as success, m
    # camera
    camera: Literal["fixed", "gimbal"] = "gimbal"  # optical axis north, or along the estimate
    half_width: float = 1.0  # of the square image in focal lengths: 1 sees 45 deg to each side
    min_range: float = 1 * FOOT  # nearer along the optical axis there is no measurement, m
    sigma_range: float = 1 * FOOT  # pixel noise is sigma_range / depth, m (4.37)
    sigma_angle: float = 0.0  # constant pixel noise beside it, dimensionless
    p_detect: float = 0.95  # chance that a target in view is measured
    # filter
    q: float = 0.0  # process noise that the filter assumes, m^2/s (the target does not move)
    # innovations beyond so many standard deviations are left out; 0 for no gate. There are no false
    # measurements here, and a gate that has once lost an over-estimated target never finds it again
    gate: float = 0.0
    # start
    start: Literal["drawn", "fixed"] = "drawn"
    range_drawn: tuple[float, float] = (60 * FOOT, 140 * FOOT)  # estimated range, m
    azimuth_drawn: float = math.radians(60.0)  # half width, rad
    elevation_drawn: float = math.radians(20.0)  # half width, rad
    range_error: float = 0.2  # standard deviation of the true range over the estimated one
    cross_error: float = 1 * FOOT  # standard deviation of the target across the line of sight, m
    speed_drawn: tuple[float, float] = (0.0, 15 * FOOT)  # own speed, m/s
    heading_drawn: float = math.radians(45.0)  # half width, of the velocity off the target, rad
    target: tuple[float, float, float] = (100 * FOOT, 20 * FOOT, 20 * FOOT)  # in N, m
    velocity: tuple[float, float, float] = (10 * FOOT, 2 * FOOT, 0.0)  # own, in N, m/s
    error: tuple[float, float, float] = (-20 * FOOT, -20 * FOOT, -20 * FOOT)  # estimate - truth, m
    prior_deviation: float = 20 * FOOT  # of the fixed start, each axis, m

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
            sigma_range=self.sigma_range >= 0 and self.sigma_range + self.sigma_angle > 0,
            sigma_angle=self.sigma_angle >= 0,
            p_detect=0 <= self.p_detect <= 1,
            q=self.q >= 0,
            gate=self.gate >= 0,
            range_drawn=0 < self.range_drawn[0] <= self.range_drawn[1],
            azimuth_drawn=0 <= self.azimuth_drawn <= math.pi,
            elevation_drawn=0 <= self.elevation_drawn < math.pi / 2,
            range_error=0 < self.range_error < 1 / 3,
            cross_error=self.cross_error > 0,
            speed_drawn=0 <= self.speed_drawn[0] <= self.speed_drawn[1],
            heading_drawn=0 <= self.heading_drawn <= math.pi,
            prior_deviation=self.prior_deviation > 0,
        )


# 4.2.3; what it leaves open (dt, L_c, guards, no limit) as in docs/misprints
THESIS = RendezvousConfig(
    a_max=1000 * FOOT,
    camera="fixed",
    half_width=1e9,  # 180 deg
    p_detect=1.0,
    start="fixed",
)
SCENARIOS = {
    "random": RendezvousConfig(),
    "thesis": THESIS,
    # the filter process noise that explains the published miss of 14.8 ft
    "thesis-q01": replace(THESIS, q=0.1 * FOOT**2),
}

TRUTH = code(RendezvousConfig, "estimator", "truth")
GIMBAL = code(RendezvousConfig, "camera", "gimbal")
FIXED = code(RendezvousConfig, "start", "fixed")

LANE = lane_dtype([
    ("r_T_N", "f8", (3,)),  # target, truth
    ("r_TV_N", "f8", (3,)),  # target relative to the vehicle, truth
    ("r_V_N", "f8", (3,)), ("v_V_N", "f8", (3,)),  # vehicle, known to itself
    ("a_V_N", "f8", (3,)),  # applied acceleration
    ("rhat_TV_N", "f8", (3,)), ("P", "f8", (3, 3)),  # estimate of r_TV_N
    ("chol", "f8", (6,)),  # rows of the lower Cholesky factor of P
    ("C_CN", "f8", (3, 3)),
    ("pixel", "f8", (2,)),  # last measured image point
    ("innovation", "f8", (2,)),
    ("seen", "f8"),  # 1 where the last image gave a measurement
    ("t_go", "f8"),
    ("cost_control", "f8"), ("cost_position", "f8"), ("cost_velocity", "f8"),
    ("total_cost", "f8"), ("control_cost", "f8"), ("terminal_cost", "f8"),
    ("miss_distance", "f8"), ("range_error_end", "f8"),
    ("nees", "f8"), ("nees_mean", "f8"),
    ("peak_acceleration", "f8"), ("integrated_acceleration", "f8"),
])  # fmt: skip

OBSERVATION = Layout((
    Field("rhat_TV_N", 3, "m", "N", -250.0, 250.0, 50.0,
          "estimated position of the target relative to the vehicle"),
    Field("chol", 6, "m", "N", -50.0, 50.0, 10.0,
          "lower Cholesky factor of its covariance, row by row"),
    Field("v_V_N", 3, "m/s", "N", -50.0, 50.0, 5.0, "own velocity"),
    Field("innovation", 2, "", "C", -1.0, 1.0, 0.2,
          "last innovation of the image point, 0 without a measurement"),
    Field("seen", 1, "", "", 0.0, 1.0, 1.0, "1 where the last image gave a measurement"),
    Field("t_go", 1, "s", "", 0.0, 100.0, 20.0, "time to go"),
))  # fmt: skip
ACTION = Layout((
    Field("a_V_N", 3, "a_max", "N", -1.0, 1.0, 1.0,
          "commanded acceleration over the longest one"),
))  # fmt: skip

WORK = np.dtype([("filter", SCRATCH), ("axes", "f8", (3, 3)), ("u", "f8", (3,))])


@kernel
def step_lane(lane, action, cfg, work):
    """One step: act and move, sense and estimate, score."""
    fly(lane, action, cfg, work["u"])
    predict(lane["rhat_TV_N"], lane["P"], work["u"], cfg["q"] * cfg["dt"])
    look(lane, cfg, work)
    score(lane, cfg, work["u"])


@kernel
def reset_lane(lane, cfg, work):
    """Start an episode from a zeroed record: place the target, tell the filter its prior, look."""
    if cfg["start"] == FIXED:
        place_fixed(lane, cfg)
    else:
        place_drawn(lane, cfg, work["axes"])
    for i in range(3):
        lane["r_TV_N"][i] = lane["r_T_N"][i]
    lane["t_go"] = cfg["t_f"]
    look(lane, cfg, work)


@kernel
def look(lane, cfg, work):
    """Point the camera, take an image, update the estimate, factor its covariance for the row."""
    rhat, P, C = lane["rhat_TV_N"], lane["P"], lane["C_CN"]
    lane["innovation"][:] = 0.0
    lane["seen"] = 0.0
    if cfg["estimator"] == TRUTH:
        reveal(lane["r_TV_N"], rhat, P)
    if cfg["camera"] == GIMBAL:
        camera_towards(rhat, C)
    else:
        identity(C)
    seed, episode, step, pixel = lane["seed"], lane["episode"], lane["step"], lane["pixel"]
    if take_image(C, lane["r_TV_N"], cfg, seed, episode, step, IMAGE, pixel):
        lane["seen"] = 1.0
        if cfg["estimator"] != TRUTH:
            update(rhat, P, C, pixel[0], pixel[1], cfg, lane["innovation"], work["filter"])
    pack_lower(P, lane["chol"])
    factorise(lane["chol"], 3)


@kernel
def place_fixed(lane, cfg):
    """The thesis's start: given target, velocity and estimation error (estimate - truth)."""
    for i in range(3):
        lane["r_T_N"][i] = cfg["target"][i]
        lane["v_V_N"][i] = cfg["velocity"][i]
        lane["rhat_TV_N"][i] = cfg["target"][i] + cfg["error"][i]
        lane["P"][i, i] = cfg["prior_deviation"] ** 2


@kernel
def place_drawn(lane, cfg, axes):
    """Draw the estimate, then the truth from exactly the prior that the filter is told.

    The range error is cut off at 3 standard deviations, so that the target is always ahead.
    """
    seed, episode = lane["seed"], lane["episode"]
    u_range, u_speed = uniform_pair(seed, episode, PLACE, 0, 0)
    u_azimuth, u_elevation = uniform_pair(seed, episode, PLACE, 0, 1)
    u_heading, _ = uniform_pair(seed, episode, PLACE, 0, 2)
    n_right, n_down = normal_pair(seed, episode, PLACE, 0, 3)
    n_range = min(max(normal(seed, episode, PLACE, 0, 4), -3.0), 3.0)
    azimuth = (2.0 * u_azimuth - 1.0) * cfg["azimuth_drawn"]
    elevation = (2.0 * u_elevation - 1.0) * cfg["elevation_drawn"]
    heading = azimuth + (2.0 * u_heading - 1.0) * cfg["heading_drawn"]
    length = between(cfg["range_drawn"], u_range)
    speed = between(cfg["speed_drawn"], u_speed)
    sight, ahead = direction(azimuth, elevation), direction(heading, elevation)
    along, cross = cfg["range_error"] * length, cfg["cross_error"]
    for i in range(3):
        lane["rhat_TV_N"][i] = length * sight[i]
        lane["v_V_N"][i] = speed * ahead[i]
    camera_towards(lane["rhat_TV_N"], axes)
    for i in range(3):
        shift = along * n_range * axes[0, i] + cross * (n_right * axes[1, i] + n_down * axes[2, i])
        lane["r_T_N"][i] = lane["rhat_TV_N"][i] + shift
        for j in range(3):
            lane["P"][i, j] = (along * along - cross * cross) * axes[0, i] * axes[0, j]
        lane["P"][i, i] += cross * cross


@kernel
def between(bounds, u):
    """The point a fraction `u` of the way through an interval."""
    return bounds[0] + u * (bounds[1] - bounds[0])


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
    summary="fly to a stationary target seen by one camera, and be there on time",
    scenarios=SCENARIOS,
    lane=LANE,
    observation=OBSERVATION,
    action=ACTION,
    costs=COSTS,
    metrics=METRICS,
    reset_lanes=reset_lanes,
    step_lanes=step_lanes,
    picture="visenvs.render.rendezvous:draw",
)
