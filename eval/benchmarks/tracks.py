"""Perception and planning of herding, against the periods at which they are needed.

A picture: what the camera finds of ten robots, and a bank of ten tracks brought up to date by it,
for the first half minute of a mission seen from its middle. A plan: 40 trajectories of 60 steps by
differential dynamic programming, all of them evaluated, from no guess.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from visenvs.core.compile import kernel
from visenvs.core.config import to_record
from visenvs.dynamics.ground_robot import ACTIVE, ROBOTS, drive_all
from visenvs.envs._herding_config import HerdingConfig
from visenvs.estimation import herd
from visenvs.guidance.ddp import DDPConfig, make_tape
from visenvs.sensors.ground_camera import FALSE, look, mount

from ..cases._iarc import ARENA
from ..cases.ddp import SETS, STEPS, all_sets
from . import Budget, Portion, Row, race, row

GROUP = "tracks"
WANTS = (
    "tracks/plan at least 83 times the control period's rate (0.6 ms), tracks/picture at least "
    "100 times the camera's"
)
PICTURE, PLAN = "tracks/picture", "tracks/plan"
CAMERA, CONTROL = "tracks/camera-period", "tracks/control-period"
SECONDS = 30


def rows(budget: Budget) -> list[Row]:
    """Both, and the rates that they are compared with."""
    config = HerdingConfig()
    rates = dict(race({PICTURE: pictures(config), PLAN: plans()}, budget))
    rates |= {CAMERA: [1.0 / config.camera_every] * budget.rounds}
    rates |= {CONTROL: [1.0 / DDPConfig().dt] * budget.rounds}
    return [
        row(PICTURE, "pictures/CPU s", rates, CAMERA),
        row(PLAN, "plans/CPU s", rates, CONTROL),
        row(CAMERA, "periods/s", rates),
        row(CONTROL, "periods/s", rates),
    ]


@kernel
def take_all(places, active, pose, settings, bank, seen, labels, work):
    """All pictures of a run, from an empty bank."""
    cfg = settings[0]
    herd.start(bank[0])
    for k in range(places.shape[0]):
        count = look(pose, places[k], active, cfg, 0, 0, k, 0, seen, labels)
        herd.step(bank[0], seen, count, pose, cfg["camera_every"], cfg, work[0])


def driven(config: HerdingConfig) -> NDArray[np.float64]:
    """Where ten robots are at each picture if they meet nobody, m, (pictures, 10, 2)."""
    arena, cfg, out = np.zeros(1, ARENA)[0], to_record(config)[0], []
    angle = 2.0 * np.pi * np.arange(ROBOTS) / ROBOTS
    arena["fate"][:ROBOTS], arena["heading"][:ROBOTS] = ACTIVE, angle
    arena["r_R_N"][:ROBOTS] = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    for _ in range(round(SECONDS / config.camera_every)):
        for _ in range(round(config.camera_every / config.tick)):
            drive_all(arena, cfg)
            arena["tick"] += 1
            arena["t"] = arena["tick"] * config.tick
        out.append(arena["r_R_N"][:ROBOTS].copy())
    return np.array(out)


def pictures(config: HerdingConfig) -> Portion:
    """Half a minute of pictures, in one compiled loop."""
    places, settings = driven(config), to_record(config)
    active, pose = np.ones(ROBOTS), np.zeros((4, 3))
    pose[0, 2] = -config.cruise
    mount(np.eye(3), pose)
    bank, work = np.zeros(1, herd.bank_dtype()), np.zeros(1, herd.work_dtype())
    seen, labels = np.zeros((ROBOTS + FALSE, 2)), np.zeros(ROBOTS + FALSE)

    def portion() -> int:
        take_all(places, active, pose, settings, bank, seen, labels, work)
        return len(places)

    return portion


def plans() -> Portion:
    """One plan from the same state to the same landing."""
    x0, aim = np.array([3.0, -2.0, -2.0, 0.5, 0.3, 0.0]), np.array([0.0, 0.0, 0.06, 0.0, 0.0, 0.25])
    cfg, tape = to_record(DDPConfig())[0], make_tape(STEPS)

    def portion() -> int:
        all_sets(x0, aim, STEPS, SETS, cfg, tape)
        return 1

    return portion
