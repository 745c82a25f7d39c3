"""Figures 44 and 45 of the thesis (4.2.4): avoidance with and without the push for a better image.

Every relative position is overestimated by half. The thesis flies once: the estimated optimal law
enters the sphere of obstacle 1, one-step-ahead does not, and costs almost twice as much. It does
not say what is done inside an estimated sphere, where there are no tangents: here both aim abeam of
its centre. Without that (`cone-lq`) the estimated optimal law costs a seventh.

At the start obstacle 1 lies exactly ahead, so that the first image decides to which side the push
goes and how long it is, and 2 % of the flights fail by it: fewer than `LEAST` flights cannot tell.
"""

from __future__ import annotations

import numpy as np

from visenvs.core.units import FOOT

from . import Row, standard_error
from ._avoidance import fly, mean

CASE = "fig44"
LAWS = {"lq": "cone-lq-abeam", "osa": "cone-osa-abeam"}
BANDS = {"lq": (0.95, None), "osa": (None, 0.02)}
PAPER = {"lq": 1.0, "osa": 0.0}
LEAST = 1000  # flights, whatever is asked for


def rows(episodes: int) -> list[Row]:
    """Shares that enter the spheres, control efforts (ft^2/s^3), and the ratio of their means."""
    out: list[Row] = []
    effort, episodes = {}, max(episodes, LEAST)
    for name, law in LAWS.items():
        records = fly("thesis-4.2.4", law, episodes)
        entered = records["closest"] < records["radius"]
        effort[name] = records["control_cost"] / FOOT**2
        out.append(mean(f"{CASE}/{name}/violates_1", entered[:, 0], PAPER[name], *BANDS[name]))
        out.append(mean(f"{CASE}/{name}/violates_2", entered[:, 1]))
        out.append(mean(f"{CASE}/{name}/closest_1_ft", records["closest"][:, 0] / FOOT))
        out.append(mean(f"{CASE}/{name}/J_mean", effort[name]))
    ratio = float(effort["osa"].mean() / effort["lq"].mean())
    relative = [standard_error(values) / values.mean() for values in effort.values()]
    error = ratio * float(np.hypot(*relative))
    out.append(Row(f"{CASE}/J_ratio_of_means", 2.0, ratio, error, episodes, 1.5, 2.2))
    return out
