"""The choices of a herding aircraft, by number: a service of a robot, a look at one, or neither."""

from __future__ import annotations

from visenvs.core.compile import kernel
from visenvs.guidance.interception import BLOCK, TAP

ROBOTS = 10
DELAYS = (0, 2, 4)  # how much later than possible to come down, s
SERVICES = ("block", "tap")  # numbers BLOCK and TAP
LOOK, HOVER, CONTINUE = 2, 3, 4  # what else there is to do
PER_ROBOT = len(SERVICES) * len(DELAYS)
FIRST_LOOK = 1 + ROBOTS * PER_ROBOT
LAST = FIRST_LOOK + ROBOTS

CHOICES = (
    "hover",
    *(
        f"{service} {robot} in {delay} s" if delay else f"{service} {robot}"
        for robot in range(ROBOTS)
        for service in SERVICES
        for delay in DELAYS
    ),
    *(f"look at {robot}" for robot in range(ROBOTS)),
    "continue",
)


@kernel
def number_of(robot, service, k):
    """The number of a service (BLOCK, TAP) of a robot with the delay DELAYS[k]."""
    return 1 + robot * PER_ROBOT + service * len(DELAYS) + k


@kernel
def meaning(number):
    """What a choice is: BLOCK, TAP, LOOK, HOVER or CONTINUE; the robot; the place of its delay."""
    if number == 0:
        return HOVER, 0, 0
    if number >= LAST:
        return CONTINUE, 0, 0
    if number >= FIRST_LOOK:
        return LOOK, number - FIRST_LOOK, 0
    robot, rest = divmod(number - 1, PER_ROBOT)
    service, k = divmod(rest, len(DELAYS))
    return (TAP if service else BLOCK), robot, k
