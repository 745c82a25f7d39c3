"""The choices of a herding aircraft, by number: a service of a robot, a look at one, or neither."""

from __future__ import annotations

from visenvs.core.compile import kernel
from visenvs.guidance.interception import BLOCK, TAP

ROBOTS = 10
DELAYS = (0.0, 2.0, 4.0)  # how much later than possible to come down, s
LOOK, HOVER, CONTINUE = 2, 3, 4  # what there is to do besides BLOCK and TAP
LOOK_PLACE = 2 * len(DELAYS)  # of the look among the choices of a robot
PER_ROBOT = LOOK_PLACE + 1
LAST = 1 + ROBOTS * PER_ROBOT


def _of_robot(i: int) -> tuple[str, ...]:
    later = [f" in {delay:g} s" if delay else "" for delay in DELAYS]
    return (
        *(f"block {i}{when}" for when in later),
        *(f"tap {i}{when}" for when in later),
        f"look at {i}",
    )


CHOICES = ("hover", *(name for i in range(ROBOTS) for name in _of_robot(i)), "continue")


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
    """What a choice is: BLOCK, TAP, LOOK, HOVER or CONTINUE; the robot; the delay, s."""
    if number == 0:
        return HOVER, 0, 0.0
    if number >= LAST:
        return CONTINUE, 0, 0.0
    robot, place = (number - 1) // PER_ROBOT, (number - 1) % PER_ROBOT
    if place == LOOK_PLACE:
        return LOOK, robot, 0.0
    late = place % len(DELAYS)
    return (TAP if place >= len(DELAYS) else BLOCK), robot, DELAYS[late]
