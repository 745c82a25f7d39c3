"""Potentials for reward shaping in training; the environments themselves know nothing of it.

A potential is minus a guess of the cost still to pay. It may read the truth, since it is gone when
the policy flies: what it adds to the return does not depend on the policy (Ng, Harada and Russell
1999).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from visenvs.core.compile import kernel
from visenvs.core.config import Config, field_types, to_record
from visenvs.core.lanes import Task
from visenvs.guidance.lq import cost_to_go

TERMINAL = (("r_TV_N", "v_V_N", "t_go"), ("s_x", "s_v"))  # lane fields, settings
MAPPING = (
    ("map_error", "map_deviation", "coverage", "t_go"),
    ("w_error", "w_uncertainty", "w_uncovered", "t_f"),
)
Potential = Callable[[NDArray[Any]], NDArray[np.float64]]


@kernel
def terminal_costs(lanes, settings, out):
    """Least cost to go with perfect information for a batch of lanes, m^2/s^3."""
    for i in range(lanes.shape[0]):
        lane, s = lanes[i], settings[0]
        out[i] = cost_to_go(lane["r_TV_N"], lane["v_V_N"], lane["t_go"], s["s_x"], s["s_v"])


def potential_of(task: Task, config: Config) -> Potential | None:
    """The potential of a task whose lanes and settings have the names that it reads, or None.

    With a terminal cost of position and velocity: minus the least cost to go with perfect
    information (thesis (4.10)). For a map: minus what is still to pay if it stays as it is.
    """
    for (lane, settings), make in ((TERMINAL, terminal_potential), (MAPPING, map_potential)):
        names, known = set(task.lane.names or ()), set(field_types(type(config)))
        if set(lane) <= names and set(settings) <= known:
            return make(to_record(config))
    return None


def terminal_potential(settings: NDArray[Any]) -> Potential:
    """Minus the least cost to go with perfect information, m^2/s^3."""

    def potential(lanes: NDArray[Any]) -> NDArray[np.float64]:
        out = np.zeros(len(lanes))
        terminal_costs(lanes, settings, out)
        return -out

    return potential


def map_potential(settings: NDArray[Any]) -> Potential:
    """Minus the cost of a map that stays as it is until the end, dimensionless."""
    s = settings[0]

    def potential(lanes: NDArray[Any]) -> NDArray[np.float64]:
        rate = s["w_error"] * lanes["map_error"] + s["w_uncertainty"] * lanes["map_deviation"]
        rate += s["w_uncovered"] * (1.0 - lanes["coverage"])
        return -rate * lanes["t_go"] / s["t_f"]

    return potential
