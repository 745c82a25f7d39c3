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

LANE = ("r_TV_N", "v_V_N", "t_go")
SETTINGS = ("s_x", "s_v")
Potential = Callable[[NDArray[Any]], NDArray[np.float64]]


@kernel
def terminal_costs(lanes, settings, out):
    """Least cost to go with perfect information for a batch of lanes, m^2/s^3."""
    for i in range(lanes.shape[0]):
        lane, s = lanes[i], settings[0]
        out[i] = cost_to_go(lane["r_TV_N"], lane["v_V_N"], lane["t_go"], s["s_x"], s["s_v"])


def potential_of(task: Task, config: Config) -> Potential | None:
    """Minus the least cost to go with perfect information (thesis (4.10)), or None.

    For every task with a terminal cost of position and velocity: the names tell.
    """
    if not set(LANE) <= set(task.lane.names or ()) or not set(SETTINGS) <= set(
        field_types(type(config))
    ):
        return None
    settings = to_record(config)

    def potential(lanes: NDArray[Any]) -> NDArray[np.float64]:
        out = np.zeros(len(lanes))
        terminal_costs(lanes, settings, out)
        return -out

    return potential
