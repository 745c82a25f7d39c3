"""The choices of a herding aircraft, by number: a service of a robot, a look at one or at a place.

The places are the middles of nine equal squares of the arena: whom nobody sees has to be searched
for. The first is to hover; an aircraft that is busy, coming down or climbing, goes on with that and
may choose nothing else.
"""

from __future__ import annotations

import math

from visenvs.core.compile import kernel
from visenvs.guidance.interception import BLOCK, TAP

ROBOTS = 10
DELAYS = (0.0, 2.0, 4.0)  # how much later than possible to come down, s
SERVICES = ("block", "tap")  # numbers BLOCK and TAP
LOOK, GO, HOVER = 2, 3, 4  # what there is to do besides BLOCK and TAP
LOOK_PLACE = len(SERVICES) * len(DELAYS)  # of the look among the choices of a robot
PER_ROBOT = LOOK_PLACE + 1
SIDE = 3  # places along a side of the arena
FIRST_PLACE = 1 + ROBOTS * PER_ROBOT


def _of_robot(i: int) -> tuple[str, ...]:
    later = [f" in {delay:g} s" if delay else "" for delay in DELAYS]
    return (
        *(f"block {i}{when}" for when in later),
        *(f"tap {i}{when}" for when in later),
        f"look at {i}",
    )


CHOICES = (
    "hover",
    *(name for i in range(ROBOTS) for name in _of_robot(i)),
    *(f"go to place {k}" for k in range(SIDE * SIDE)),
)


@kernel
def number_of(robot, service, k):
    """The number of a service (BLOCK, TAP) of a robot with the delay DELAYS[k]."""
    return 1 + robot * PER_ROBOT + service * len(DELAYS) + k


@kernel
def look_at(robot):
    """The number of a look at a robot."""
    return 1 + robot * PER_ROBOT + LOOK_PLACE


@kernel
def meaning(number):
    """What a choice is: BLOCK, TAP, LOOK, GO or HOVER; the robot or place; the delay, s."""
    if number == 0:
        return HOVER, 0, 0.0
    if number >= FIRST_PLACE:
        return GO, number - FIRST_PLACE, 0.0
    robot, place = (number - 1) // PER_ROBOT, (number - 1) % PER_ROBOT
    if place == LOOK_PLACE:
        return LOOK, robot, 0.0
    late = place % len(DELAYS)
    return (TAP if place >= len(DELAYS) else BLOCK), robot, DELAYS[late]


@kernel
def place_of(k, side):
    """Place k, north and east, m, of an arena of that side (m): to and fro from the south-west."""
    row, column = k // SIDE, k % SIDE
    if row % 2:
        column = SIDE - 1 - column
    return (row + 0.5) * side / SIDE - 0.5 * side, (column + 0.5) * side / SIDE - 0.5 * side


@kernel
def nearest_place(point, side):
    """The place nearest to a point (north, east), m, and how far away it is, m."""
    least, best = math.inf, 0
    for k in range(SIDE * SIDE):
        north, east = place_of(k, side)
        away = math.hypot(point[0] - north, point[1] - east)
        if away < least:
            least, best = away, k
    return best, least
