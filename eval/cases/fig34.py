"""Figure 34 of the thesis (3.6): a balloon in flight, in three readings of its text; in feet.

The text contradicts itself: the filter starts at a range of 400 ft, and the range is underestimated
by 100 ft; but at the starting point the balloon is 308 ft away. Three readings: 400 ft there
(`over`); 208 ft there, 100 ft too little (`under`); 400 ft where the range is 500 ft, 195 ft before
the starting point (`early`). The flight kept 100 ft.
"""

from __future__ import annotations

from typing import Any

from visenvs.core.registry import load_task
from visenvs.core.units import FOOT

from . import Row
from ._avoidance import fly, mean

CASE = "fig34"
LAW = "cone-meg"
BEFORE = 195 * FOOT


def readings() -> dict[str, tuple[tuple[str, Any], ...]]:
    """What each reading changes of the scenario."""
    balloon: Any = load_task("visenvs/Avoidance-v0").scenarios["balloon"]
    goal, (ahead, *rest) = balloon.waypoint, balloon.obstacle_x
    early = (
        ("waypoint", (goal[0] + BEFORE, *goal[1:])),
        ("obstacle_x", (ahead + BEFORE, *rest)),
    )
    return {"over": (), "under": (("prior_first", 208 * FOOT),), "early": early}


def rows(episodes: int) -> list[Row]:
    """The least distance from the balloon (ft), and the share of flights that keep 100 ft."""
    out: list[Row] = []
    for name, changes in readings().items():
        closest = fly("balloon", LAW, episodes, *changes)["closest"][:, 0] / FOOT
        out.append(mean(f"{CASE}/{name}/closest_ft", closest, 100.0))
        out.append(mean(f"{CASE}/{name}/keeps_100_ft", closest >= 100.0, 1.0))
    return out
