"""Rendered pictures of 320 by 240 pixels and what is made of them, beside another camera."""

from __future__ import annotations

import importlib.util
from collections.abc import Callable
from typing import Any

import numpy as np

from visenvs.core.config import override, to_record
from visenvs.core.lanes import Lanes
from visenvs.core.registry import load_task
from visenvs.envs import _herding_images as herding
from visenvs.envs._herding_layout import WORK
from visenvs.envs._herding_navigation import known
from visenvs.sensors.images import haar, leader, spheres, templates
from visenvs.sensors.images.aircraft import draw_aircraft
from visenvs.sensors.images.arena import shared_arena
from visenvs.sensors.images.cascade_file import shipped_cascade
from visenvs.sensors.images.exposure import Exposure, expose
from visenvs.sensors.images.optics import Image, Optics
from visenvs.sensors.images.outdoor import Sky, shared_outdoor
from visenvs.sensors.images.prior import Prior
from visenvs.sensors.images.robots import HEIGHT, NO_PLATE, ROBOT
from visenvs.sensors.images.scenes import WINDOW

from . import Budget, Portion, Row, left_out, race, row

GROUP = "images"
WANTS = "at least 667 grey arena and 333 outdoor pictures, 67 herding steps per CPU second"
UNIT = "pictures/CPU s"
OPTICS, LENS, DOWN = Optics(320, 240, 277.0), Exposure(), np.eye(3)[[2, 1, 0]] * [[1], [1], [-1]]
HERDING, ARENA, OUTDOOR = "images/herding-step", "images/arena/grey", "images/outdoor/balls"
PLACE = np.array([0.3, 0.2, -2.0])
BALLS, RADII = np.array([[60.0, 6.0, -4.0], [150.0, -40.0, 10.0]]), np.array([6.0, 6.0])
RED = (200.0, 40.0, 40.0)


def rows(budget: Budget) -> list[Row]:
    """Pictures alone, detectors alone, and a whole step of the herding's perception."""
    fleet = robots()
    grey, outdoor, far = arena_picture(fleet, 0), outdoor_picture(0), leader_picture(0)
    prior = Prior((0.05, -0.03), (0.01, 0.01), 0.06)
    sizes = haar.floor_sizes(OPTICS, DOWN, 2.0 - HEIGHT, WINDOW)
    view = (OPTICS, DOWN, PLACE, fleet["place"][0], (-0.2, 0.0, 0.2), 0)
    sides = {
        ARENA: each(lambda k: arena_picture(fleet, k)),
        "images/arena/colour": each(lambda k: arena_picture(fleet, k, True)),
        OUTDOOR: each(outdoor_picture),
        "images/outdoor/leader": each(leader_picture),
        "images/detect/spheres": each(lambda _: spheres.detect(outdoor, OPTICS)),
        "images/detect/leader": each(lambda _: leader.detect(far, OPTICS, prior)),
        "images/detect/haar": each(lambda _: haar.detect(grey, shipped_cascade(), sizes)),
        "images/detect/ncc": each(lambda _: templates.detect(grey, *view)),
        HERDING: herding_step(),
    }
    if importlib.util.find_spec("PyFlyt") is None:
        left_out("images/pyflyt", "pip install PyFlyt")
    else:
        sides["images/pyflyt"] = pyflyt()
    rates = race(sides, budget)
    reference = "images/pyflyt" if "images/pyflyt" in sides else None
    return [row(name, UNIT, rates, reference if name != reference else None) for name in sides]


def robots() -> Any:
    """Ten robots and four obstacles about the camera."""
    rng = np.random.default_rng(0)
    out = np.zeros(14, ROBOT)
    out["place"], out["heading"] = rng.uniform(-2.5, 2.5, (14, 2)), rng.uniform(-3, 3, 14)
    out["place"][0], out["heading"][0] = (0.4, 0.3), 0.0
    out["plate"][1:10], out["plate"][10:] = np.arange(9) % 2, NO_PLATE
    out["pole"][10:], out["place"][10:, 0] = 1.5, 2.0
    return out


def each(take: Callable[[int], Any]) -> Portion:
    """Ten of them."""
    turn = [0]

    def portion() -> int:
        for _ in range(10):
            turn[0] += 1
            take(turn[0])
        return 10

    return portion


def arena_picture(fleet: Any, k: int, colour: bool = False) -> Image:
    """The floor from 2 m, lens and sensor included."""
    frame = shared_arena(0, colour).render(OPTICS, DOWN, PLACE, fleet)
    return expose(frame, LENS, 0, 0, 0, k)


def outdoor_picture(k: int) -> Image:
    """Two balls in the open air."""
    world = shared_outdoor(0, Sky())
    frame = world.render(OPTICS, np.eye(3), np.zeros(3))
    world.balls(frame, OPTICS, np.eye(3), BALLS, RADII, RED)
    return expose(frame, LENS, 0, 0, 0, k)


def leader_picture(k: int) -> Image:
    """An aircraft ahead."""
    frame = shared_outdoor(0, Sky()).render(OPTICS, np.eye(3), np.zeros(3))
    draw_aircraft(frame, OPTICS, np.eye(3), np.array([22.0, 1.1, -0.7]), np.eye(3), RED)
    return expose(frame, LENS, 0, 0, 0, k)


def herding_step() -> Portion:
    """All that a herding aircraft makes of a picture over ten robots, four seconds after the start.

    The picture, IMU and navigation, the cascade in all of it, templates and headings, the tracks.
    """
    task = load_task("visenvs/Herding-v0")
    changes = {"perception": "images", "navigation": "vio"}
    config = override(task.scenarios["firmware"], changes)
    lanes, idle = Lanes(task, config, 1), np.zeros((1, 1), np.float32)
    lanes.reset([0])
    for _ in range(8):
        lanes.step(idle)
    cfg, work = to_record(config)[0], np.zeros(1, WORK)[0]

    def step(_: int) -> None:
        own = lanes.snapshot()
        own["bank"]["picture"] = 0.0  # one of those that are searched as a whole
        herding.navigate(own, known(own), 0, cfg, work)

    return each(step)


def pyflyt() -> Portion:
    """The camera of PyFlyt's quadrotor, of the same size, CPU renderer."""
    from PyFlyt.core import Aviary  # pyright: ignore[reportMissingImports]

    start, level = np.array([[0.0, 0.0, 2.0]]), np.zeros((1, 3))
    camera = {"use_camera": True, "camera_resolution": (OPTICS.height, OPTICS.width)}
    sky = Aviary(start, level, drone_type="quadx", drone_options=camera)

    def take(_: int) -> None:
        sky.drones[0].capture_image()

    return each(take)
