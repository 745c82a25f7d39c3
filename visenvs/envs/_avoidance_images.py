"""What the camera of an avoidance scene sees: red balls in the open air, and a green beacon.

A picture depends on the lane's record alone, so that it can be drawn anew from any snapshot. The
camera is fixed to the vehicle and tilts with it; the vehicle knows its attitude, and how large the
balls are up to `range_error`.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from visenvs.core.outcome import RUNNING
from visenvs.dynamics.quadrotor import attitude
from visenvs.envs._avoidance_config import NEAREST, PAST, TRUTH
from visenvs.envs._avoidance_sightings import FALSE, SIGHTINGS
from visenvs.estimation.tracks import NOBODY
from visenvs.sensors.images.exposure import Exposure, expose
from visenvs.sensors.images.optics import Image, Optics, Values
from visenvs.sensors.images.outdoor import outdoor_of
from visenvs.sensors.images.spheres import Ball, detect

EXPOSURE = FALSE + 1  # noise stream, after those of `_avoidance_sightings`
LENS = Exposure()
RED, GREEN = (200.0, 30.0, 30.0), (40.0, 190.0, 60.0)
BEACON = 4.0  # radius of the beacon at the waypoint, m: seen half of the way off
MATCH = 1.0  # a ball is an obstacle's if its centre is nearer than so many radii, and 3 pixels
ALIKE = math.log(1.5)  # and if it is not larger or smaller than this

SIGHTED = np.dtype(
    [
        ("count", "i8"),
        ("seen", "f8", (SIGHTINGS, 2)),
        ("labels", "f8", (SIGHTINGS,)),
        ("distance", "f8", (SIGHTINGS,)),
    ]
)


def camera(config: Any, side: int) -> Optics:
    """A square picture that is half_width focal lengths to each side of the optical axis."""
    return Optics(side, side, 0.5 * side / float(config["half_width"]))


def attitude_of(q: Values) -> Values:
    """C_CN of the quaternion of a lane's record, (3, 3)."""
    C = np.empty((3, 3))
    attitude(q, C)
    return C


def picture(lane: np.void, config: Any, side: int, back: int = 0) -> Image:
    """What the camera of one lane sees, or saw so many steps before, RGB, (side, side, 3)."""
    optics, n = camera(config, side), int(lane["count"])
    seed, episode, step = (int(lane[name]) for name in ("seed", "episode", "step"))
    back = min(back, step)
    then = (step - back) % PAST
    own = lane["way_N"][then] if back else lane["r_V_N"]
    C = attitude_of(lane["way_q"][then] if back else lane["q_V"])
    others = lane["r_O_N"][:n] - back * config["dt"] * lane["v_O_N"][:n]
    world = outdoor_of(seed, episode)
    frame = world.render(optics, C, own)
    beacon = (config["waypoint"] - own)[None]
    world.balls(frame, optics, C, beacon, np.array([BEACON]), GREEN)
    world.balls(frame, optics, C, others - own, config["ball"] * lane["radius"][:n], RED)
    return expose(frame, LENS, seed, episode, EXPOSURE, step - back)


def frames(lanes: NDArray[Any], config: NDArray[Any], out: NDArray[np.uint8]) -> None:
    """Write the pictures of every lane, now and `frame_before` ago, (n, frame, frame, 6)."""
    back = round(float(config[0]["frame_before"] / config[0]["dt"]))
    for i in range(len(lanes)):
        for k, ago in enumerate((0, back)):
            out[i, ..., 3 * k : 3 * k + 3] = picture(lanes[i], config[0], out.shape[1], ago)


def look(lanes: NDArray[Any], config: NDArray[Any]) -> NDArray[Any]:
    """What the detector finds in the pictures that are due, a record of SIGHTED for each lane."""
    out, cfg = np.zeros(len(lanes), SIGHTED), config[0]
    if cfg["estimator"] == TRUTH:
        return out
    optics = camera(cfg, int(cfg["picture"]))
    for i in range(len(lanes)):
        due = lanes["step"][i] % cfg["image_every"] == 0 and lanes["outcome"][i] == RUNNING
        if due:
            balls = detect(picture(lanes[i], cfg, optics.width), optics)
            kept = balls[:1] if cfg["report"] == NEAREST else balls[:SIGHTINGS]
            _tell(lanes[i], kept, cfg, optics, out[i])
    return out


def _tell(lane: np.void, balls: list[Ball], cfg: Any, optics: Optics, out: np.void) -> None:
    """Write what was found: image points, distances by size, and whose they are."""
    n = int(lane["count"])
    r = (lane["r_O_N"][:n] - lane["r_V_N"]) @ attitude_of(lane["q_V"]).T
    radii = cfg["ball"] * lane["radius"][:n]
    ahead = np.maximum(r[:, 0], 1e-3)
    places, sizes = r[:, 1:] / ahead[:, None], radii / ahead
    free = r[:, 0] > 0.0
    for ball in balls:
        if ball.angle <= 0.0:
            continue
        k = int(out["count"])
        gaps = np.where(free, np.hypot(*(places - ball.point).T), math.inf)
        scale = np.abs(np.log(ball.depth(1.0) * radii / ahead))  # of its size to what it should be
        fits = free & (gaps < MATCH * sizes + 3.0 / optics.focal) & (scale < ALIKE)
        j = int(np.argmin(np.where(fits, gaps / sizes + 3.0 * scale, math.inf)))
        known = bool(fits[j])
        free[j] &= not known
        out["seen"][k], out["labels"][k] = ball.point, j if known else NOBODY
        # how large the balls are is known, also of what is none
        out["distance"][k] = ball.depth(radii[j] if known else float(radii.mean()))
        out["count"] = k + 1
