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

from visenvs.core.config import Config, field_types, to_record
from visenvs.core.lanes import Task

from .guesses import herd_guess, map_costs, passing_costs, place_costs, terminal_costs

Potential = Callable[[NDArray[Any]], NDArray[np.float64]]
# Each guess with the fields of the lane and the settings that it reads.
GUESSES: tuple[tuple[tuple[str, ...], tuple[str, ...], Callable[..., None]], ...] = (
    (("r_TV_N", "v_V_N", "t_go"), ("s_x", "s_v"), terminal_costs),
    (
        ("r_V_N", "v_V_N", "r_O_N", "v_O_N", "radius", "blocks", "closest"),
        ("waypoint", "margin", "s_x", "s_violation", "s_divergence"),
        passing_costs,
    ),
    (
        ("leader", "v_V_N", "heading", "tracking_error", "offset_F", "offset_rate"),
        ("s_r",),
        place_costs,
    ),
    (("r_R_N", "heading", "reversal_t", "fate"), ("score_goal", "score_lost"), herd_guess),
    (
        ("map_error", "map_deviation", "coverage", "t_go"),
        ("w_error", "w_uncertainty", "w_uncovered", "t_f"),
        map_costs,
    ),
)


def potential_of(task: Task, config: Config) -> Potential | None:
    """Minus the guess whose names the task's lanes and settings have; None without one."""
    lane, known = set(task.lane.names or ()), set(field_types(type(config)))
    for fields, names, guess in GUESSES:
        if set(fields) <= lane and set(names) <= known:
            return _negative(guess, to_record(config))
    return None


def _negative(guess: Callable[..., None], settings: NDArray[Any]) -> Potential:
    def potential(lanes: NDArray[Any]) -> NDArray[np.float64]:
        out = np.zeros(len(lanes))
        guess(lanes, settings, out)
        return -out

    return potential
