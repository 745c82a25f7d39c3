"""A flight over the arena with an IMU, an altimeter and a camera, for the navigation filter."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from visenvs.dynamics.quadrotor import tilt_for
from visenvs.estimation import vio
from visenvs.estimation.navigator import Navigator, settings
from visenvs.sensors.images.arena import shared_arena
from visenvs.sensors.images.exposure import expose
from visenvs.sensors.images.robots import ROBOT
from visenvs.sensors.images.scenes import EXPOSURE, OPTICS
from visenvs.sensors.imu import take_inertial

DT = 0.01  # between IMU samples, s
ROBOTS, SPEED = 4, 0.33  # distractors, m/s
IMU_STREAM, PICTURE_STREAM = 0, 1
C_CB = {
    "nadir": np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]]),
    "tilted": np.array(
        [
            [math.cos(math.pi / 3), 0.0, math.sin(math.pi / 3)],
            [0.0, 1.0, 0.0],
            [-math.sin(math.pi / 3), 0.0, math.cos(math.pi / 3)],
        ]
    ),
}
Values = NDArray[Any]


@dataclass(frozen=True)
class Drift:
    """How far the estimate was off.

    Attributes:
        position: error at every picture, m, (n, 3).
        heading: error at every picture, rad, (n,).
        travelled: length of the flight, m.
        used: landmarks used in a picture, mean.
    """

    position: Values
    heading: Values
    travelled: float
    used: float


def path(t: float) -> tuple[Values, Values, Values]:
    """Position, velocity and acceleration in N of a smooth flight, about 1 m/s, 2 m up."""
    north, east = 2.0 * math.pi / 31.0, 2.0 * math.pi / 23.0
    a, b, c, w = 4.0, 2.6, 0.25, 2.0 * math.pi / 11.0
    p = np.array([a * math.sin(north * t), b * math.sin(east * t), -2.0 - c * math.sin(w * t)])
    v = np.array([a * north * math.cos(north * t), b * east * math.cos(east * t), 0.0])
    v[2] = -c * w * math.cos(w * t)
    acceleration = -np.array([north**2, east**2, w**2]) * (p - (0.0, 0.0, -2.0))
    return p, v, acceleration


def attitude(t: float) -> Values:
    """C_BN: tilted for the acceleration, the heading swinging slowly."""
    C = np.empty((3, 3))
    tilt_for(path(t)[2], 0.5 * math.sin(0.2 * t), C)
    return C


def rates(t: float) -> Values:
    """Body rates over the sample from t on, rad/s: the rotation vector over its length."""
    turn = attitude(t + DT) @ attitude(t).T
    off = 0.5 * np.array(
        [turn[1, 2] - turn[2, 1], turn[2, 0] - turn[0, 2], turn[0, 1] - turn[1, 0]]
    )
    sine = float(np.linalg.norm(off))
    return off / DT * (math.asin(min(sine, 1.0)) / sine if sine > 1e-9 else 1.0)


def fly(
    seed: int, seconds: float, rate: int, camera: str, altimeter: bool = True, steps: Any = vio
) -> Drift:
    """Fly the path, navigate by pictures at a rate (Hz), and keep how far off the estimate is.

    steps: of the filter, as of `Navigator`.
    """
    arena, mount = shared_arena(seed % 3, False), C_CB[camera]
    truth, told = settings(OPTICS, DT), settings(OPTICS, DT)
    for name in ("sigma_force", "sigma_rate", "walk_force", "walk_rate"):
        truth[name] *= 0.5  # the filter is told twice the noise
    rng = np.random.default_rng(seed)
    biases = rng.normal(0.0, 1.0, (2, 3)) * [[0.04], [0.003]]
    filter_ = Navigator.start(OPTICS, mount, told, *path(0.0)[:2], attitude(0.0))
    filter_ = replace(filter_, steps=steps)
    fleet = np.zeros(ROBOTS, ROBOT)
    fleet["place"], fleet["heading"] = rng.uniform(-4, 4, (ROBOTS, 2)), rng.uniform(-3, 3, ROBOTS)
    fleet["plate"] = rng.integers(0, 2, ROBOTS)
    off: list[Values] = []
    heading: list[float] = []
    used: list[int] = []
    each, step = round(1.0 / DT / rate), 0
    for k in range(round(seconds * rate)):
        samples = np.empty((each, 2, 3))
        for m in range(each):
            t = step * DT
            middle = 0.5 * (path(t)[2] + path(t + DT)[2])
            C = attitude(t + 0.5 * DT)
            take_inertial(
                C, middle, rates(t), biases, truth[0], seed, 0, step, IMU_STREAM, samples[m]
            )
            step += 1
        filter_.feel(samples)
        ahead = np.stack([np.cos(fleet["heading"]), np.sin(fleet["heading"])], axis=1)
        fleet["place"] += SPEED / rate * ahead
        fleet["heading"] += rng.normal(0.0, 0.1, ROBOTS)
        (p, _, _), C = path(step * DT), attitude(step * DT)
        frame = arena.render(OPTICS, mount @ C, p, fleet)
        image = expose(frame, EXPOSURE, seed, 0, PICTURE_STREAM, k)
        height = float(-p[2] + 0.02 * rng.normal()) if altimeter else None
        used.append(filter_.see(image, height))
        nav = filter_.nav[0]
        off.append(nav["p"] - p)
        heading.append(
            float(np.arctan2(nav["C"][0, 1], nav["C"][0, 0]) - np.arctan2(C[0, 1], C[0, 0]))
        )
    times = np.arange(0.0, seconds, 0.1)
    speeds = [float(np.linalg.norm(path(t)[1])) for t in times]
    turned = np.mod(np.array(heading) + math.pi, 2.0 * math.pi) - math.pi
    return Drift(np.array(off), turned, float(np.mean(speeds) * seconds), float(np.mean(used)))
