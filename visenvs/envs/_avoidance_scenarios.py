"""The published scenes of obstacle avoidance, and the drawn ones, by name."""

from __future__ import annotations

import math
from dataclasses import replace

from visenvs.core.units import FOOT
from visenvs.envs._avoidance_config import AvoidanceConfig, feet, six

# 3.5.1; the time step, the latch's t_min and the limits that the thesis does not state as they
# reproduce its figures. Both estimates start 5 ft off on every axis, obstacle 1 nearer, 2 farther
THESIS = AvoidanceConfig(
    estimator="ekf",
    dt=0.01,
    a_max=1000 * FOOT,  # none that is ever reached
    velocity=(10 * FOOT, 0.0, 0.0),
    waypoint=(80 * FOOT, 0.0, 0.0),
    success_radius=0.1 * FOOT,
    t_critical=5.0,
    t_min=0.1,
    half_width=1e9,  # 180 deg
    min_range=1 * FOOT,
    sigma_angle=0.1,
    p_detect=1.0,
    p_false=0.0,
    ztest_max=0.0,
    delete_after=0,
    q=0.1**2 * FOOT**2,
    prior="told",
    prior_deviation=1 * FOOT,
    scene="fixed",
    obstacles=2,
    obstacle_x=feet(20, 50),
    obstacle_y=feet(-5, 5),
    obstacle_z=feet(5, -5),
    radius=feet(10, 10),
    error_x=feet(-5, 5),
    error_y=feet(-5, 5),
    error_z=feet(-5, 5),
)
# 3.5.2 as a point mass: the flight from the starting point, one obstacle an image, five times the
# true image noise in the filter. That half of the picture is 25 deg follows from when the thesis
# loses sight of the obstacles; the limit of 1 g is the helicopter's
SIMULATION = replace(
    THESIS,
    dt=0.02,
    a_max=32.2 * FOOT,
    velocity=(50 * FOOT, 0.0, 0.0),
    waypoint=(1600 * FOOT, 0.0, 0.0),
    success_radius=1.0,
    t_critical=4.0,
    t_min=0.25,
    image_every=6,  # 0.12 s
    report="nearest",
    half_width=math.tan(math.radians(25.0)),
    ball=0.2,  # red spheres of 20 ft
    sigma_angle=0.01,
    association="ztest",
    ztest_max=3.0,
    assumed_noise=10.0,
    prior_covariance="thesis",
    prior="fixed",
    prior_first=300 * FOOT,
    prior_later=800 * FOOT,
    prior_deviation=50 * FOOT,
    obstacle_x=feet(400, 1000),
    obstacle_y=feet(50, 0),
    obstacle_z=feet(-20, 0),
    radius=feet(100, 100),
)
# 3.6 with x along the flight from X_0 to X_wp, 632.5 ft: the balloon passes 300 ft ahead, right of
# the line and 50 ft below
BALLOON = replace(
    SIMULATION,
    velocity=(20 * FOOT, 0.0, 0.0),
    waypoint=(math.hypot(200, 600) * FOOT, 0.0, 0.0),
    t_critical=10.0,
    image_every=10,  # 5 Hz
    report="all",
    half_width=math.tan(math.radians(35.0)),
    sigma_angle=0.02,
    assumed_noise=5.0,
    prior_first=400 * FOOT,
    prior_later=400 * FOOT,
    obstacles=1,
    obstacle_x=feet((50 * 200 + 300 * 600) / math.hypot(200, 600)),
    obstacle_y=feet((300 * 200 - 50 * 600) / math.hypot(200, 600)),
    obstacle_z=feet(50),
    radius=feet(100),
)
# IISc chapter 5. The report does not give the geometry: distance, radius, time step, limit and
# placement are those that reproduce its tables
IISC = AvoidanceConfig(
    estimator="spherical",
    dt=0.1,
    a_max=15.0,
    velocity=(12.5, 0.0, 0.0),
    velocity_drawn=(7.5, 5.0, 5.0),
    waypoint=(800.0, 0.0, 0.0),
    goal="seen",
    pre_run=10.0,
    success_radius=10.0,
    sensor="angles",
    half_width=math.radians(60.0),
    min_range=1.0,
    sigma_angle=0.2 * math.radians(120.0) / 3.0,  # (3.25)-(3.26)
    fade=0.99,
    p_detect=1.0,
    p_false=0.0,
    ztest_max=0.0,
    delete_after=0,
    reinit="literal",
    smoothing="literal",
    prior="uniform",
    range_error=0.5,
    prior_deviation=400.0,
    scene="fixed",
    obstacles=1,
    obstacle_x=six(400),
    radius=six(60),
    spread_x=six(120),
    spread_yz=six(12),
)
SCENARIOS = {
    "random": AvoidanceConfig(),
    "quadrotor": AvoidanceConfig(dynamics="quadrotor"),  # tilts, and the camera with it
    "moving": AvoidanceConfig(estimator="ekf-moving", drift=1.0),
    # future work of the thesis (5.2.3): the vehicle may slow down, and time costs. Its speed grows
    # threefold on the way, so that what is 10 s ahead at first matters
    "minimum-time": AvoidanceConfig(lateral=0, s_time=20.0, t_critical=10.0),
    "thesis-3.5.1": THESIS,
    "thesis-3.5.2": SIMULATION,
    "balloon": BALLOON,
    # 4.2.4: every relative position is overestimated by half
    "thesis-4.2.4": replace(
        THESIS,
        dt=0.1,
        velocity=(10 * FOOT, 2 * FOOT, 2 * FOOT),
        waypoint=(100 * FOOT, 20 * FOOT, 20 * FOOT),
        s_v=10.0,
        sigma_range=1 * FOOT,
        sigma_angle=0.0,
        q=0.0,
        prior_deviation=20 * FOOT,
        obstacle_x=feet(30, 60),
        obstacle_y=feet(6, 20),
        obstacle_z=feet(6, 15),
        error_x=feet(15, 30),
        error_y=feet(3, 10),
        error_z=feet(3, 7.5),
    ),
    "iisc-1": IISC,
    "iisc-2": replace(
        IISC,
        obstacles=2,
        obstacle_x=six(400, 680),
        radius=six(60, 60),
        spread_x=six(80, 40),
        spread_yz=six(12, 12),
    ),
}
