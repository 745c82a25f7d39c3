"""Where a herding aircraft believes to be: a filter on IMU, altimeter and corners of the floor.

The IARC paper's filter (`estimation.vio`, `navigator`), with five IMU samples in a tick of the
simulation and a picture whenever the camera takes one. What it gets wrong enters everything that is
seen: findings are placed from the believed pose, attitude included, and the aircraft flies to its
aims by the believed place. Velocity and height in its control are the true ones: the filter knows
both to some centimetres, and so is a quadrotor's attitude. Its IMU feels it in every step of the
attitude loop; that of a point mass, which flies level, feels acceleration alone.

On the ground, where no corner can be made out, the IMU goes on by itself.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from visenvs.core.lanes import as_integers
from visenvs.core.noise import normal, normal_pair
from visenvs.dynamics import quadrotor
from visenvs.envs._herding_layout import LANE
from visenvs.estimation.navigator import Navigator, settings
from visenvs.estimation.robot_track import TRACKED
from visenvs.estimation.vio import NAVIGATION, SLOTS
from visenvs.sensors.images.corners import PATCH
from visenvs.sensors.images.ground_robots import View
from visenvs.sensors.images.optics import Image, Optics
from visenvs.sensors.images.robots import RADIUS
from visenvs.sensors.imu import take_inertial

SAMPLES = 5  # of the IMU in a tick; a quadrotor has one in every step of its attitude loop
TOLD = 2.0  # times the IMU's noise is what the filter is told
BIASES = (0.04, 0.003)  # standard deviations at the start, m/s^2 and rad/s
LEVEL, STILL = np.eye(3), np.zeros(3)
SIGMA_HEIGHT = 0.02  # of the altimeter, m
LOWEST = 0.4  # height from which corners are made out, m
MASKED = 1.3  # radii of a robot in which no corner is looked for

NAVIGATING = np.dtype(
    [
        *((name, LANE[name]) for name in LANE.names or ()),
        ("nav", NAVIGATION),
        ("patches", "f8", (SLOTS, PATCH * PATCH)),
        ("biases", "f8", (2, 3)),  # of the IMU: accelerometer, m/s^2, and gyro, rad/s
        ("q_felt", "f8", (4,)),  # attitude at the end of the last tick
        ("v_felt", "f8", (3,)),  # true velocity at the end of the last tick, m/s
        ("height_felt", "f8"),  # and height, m
    ]
)
WORDS = LANE.itemsize // 8


def known(lanes: NDArray[Any]) -> NDArray[Any]:
    """A copy of the part of the records that the kernels of the task know."""
    return as_integers(lanes)[:, :WORDS].copy().view(LANE)[:, 0]


def put_back(lanes: NDArray[Any], part: NDArray[Any]) -> None:
    """Write that part."""
    as_integers(lanes)[:, :WORDS] = as_integers(part)


def start(
    own: NDArray[Any], optics: Optics, C_CB: NDArray[Any], period: float, stream: int
) -> None:
    """Begin at the true place with an IMU whose biases are unknown.

    Args:
        own: one record of NAVIGATING, (1,).
        optics, C_CB: the camera and its attitude on the aircraft.
        period: from one sample of the IMU to the next, s.
        stream: noise stream of the IMU.
    """
    lane = own[0]
    p = np.array([*lane["r_V_N"], -lane["height"]])
    own["height_felt"], own["q_felt"] = lane["height"], (1.0, 0.0, 0.0, 0.0)
    for i in range(3):
        force, rate = normal_pair(int(lane["seed"]), int(lane["episode"]), stream, 0, 6 + i)
        lane["biases"][0, i], lane["biases"][1, i] = BIASES[0] * force, BIASES[1] * rate
    begun = Navigator.start(optics, C_CB, told(optics, period), p, STILL, LEVEL)
    own["nav"], own["patches"] = begun.nav, begun.patches


@cache
def told(optics: Optics, period: float) -> NDArray[Any]:
    """What the filter is told of IMU, camera and altimeter."""
    out = settings(optics, period)
    out["sigma_height"] = SIGMA_HEIGHT
    return out


@cache
def true(optics: Optics, period: float) -> NDArray[Any]:
    """What the IMU is like."""
    out = told(optics, period).copy()
    for name in ("sigma_force", "sigma_rate", "walk_force", "walk_rate"):
        out[name] /= TOLD
    return out


def navigator(own: NDArray[Any], optics: Optics, C_CB: NDArray[Any], period: float) -> Navigator:
    """The filter in one record of NAVIGATING, (1,)."""
    return Navigator(optics, C_CB, told(optics, period), own["nav"], own["patches"][0])


def feel(
    own: NDArray[Any],
    lane: np.void,
    arena: np.void,
    filter_: Navigator,
    tick: float,
    stream: int,
    parts: int = 0,
) -> None:
    """Let the filter integrate what the IMU felt in the last tick.

    Args:
        own: one record of NAVIGATING, (1,).
        lane, arena: of the aircraft and the first of its team, after the tick.
        filter_: that of `own`.
        tick: s.
        stream: noise stream.
        parts: of the tick in which a quadrotor felt what is in its record; 0 for a point mass.
    """
    felt = lane["felt"][:parts] if parts else steady(own, lane, tick)
    n, q, C = len(felt), own["q_felt"][0], np.empty((3, 3))
    samples, names = np.empty((n, 2, 3)), (int(arena["seed"]), int(arena["episode"]))
    imu, biases = true(filter_.optics, tick / n)[0], own["biases"][0]
    for k, (a, rates) in enumerate(felt):
        quadrotor.turn(q, rates, 0.5 * tick / n)
        quadrotor.attitude(q, C)
        sample = n * int(arena["tick"]) + k
        take_inertial(C, a, rates, biases, imu, *names, sample, stream, samples[k])
        quadrotor.turn(q, rates, 0.5 * tick / n)
    filter_.feel(samples)


def steady(own: NDArray[Any], lane: np.void, tick: float) -> NDArray[Any]:
    """Accelerations and rates of a level tick whose end the record shows, (SAMPLES, 2, 3)."""
    felt = np.zeros((SAMPLES, 2, 3))
    v = np.array([*lane["v_V_N"], (float(own["height_felt"][0]) - float(lane["height"])) / tick])
    felt[:, 0] = (v - own["v_felt"][0]) / tick
    own["v_felt"], own["height_felt"] = v, lane["height"]
    return felt


def see(lane: np.void, arena: np.void, filter_: Navigator, image: Image, stream: int) -> None:
    """Let the filter use a picture and the altimeter, and tell the aircraft where it is.

    Args:
        lane, arena: of the aircraft and the first of its team.
        filter_: of the aircraft.
        image: grey.
        stream: noise stream of the altimeter.
    """
    height = float(lane["height"])
    if height > LOWEST:
        draw = normal(int(arena["seed"]), int(arena["episode"]), stream, int(arena["tick"]), 0)
        filter_.see(image, height + SIGMA_HEIGHT * draw, mask(lane, filter_))
    truth = lane["r_V_N"] - lane["off_N"]
    lane["r_V_N"] = filter_.nav["p"][0, :2]
    lane["off_N"] = lane["r_V_N"] - truth


def mask(lane: np.void, filter_: Navigator) -> Image:
    """0 where robots are believed to be, which move."""
    optics, nav = filter_.optics, filter_.nav[0]
    out = np.full((optics.height, optics.width), 255, np.uint8)
    bank = lane["bank"]
    places = bank["r_N"][(bank["status"] == TRACKED) & (bank["away"] == 0.0)]
    r = np.concatenate([places, np.zeros((len(places), 1))], axis=1) - nav["p"]
    pixels, depth = optics.project(filter_.C_CB @ nav["C"], r)
    for pixel, far in zip(pixels, depth, strict=True):
        if np.isfinite(pixel).all() and optics.shows(pixel, -50.0):
            radius = round(MASKED * RADIUS * optics.focal / float(far))
            cv2.circle(out, (round(float(pixel[0])), round(float(pixel[1]))), radius, 0, -1)
    return out


def believed(view: View, filter_: Navigator) -> View:
    """The picture with the camera where the filter believes it."""
    nav = filter_.nav[0]
    return View(view.image, view.optics, filter_.C_CB @ nav["C"], nav["p"].copy())
