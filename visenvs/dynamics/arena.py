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
    r = arena["r_R_N"]
    space = pymunk.Space()
    space.collision_slop, space.collision_bias = 0.5 * SLOP, 0.0
    radius, bodies = float(cfg["robot_radius"]), {}
    number: dict[pymunk.Shape, int] = {}
    for k in np.flatnonzero(near).tolist():
        bodies[k] = body = pymunk.Body(MASS, float("inf"))  # pushed, never turned
        number[add_circle(space, body, r[k], radius, ROBOT)] = k
    for m in np.flatnonzero(pads[:, 2]).tolist():
        body = pymunk.Body(body_type=pymunk.Body.STATIC)
        stand = add_circle(space, body, pads[m], float(cfg["aircraft_radius"]), AIRCRAFT)
        number[stand] = m

    def between_robots(arbiter: pymunk.Arbiter, _space: pymunk.Space, _data: Any) -> None:
        one, other = (number[shape] for shape in arbiter.shapes)
        north, east = r[other] - r[one]
        feel(arena, one, north, east, 0)
        feel(arena, other, -north, -east, 0)

    def with_aircraft(arbiter: pymunk.Arbiter, _space: pymunk.Space, _data: Any) -> None:
        one, m = (number[shape] for shape in arbiter.shapes)
        north, east = pads[m, :2] - r[one]
        feel(arena, one, north, east, m + 1)

    space.on_collision(ROBOT, ROBOT, begin=between_robots)
    space.on_collision(ROBOT, AIRCRAFT, begin=with_aircraft)
    # the first step finds the contacts and how to part them, the second one parts them
    for _ in range(2):
        space.step(float(cfg["tick"]))
    for k, body in bodies.items():
        r[k] = body.position


def add_circle(
    space: pymunk.Space, body: pymunk.Body, place: NDArray[np.float64], radius: float, kind: int
) -> pymunk.Circle:
    """Put a body in its place and give it a round shape of a collision type."""
    body.position = float(place[0]), float(place[1])
    shape = pymunk.Circle(body, radius)
    shape.collision_type = kind
    space.add(body, shape)
    return shape
