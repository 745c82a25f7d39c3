"""What defines a herding task: its settings, what is refused, and the scenarios."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from visenvs.core.config import code, require, validate
from visenvs.dynamics.attitude_loop import require_stable
from visenvs.dynamics.ground_robot import OBSTACLES, ROBOTS
from visenvs.sensors.ground_camera import WIDTH as PIXELS

SUBSTEPS = 10  # of the attitude loop in a tick, at most
NOISE_FIRMWARE = math.degrees(0.064 / 0.258 * 0.85)  # wheels at +-0.032 m/s, 0.258 m apart


@dataclass(frozen=True)
class HerdingConfig:
    """Everything that defines a herding task, SI and radians. FW: the official firmware."""

    estimator: Literal["camera", "truth"] = "camera"
    perception: Literal["points", "images"] = "points"  # how pictures become findings
    navigation: Literal["truth", "vio"] = "truth"  # where its own place comes from
    observation: Literal["belief", "pixels"] = "belief"
    frame: int = 96  # side of the pictures observed, pixels
    arena: Literal["pymunk", "kinematic"] = "pymunk"  # who settles contacts
    action_mode: Literal["options", "velocity"] = "options"
    dt: float = 0.5  # from one decision to the next while an aircraft is free, s
    dynamics: Literal["point_mass", "quadrotor"] = "point_mass"  # of the aircraft
    tick: float = 0.05  # step of the simulation, s
    t_f: float = 600.0  # end of the mission, s
    aircraft: int = 1  # that share the arena
    landing: Literal["pid", "ddp"] = "pid"  # in front of a robot; ddp: planned anew every tick
    # rules: every disagreement of the sources is a setting
    side: float = 20.0  # of the arena, m; the goal line is its north side
    robots: int = 10
    obstacles: int = 4
    goal_count: int = 7  # for success; 4 in the rules of 2018
    count_only_touched: Literal["no", "yes"] = "no"  # yes: an accidental crossing is no goal
    crossing: Literal["centre", "whole", "margin"] = "centre"  # over the line, + radius, + 0.5 m
    services: Literal["block", "block-tap"] = "block-tap"  # landing in front; and touching the top
    pole_limit: int = 0  # so many contacts with poles end the run; 0 for no limit
    bump_restarts_timer: int = 0  # 1: a bump restarts the 20 s clock, which FW does not
    # ground robots
    speed: float = 0.33  # m/s (FW)
    robot_radius: float = 0.175  # m
    start_circle: float = 1.0  # radius on which they start, heading outward, m
    obstacle_circle: float = 5.0  # radius that the obstacles drive on, m
    period: float = 20.0  # from one reversal to the next, s (FW)
    spin_time: float = 2.456  # of half a turn, s (FW, Create 1)
    noise_every: float = 5.0  # from one swerve to the next, s (FW)
    noise_time: float = 0.85  # of a swerve, s (FW)
    noise_max: float = math.radians(NOISE_FIRMWARE)  # largest swerve, rad: 12.1, 15 or 20 degrees
    # aircraft
    v_max: float = 2.13  # m/s (IARC section V)
    a_max: float = 3.05  # m/s^2 (IARC section V)
    bandwidth: float = 20.0  # of a quadrotor's attitude loop, rad/s,
    damping: float = 0.8  # its damping ratio,
    rate_max: float = 6.0  # its largest turn rate about each axis, rad/s,
    substeps: int = 5  # and its steps in a tick, as many as its IMU has samples
    cruise: float = 3.0  # height, m
    v_descent: float = 1.0  # m/s
    v_climb: float = 1.0  # m/s
    dwell: float = 0.5  # shortest stay on the ground, s
    patience: float = 1.5  # longest wait there for a bump beyond that, s
    aircraft_radius: float = 0.25  # m
    solid_height: float = 0.15  # below it the aircraft is in the robots' way, m
    top_height: float = 0.15  # at which the aircraft touches a robot's top, m
    tap_radius: float = 0.1  # largest offset at which a touch is felt, m
    landing_sigma: float = 0.0  # standard deviation of where it comes down, each axis, m
    # camera, looking straight down, 320 x 240 pixels with the long side east and west
    fov: float = math.radians(90.0)  # full angle across the long side, rad
    sigma_pixel: float = 2.0  # noise of a detection, each axis, pixels
    camera_every: float = 0.1  # s
    p_detect: float = 0.9  # chance that a robot in view is detected
    false_detections: float = 0.05  # mean number in a picture
    # score, in thousands of points
    score_goal: float = 2.0  # a robot over the goal line
    score_lost: float = 1.0  # what a robot over another line costs
    score_minute: float = 0.1  # what a minute costs

    def __post_init__(self) -> None:
        validate(self)
        every, ticks = self.dt / self.tick, self.camera_every / self.tick
        require(
            self,
            tick=self.tick > 0,
            dt=every >= 1 and abs(every - round(every)) < 1e-6,
            camera_every=ticks >= 1 and abs(ticks - round(ticks)) < 1e-6,
            frame=16 <= self.frame <= 512,
            t_f=self.t_f >= self.dt,
            aircraft=1 <= self.aircraft <= 4,
            side=self.side > 0,
            robots=1 <= self.robots <= ROBOTS,
            obstacles=0 <= self.obstacles <= OBSTACLES,
            goal_count=1 <= self.goal_count <= self.robots,
            pole_limit=self.pole_limit >= 0,
            bump_restarts_timer=self.bump_restarts_timer in (0, 1),
            speed=self.speed > 0,
            robot_radius=self.robot_radius > 0,
            obstacle_circle=0 < self.obstacle_circle < 0.5 * self.side,
            spin_time=self.spin_time > 0,
            period=self.period > self.spin_time,
            noise_time=self.noise_time > 0,
            noise_every=self.noise_every > self.noise_time,
            noise_max=0 <= self.noise_max <= math.pi,
            v_max=self.v_max > 0,
            a_max=self.a_max > 0,
            bandwidth=self.bandwidth > 0,
            damping=self.damping > 0,
            rate_max=self.rate_max > 0,
            substeps=1 <= self.substeps <= SUBSTEPS,
            cruise=self.cruise > self.solid_height,
            v_descent=self.v_descent > 0,
            v_climb=self.v_climb > 0,
            dwell=self.dwell >= 0,
            patience=self.patience >= 0,
            aircraft_radius=self.aircraft_radius > 0,
            solid_height=self.solid_height > 0,
            top_height=self.top_height >= self.solid_height,
            tap_radius=self.tap_radius > 0,
            landing_sigma=self.landing_sigma >= 0,
            fov=0 < self.fov < math.pi,
            sigma_pixel=self.sigma_pixel > 0,
            p_detect=0 <= self.p_detect <= 1,
            false_detections=self.false_detections >= 0,
            score_goal=self.score_goal >= 0,
            score_lost=self.score_lost >= 0,
            score_minute=self.score_minute >= 0,
        )
        self._require_room()
        if self.dynamics == "quadrotor":
            require_stable(self, self.tick)
        if "images" in self.perception or "pixels" in self.observation:
            _require_camera(self)
        if self.navigation == "vio" and (self.perception, self.estimator) != ("images", "camera"):
            raise ValueError(
                f"HerdingConfig.navigation='vio' with perception={self.perception!r}, "
                f"estimator={self.estimator!r}: its landmarks are corners of rendered pictures; "
                "write `navigation='vio', perception='images', estimator='camera'`"
            )

    def _require_room(self) -> None:
        """Refuse a start at which robots overlap each other, an obstacle or a line."""
        circle, size, n = self.start_circle, 2.0 * self.robot_radius, self.robots
        least = size / (2.0 * math.sin(math.pi / n)) if n > 1 else 0.0
        most = 0.5 * self.side - self.robot_radius
        if self.obstacles:
            most = min(most, self.obstacle_circle - size)
        if not least <= circle <= most:
            raise ValueError(
                f"HerdingConfig.start_circle: {n} robots of radius {self.robot_radius:g} m need a "
                f"circle from {least:.3g} to {most:.3g} m to start apart from each other, from the "
                f"obstacles and inside the lines, got {circle:g}; "
                f"write start_circle={min(max(least, 1.0), most):.3g}"
            )


def _require_camera(config: HerdingConfig) -> None:
    """Raise a ValueError for what no rendered picture can show."""
    from visenvs.sensors.images.arena import SIDE
    from visenvs.sensors.images.haar import LEAST_SIZE
    from visenvs.sensors.images.robots import HEIGHT
    from visenvs.sensors.images.scenes import WINDOW

    if config.side != SIDE:
        raise ValueError(
            f"HerdingConfig.side={config.side:g}: rendered pictures are of an arena of {SIDE:g} m; "
            f"write `side={SIDE}`"
        )
    half = 0.5 * PIXELS * WINDOW / (LEAST_SIZE * (config.cruise - HEIGHT))
    if config.perception == "images" and math.tan(0.5 * config.fov) > half:
        raise ValueError(
            f"HerdingConfig.fov={config.fov:.3g}, cruise={config.cruise:g}: a robot is found from "
            f"{LEAST_SIZE:.0f} pixels on, {PIXELS:.0f} across; "
            f"write `fov={math.floor(200.0 * math.atan(half)) / 100.0}` or fly lower"
        )


# the mission as its official firmware runs it; how the paper's figure can be reached: robots are
# only blocked, a bump restarts their clock, and landings are from 2 m; the mission seen from 2 m
SCENARIOS = {
    "firmware": HerdingConfig(),
    "paper": HerdingConfig(cruise=2.0, bump_restarts_timer=1, services="block"),
    "firmware-hard": HerdingConfig(cruise=2.0),
}

TRUTH = code(HerdingConfig, "estimator", "truth")
IMAGES = code(HerdingConfig, "perception", "images")
VIO = code(HerdingConfig, "navigation", "vio")
BY_PLAN = code(HerdingConfig, "landing", "ddp")
KINEMATIC = code(HerdingConfig, "arena", "kinematic")
QUADROTOR = code(HerdingConfig, "dynamics", "quadrotor")
VELOCITY = code(HerdingConfig, "action_mode", "velocity")
BLOCK_ONLY = code(HerdingConfig, "services", "block")
TOUCHED_ONLY = code(HerdingConfig, "count_only_touched", "yes")
WHOLE = code(HerdingConfig, "crossing", "whole")
MARGIN = code(HerdingConfig, "crossing", "margin")
