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
from visenvs.dynamics.ground_robot import ACTIVE, ROBOTS
from visenvs.guidance.herding_value import value, value_table
from visenvs.guidance.lq import cost_to_go

LANE = ("r_TV_N", "v_V_N", "t_go")
SETTINGS = ("s_x", "s_v")
HERD = ("r_R_N", "heading", "reversal_t", "fate")
Potential = Callable[[NDArray[Any]], NDArray[np.float64]]


@kernel
def terminal_costs(lanes, settings, out):
    """Least cost to go with perfect information for a batch of lanes, m^2/s^3."""
    for i in range(lanes.shape[0]):
        lane, s = lanes[i], settings[0]
        out[i] = cost_to_go(lane["r_TV_N"], lane["v_V_N"], lane["t_go"], s["s_x"], s["s_v"])


@kernel
def herd_costs(lanes, V, settings, out):
    """What the robots that are under way will cost if each is served now and then."""
    for i in range(lanes.shape[0]):
        lane, s, lost = lanes[i], settings[0], 0.0
        for k in range(ROBOTS):
            if lane["fate"][k] == ACTIVE:
                r, phase = lane["r_R_N"][k], lane["t"] - lane["reversal_t"][k]
                lost += 1.0 - value(V, r[0], r[1], lane["heading"][k], phase, lane["t_go"], s)
        out[i] = lost * (s["score_goal"] + 0.5 * s["score_lost"])


def herd_potential(config: Config) -> Potential:
    """Minus what the robots of an arena will cost by the value table of the index policy."""
    settings = to_record(config)

    def potential(lanes: NDArray[Any]) -> NDArray[np.float64]:
        out = np.zeros(len(lanes))
        herd_costs(lanes, value_table(settings), settings, out)
        return -out

    return potential


def potential_of(task: Task, config: Config) -> Potential | None:
    """Minus the least cost to go with perfect information (thesis (4.10)), or None.

    For every task with a terminal cost of position and velocity, and for the herding of robots: the
    names tell.
    """
    if set(HERD) <= set(task.lane.names or ()):
        return herd_potential(config)
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
