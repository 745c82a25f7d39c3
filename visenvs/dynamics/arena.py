"""Contacts by pymunk: arrays in, arrays out, and no pymunk object outside this file.

Wheels that grip move a robot where they turn; a contact only keeps two bodies from being in one
place. So the library is asked nothing of free motion: whenever circles have driven into each other
a Space is built from the record, its solver moves them apart, its collision handlers press the
bumpers, and the Space is thrown away. A tick is thereby a function of the record alone, and robots
that touch nothing keep every bit of their pose.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pymunk
from numpy.typing import NDArray

from visenvs.dynamics.kinematic_arena import SLOP, feel

MASS = 3.0  # of every robot, kg; all are alike, so only that they are equal matters
ROBOT, AIRCRAFT = 1, 2  # collision types


def settle(arena: Any, pads: NDArray[np.float64], near: NDArray[np.int64], cfg: Any) -> None:
    """Find and settle the contacts of the circles `near`, among each other and with aircraft.

    Args:
        arena, pads, cfg: as in `kinematic_arena.touch`; cfg also has tick, s.
        near: 1 for the circles that are in contact (`kinematic_arena.crowded`), (CIRCLES,).
    """
    space = pymunk.Space()
    space.collision_slop, space.collision_bias = 0.5 * SLOP, 0.0
    chosen = [int(k) for k in np.flatnonzero(near)]
    bodies = {k: robot(space, arena, k, float(cfg["robot_radius"])) for k in chosen}
    number = {body.id: k for k, body in bodies.items()}
    for m, (north, east, solid) in enumerate(pads.tolist()):
        if solid:
            stand(space, (north, east), float(cfg["aircraft_radius"]), m + 1)

    def between_robots(arbiter: pymunk.Arbiter, _space: pymunk.Space, _data: Any) -> None:
        one, other = (number[shape.body.id] for shape in arbiter.shapes)
        north, east = bodies[other].position - bodies[one].position
        feel(arena, one, north, east, 0)
        feel(arena, other, -north, -east, 0)

    def with_aircraft(arbiter: pymunk.Arbiter, _space: pymunk.Space, _data: Any) -> None:
        one, pad = arbiter.shapes
        north, east = pad.body.position - one.body.position
        feel(arena, number[one.body.id], north, east, pad.body.pad)

    space.on_collision(ROBOT, ROBOT, begin=between_robots)
    space.on_collision(ROBOT, AIRCRAFT, begin=with_aircraft)
    # the first step finds the contacts and how to part them, the second one parts them
    for _ in range(2):
        space.step(float(cfg["tick"]))
    for k, body in bodies.items():
        arena["r_R_N"][k] = body.position


def robot(space: pymunk.Space, arena: Any, k: int, radius: float) -> pymunk.Body:
    """A circle that contacts push but do not turn."""
    body = pymunk.Body(MASS, float("inf"))
    body.position = tuple(arena["r_R_N"][k].tolist())
    shape = pymunk.Circle(body, radius)
    shape.collision_type = ROBOT
    space.add(body, shape)
    return body


def stand(space: pymunk.Space, place: tuple[float, float], radius: float, pad: int) -> None:
    """An aircraft on the ground: a circle that nothing moves."""
    body = pymunk.Body(body_type=pymunk.Body.STATIC)
    body.position = place
    body.pad = pad  # type: ignore[attr-defined]
    shape = pymunk.Circle(body, radius)
    shape.collision_type = AIRCRAFT
    space.add(body, shape)
