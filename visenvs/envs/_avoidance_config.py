"""What defines an avoidance task: its settings, and what is refused."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from visenvs.core.config import code, require, validate
from visenvs.core.units import FOOT
from visenvs.dynamics.attitude_loop import require_stable

K = 6  # obstacles that a scene, and tracks that a row, can hold
Six = tuple[float, float, float, float, float, float]
CUT = 2.2  # standard deviations, where all draws of the scene are cut off
PAST = 32  # steps that a vehicle remembers of its way
RINGS, SPOKES = 24, 72  # grid on which a plane is searched for a way through


def six(*values: float, unit: float = 1.0) -> Six:
    """Up to six numbers, one for each obstacle, in SI, filled up with zeros."""
    a, b, c, d, e, f = (*(unit * value for value in values), *[0.0] * (K - len(values)))
    return a, b, c, d, e, f


ZEROS = six()


def feet(*values: float) -> Six:
    """Up to six lengths in feet as metres, filled up with zeros."""
    return six(*values, unit=FOOT)


@dataclass(frozen=True)
class AvoidanceConfig:
    """Everything that defines an avoidance task, SI and radians."""

    # a filter for each obstacle: Cartesian, by inverse range, the IISc report's, or Cartesian with
    # a velocity, the only one that does not take them to stand still
    estimator: Literal["ekf", "inverse-ekf", "inverse-ukf", "spherical", "ekf-moving", "truth"] = (
        "inverse-ukf"
    )
    # what the filters believe; `told` adds the true places of the obstacles, as no camera could;
    # `cones` adds what follows from the belief for the way ahead: passages and aiming points;
    # `pixels` is the camera's picture and the one of `frame_before` and nothing else, with a green
    # beacon at the waypoint
    observation: Literal["belief", "told", "cones", "pixels"] = "belief"
    # sightings are drawn about the truth, or found in rendered pictures of red balls, which have
    # no labels: with images the z-test associates, and p_detect, p_false and sigma tell nothing of
    # the camera
    perception: Literal["points", "images"] = "points"
    dt: float = 0.05  # control period, s
    lateral: int = 1  # 1: constant speed along x, a_x is ignored; 0: all three axes
    a_max: float = 10.0  # length of the longest acceleration, m/s^2
    # how the vehicle obeys an acceleration: at once; or by tilting, and the camera with it, from
    # level and at rest at the start, and never with less thrust than a fifth of its weight
    dynamics: Literal["point_mass", "quadrotor"] = "point_mass"
    bandwidth: float = 12.0  # of the quadrotor's attitude loop, which is of second order, rad/s
    damping: float = 1.0  # of it, over the critical one
    rate_max: float = 6.0  # its largest body rate about each axis, rad/s
    substeps: int = 5  # parts of a step in which it is integrated
    velocity: tuple[float, float, float] = (10.0, 0.0, 0.0)  # at the start, in N, m/s
    # half width of a uniform draw about it, m/s
    velocity_drawn: tuple[float, float, float] = (0.0, 0.0, 0.0)
    waypoint: tuple[float, float, float] = (200.0, 0.0, 0.0)  # from the start, in N, m
    goal: Literal["known", "seen"] = "known"  # or estimated as an obstacle is
    pre_run: float = 0.0  # for so long nothing but the filter works, s (IISc 3.3.5)
    patience: float = 3.0  # the flight is cut off after so many times its time at constant speed
    success_radius: float = 1.0  # a miss no larger counts as success, m
    margin: float = 0.1  # of the radius: deeper inside is a collision, farther outside diverges
    # cost
    s_x: float = 100.0  # weight of the squared miss, 1/s^3
    s_violation: float = 100.0  # weight of the squared depth inside a sphere, 1/s^3
    s_divergence: float = 1.0  # weight of the squared distance flown too wide, 1/s^3
    s_time: float = 0.0  # weight of the time flown, m^2/s^4; only where lateral = 0
    # what the laws are told; the task itself does not use it
    s_v: float = 0.0  # weight of the squared terminal velocity, 1/s
    t_critical: float = 5.0  # an obstacle further away in time is not critical yet, s (3.23)
    t_min: float = 0.25  # an aiming point closer in time is dropped, s
    # camera; `angles` is IISc's
    # optical axis forward of the body: along x for a point mass and while a quadrotor is level
    camera: Literal["fixed"] = "fixed"
    sensor: Literal["image", "angles"] = "image"  # what a sighting is: an image point, two angles
    image_every: int = 1  # steps from one image to the next
    report: Literal["all", "nearest"] = "all"  # what the image processor tells of those in view
    half_width: float = 1.0  # of the square picture, focal lengths (1 is 45 deg), or rad
    min_range: float = 0.5  # nearer (along the optical axis) there is no sighting, m
    ball: float = 0.5  # radius of what is seen over that of the safety sphere
    picture: int = 256  # side of a picture that detectors read, pixels
    frame: int = 48  # and of one that is the observation: small, for small networks
    frame_before: float = 0.6  # age of the other one that is: what moves tells the speed, s
    sigma_range: float = 0.0  # noise of an image point is sigma_range / depth, m
    sigma_angle: float = 0.01  # constant noise beside it; of angles: far away, rad
    fade: float = 0.0  # of angles, per metre: their noise is sigma_angle (1 - fade^range)
    p_detect: float = 0.9  # chance that an obstacle in view is sighted
    p_false: float = 0.05  # chance of a false sighting, uniform over the picture
    # filter
    # `known`: the image processor tells obstacles apart, and takes what is false for one of them
    association: Literal["ztest", "known"] = "known"
    ztest_max: float = 16.0  # sightings of a larger z-test value are no track's; 0 for no test
    delete_after: int = 5  # images in which a track in view may be missed; 0 for ever
    assumed_noise: float = 1.0  # noise that the filter assumes over the true one
    q: float = 0.0  # process noise that "ekf" assumes, m^2/s (obstacles do not move)
    q_range: float = 0.2  # and "spherical": of the range, m^2/s (IISc (3.45))
    q_angle: float = 0.025  # and of the angles, rad^2/s
    reinit: Literal["none", "literal", "inertial"] = "none"  # of "spherical" after the pre-run
    smoothing: Literal["none", "literal", "inertial"] = "none"  # of "spherical", ten estimates
    prior_covariance: Literal["full", "thesis"] = "full"  # of "ekf"; `thesis` is (3.35)
    # what is told of the distance of a new track: before the start; a draw about the true one whose
    # relative error has the standard deviation range_error (`size`) or is uniform within it; prior
    prior: Literal["size", "uniform", "fixed", "told"] = "size"
    range_error: float = 0.2
    prior_first: float = 100.0  # distance of the first track, m
    prior_later: float = 100.0  # of the others, m
    prior_deviation: float = 1.0  # of a prior that is fixed, or told (each axis), or spherical, m
    # scene
    scene: Literal["drawn", "fixed"] = "drawn"
    obstacles: int = K  # a fixed scene has so many, a drawn one at most so many
    radius_drawn: tuple[float, float] = (5.0, 12.0)  # of the safety spheres, m
    along_drawn: tuple[float, float] = (40.0, 170.0)  # of the centres along x, m
    offset: float = 0.7  # of the radius: how far a centre may lie off the straight line
    # standard deviation of drawn obstacles' velocity, each axis, m/s; they are placed to block the
    # way when the vehicle comes by, and "ekf-moving" is told
    drift: float = 0.0
    obstacle_x: Six = ZEROS  # centres of the fixed scene in N, m
    obstacle_y: Six = ZEROS
    obstacle_z: Six = ZEROS
    radius: Six = ZEROS  # of their safety spheres, m
    spread_x: Six = ZEROS  # half width of a uniform draw about the centre along x, m
    spread_yz: Six = ZEROS  # radius of the disc across x in which it is drawn, m
    error_x: Six = ZEROS  # estimate - truth of a prior that is told, m
    error_y: Six = ZEROS
    error_z: Six = ZEROS

    def __post_init__(self) -> None:
        validate(self)
        require(
            self,
            dt=self.dt > 0,
            lateral=self.lateral in (0, 1),
            a_max=self.a_max > 0,
            bandwidth=self.bandwidth > 0,
            damping=self.damping > 0,
            rate_max=self.rate_max > 0,
            substeps=self.substeps >= 1,
            velocity_drawn=min(self.velocity_drawn) >= 0,
            pre_run=self.pre_run >= 0,
            patience=self.patience >= 1,
            success_radius=self.success_radius > 0,
            margin=0 <= self.margin < 1,
            s_x=self.s_x > 0,
            s_violation=self.s_violation >= 0,
            s_divergence=self.s_divergence >= 0,
            s_time=self.s_time == 0 or (self.s_time > 0 and self.lateral == 0),
            s_v=self.s_v >= 0,
            t_critical=self.t_critical > 0,
            t_min=self.t_min >= 0,
            image_every=self.image_every >= 1,
            half_width=self.half_width > 0,
            min_range=self.min_range > 0,
            ball=0 < self.ball <= 1,
            picture=32 <= self.picture <= 2048,
            frame=36 <= self.frame <= 512,
            frame_before=self.frame_before >= 0,
            sigma_range=self.sigma_range >= 0 and self.sigma_range + self.sigma_angle > 0,
            sigma_angle=self.sigma_angle >= 0,
            fade=0 <= self.fade < 1,
            p_detect=0 <= self.p_detect <= 1,
            p_false=0 <= self.p_false <= 1,
            association=self.association == "known" or self.goal == "known",
            ztest_max=self.ztest_max > 0 or (self.ztest_max == 0 and self.association == "known"),
            delete_after=self.delete_after >= 0,
            assumed_noise=self.assumed_noise > 0,
            q=self.q >= 0,
            q_range=self.q_range >= 0,
            q_angle=self.q_angle >= 0,
            range_error=0 < self.range_error < (0.3 if self.prior == "size" else 1.0),
            prior_first=self.prior_first > 0,
            prior_later=self.prior_later > 0,
            prior_deviation=self.prior_deviation > 0,
            radius_drawn=0 < self.radius_drawn[0] <= self.radius_drawn[1],
            offset=0 <= self.offset < 1,
            drift=self.drift == 0 or (self.drift > 0 and self.scene == "drawn"),
            spread_x=min(self.spread_x) >= 0,
            spread_yz=min(self.spread_yz) >= 0,
        )
        require_scene(self)
        if self.dynamics == "quadrotor":
            require_stable(self, self.dt)
        if "images" in self.perception or "pixels" in self.observation:
            require_camera(self)
        if self.observation == "pixels":
            require_past(self)


def require_camera(config: AvoidanceConfig) -> None:
    """Raise a ValueError for what no rendered picture can show."""
    if config.half_width > 2.0 or config.sensor != "image" or config.goal != "known":
        raise ValueError(
            f"half_width={config.half_width:g}, sensor={config.sensor!r}, goal={config.goal!r}: "
            "rendered pictures are of one plane, give image points, and do not show an unknown "
            "waypoint; write `half_width=1.0, sensor='image', goal='known'`"
        )


def require_past(config: AvoidanceConfig) -> None:
    """Raise a ValueError for a picture from before the vehicle remembers."""
    if round(config.frame_before / config.dt) >= PAST:
        most = (PAST - 1) * config.dt
        raise ValueError(
            f"frame_before={config.frame_before:g}: a vehicle remembers {PAST - 1} steps of its "
            f"way; write `frame_before={most:g}`"
        )


def require_scene(config: AvoidanceConfig) -> None:
    """Raise a ValueError that says what no vehicle could fly, with a line to write instead."""
    if not 1 <= config.obstacles <= K:
        raise ValueError(
            f"obstacles={config.obstacles}: a row holds 1 to {K} tracks; write `obstacles={K}`"
        )
    if not config.velocity[0] > config.velocity_drawn[0] or not config.waypoint[0] > 0:
        raise ValueError(
            f"velocity={config.velocity}, waypoint={config.waypoint}: the vehicle must fly towards "
            "a waypoint ahead; write `velocity=(10.0, 0.0, 0.0), waypoint=(200.0, 0.0, 0.0)`"
        )
    if config.scene == "drawn":
        _require_drawn(config)
    else:
        _require_fixed(config)


def _require_drawn(config: AvoidanceConfig) -> None:
    (near, far), largest = config.along_drawn, config.radius_drawn[1]
    if CUT * config.drift >= config.velocity[0]:
        raise ValueError(
            f"drift={config.drift:g}: an obstacle could be as fast as the vehicle; write at most "
            f"`drift={config.velocity[0] / CUT / 2:g}`"
        )
    # spheres that come to meet the vehicle are nearer at its start, those ahead of it at its end
    room = largest / (1.0 - CUT * config.drift / config.velocity[0])
    if not room < near <= far < config.waypoint[0] - room:
        raise ValueError(
            f"along_drawn={config.along_drawn}: a sphere of radius {largest:g} m could hold the "
            f"start or the waypoint; write `along_drawn=({math.ceil(room)}, "
            f"{math.floor(config.waypoint[0] - room)})` or a smaller `radius_drawn`"
        )
    fastest, edge = config.velocity[0] + config.velocity_drawn[0], (1 + config.offset) * largest
    reach = 0.5 * config.a_max * ((near - largest) / fastest) ** 2
    if config.lateral and reach <= edge:
        raise ValueError(
            f"a_max={config.a_max:g}: the first sphere could close every way (reach {reach:.1f} m, "
            f"its edge up to {edge:.1f} m); write a larger `a_max` or `along_drawn`"
        )


def _require_fixed(config: AvoidanceConfig) -> None:
    n = config.obstacles
    centres = np.stack([config.obstacle_x, config.obstacle_y, config.obstacle_z], axis=1)[:n]
    radii = np.array(config.radius)[:n]
    if not (radii > 0).all():
        raise ValueError(
            f"radius={config.radius}: the first {n} must be positive; write `obstacles=...` "
            "for fewer"
        )
    reach = radii + np.hypot(config.spread_x, config.spread_yz)[:n]
    for name, point in (("start", np.zeros(3)), ("waypoint", np.array(config.waypoint))):
        inside = np.flatnonzero(np.linalg.norm(centres - point, axis=1) <= reach)
        if len(inside):
            i = int(inside[0])
            raise ValueError(
                f"the {name} {point.tolist()} lies inside the safety sphere of obstacle {i}, "
                f"centre {centres[i].tolist()}, radius {radii[i]:g} m; move the obstacle or "
                "write a smaller `radius`"
            )
    blocked = closed_planes(config, centres, radii) if config.lateral else []
    if blocked:
        raise ValueError(
            f"the spheres close every way at x = {blocked[0]:g} m: with a_max={config.a_max:g} "
            "m/s^2 the vehicle reaches no point outside them; write a smaller `radius` or a "
            "larger `a_max`"
        )


def closed_planes(config: Any, centres: Any, radii: Any) -> list[float]:
    """Abscissae of obstacles (m) where each point that the vehicle can reach is inside a sphere.

    The vehicle keeps its speed along x and accelerates across it by at most a_max. A grid of points
    is tried, so that a gap narrower than a 24th of the reach may be overlooked.

    Args:
        config: with velocity, waypoint, a_max.
        centres, radii: of the spheres, (n, 3) and (n,), m.
    """
    U, V, W = config.velocity
    turn = np.linspace(0.0, 2.0 * math.pi, SPOKES, endpoint=False)
    spokes = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    disc = (np.linspace(0.0, 1.0, RINGS)[:, None, None] * spokes).reshape(-1, 2)
    closed: list[float] = []
    for x in centres[:, 0]:
        t = x / U
        points = np.array([V * t, W * t]) + 0.5 * config.a_max * t * t * disc
        across = np.linalg.norm(points[:, None] - centres[:, 1:], axis=2)
        inside = across**2 + (x - centres[:, 0]) ** 2 < radii**2
        if 0.0 < x < config.waypoint[0] and inside.any(axis=1).all():
            closed.append(float(x))
    return closed


MOVING = code(AvoidanceConfig, "estimator", "ekf-moving")
QUADROTOR = code(AvoidanceConfig, "dynamics", "quadrotor")
TRUTH = code(AvoidanceConfig, "estimator", "truth")
FIXED = code(AvoidanceConfig, "scene", "fixed")
IMAGES = code(AvoidanceConfig, "perception", "images")
SEEN = code(AvoidanceConfig, "goal", "seen")
NEAREST = code(AvoidanceConfig, "report", "nearest")
CONES = code(AvoidanceConfig, "observation", "cones")
KNOWN = code(AvoidanceConfig, "association", "known")
SIZE, UNIFORM, GIVEN, TOLD = (
    code(AvoidanceConfig, "prior", choice) for choice in ("size", "uniform", "fixed", "told")
)
