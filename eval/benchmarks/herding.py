"""Herding against the clock: both arenas, with the camera and ten tracks in the loop and without.

Figures are seconds of a mission in a CPU second. Both arenas are asked for contacts in the same
ticks only, those in which circles meet: that is why pymunk costs so little.
"""

from __future__ import annotations

import numpy as np

from visenvs.core.config import override
from visenvs.core.lanes import Lanes
from visenvs.core.registry import load_task

from . import Budget, Portion, Row, race, row

GROUP = "herding"
WANTS = "herding/pymunk-camera at least 20 times real time"
REAL = "herding/real-time"
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
    return [*out, row(REAL, "s/s", rates)]


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
