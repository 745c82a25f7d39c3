"""Herding against the clock: both arenas, with the camera and ten tracks in the loop and without.

Figures are seconds of a mission in a CPU second. Both arenas are asked for contacts in the same
ticks only, those in which circles meet: that is why pymunk costs so little. What it costs where the
library drives all circles in one standing space, as it is mostly used, is raced against the robots'
own firmware and contacts by geometry, without aircraft, camera or environment on either side.
"""

from __future__ import annotations

import math

import numpy as np
import pymunk

from visenvs.core.compile import kernel
from visenvs.core.config import override, to_record
from visenvs.core.lanes import Lanes
from visenvs.core.registry import load_task
from visenvs.dynamics.arena import add_circle
from visenvs.dynamics.ground_robot import CIRCLES, drive_all
from visenvs.dynamics.kinematic_arena import touch
from visenvs.envs._herding_config import SCENARIOS

from . import Budget, Portion, Row, race, row

GROUP = "herding"
WANTS = "herding/pymunk-camera at least 20 times real time, robots-compiled 10 times robots-pymunk"
REAL = "herding/real-time"
COMPILED, STANDING = "herding/robots-compiled", "herding/robots-pymunk"
TICKS = 1200  # of the robots by themselves: a minute
LOOPS = {
    f"herding/{arena}-{estimator}": {"arena": arena, "estimator": estimator}
    for arena in ("pymunk", "kinematic")
    for estimator in ("camera", "truth")
}


def rows(budget: Budget) -> list[Row]:
    """All four, and real time."""
    rates = dict(race({name: missions(**changes) for name, changes in LOOPS.items()}, budget))
    rates |= {REAL: [1.0] * budget.rounds}
    out = [row(name, "mission s/CPU s", rates, REAL) for name in LOOPS]
    alone = dict(race({COMPILED: robots_compiled(), STANDING: robots_pymunk()}, budget))
    return [
        *out,
        row(REAL, "s/s", rates),
        row(COMPILED, "s/CPU s", alone, STANDING),
        row(STANDING, "s/CPU s", alone),
    ]


def missions(**changes: str) -> Portion:
    """A minute of an aircraft that hovers over the middle while the robots drive about."""
    task = load_task("visenvs/Herding-v0")
    lanes = Lanes(task, override(task.scenarios["firmware"], changes), 1)
    idle = np.zeros((1, 1), np.float32)

    def portion() -> int:
        lanes.reset([0])
        for _ in range(120):
            lanes.step(idle)
        return round(float(lanes.records["t"][0]))

    return portion


@kernel
def drive(arena, pads, cfg, ticks):
    """So many ticks of all robots and their contacts."""
    for _ in range(ticks):
        drive_all(arena, cfg)
        touch(arena, pads, cfg)
        arena["tick"] += 1
        arena["t"] = arena["tick"] * cfg["tick"]


def robots_compiled() -> Portion:
    """A minute of fourteen robots with their firmware, and contacts by geometry."""
    task, cfg = load_task("visenvs/Herding-v0"), to_record(SCENARIOS["firmware"])[0]
    lanes, pads = Lanes(task, SCENARIOS["firmware"], 1), np.zeros((1, 3))

    def portion() -> int:
        lanes.reset([0])
        drive(lanes.records[0], pads, cfg, TICKS)
        return round(float(lanes.records["t"][0]))

    return portion


def robots_pymunk() -> Portion:
    """The same circles, driven straight by pymunk in one space, without any firmware."""
    task, cfg = load_task("visenvs/Herding-v0"), to_record(SCENARIOS["firmware"])[0]
    lanes, tick = Lanes(task, SCENARIOS["firmware"], 1), float(cfg["tick"])

    def portion() -> int:
        lanes.reset([0])
        arena, space = lanes.records[0], pymunk.Space()
        for k in range(CIRCLES):
            body = pymunk.Body(1.0, math.inf)
            add_circle(space, body, arena["r_R_N"][k], float(cfg["robot_radius"]), 1)
            heading = arena["heading"][k]
            body.velocity = cfg["speed"] * math.cos(heading), cfg["speed"] * math.sin(heading)
        places = np.zeros((CIRCLES, 2))
        for _ in range(TICKS):
            space.step(tick)
            places[:] = [body.position for body in space.bodies]
        return round(TICKS * tick)

    return portion
