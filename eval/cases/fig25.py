"""Figure 25 of the thesis (3.5.1): control effort of sequential PN against minimum effort, in feet.

The thesis flies once: 40.409 against 34.338, and PN enters the sphere of obstacle 2 at about 5 s.
Here both fly the same seeds, with the latch that the published figures need.
"""

from __future__ import annotations

from visenvs.core.units import FOOT

from . import Row
from ._avoidance import fly, mean, median

CASE = "fig25"
LAWS = {"pn": "cone-pn", "meg": "cone-meg"}
PAPER = {"pn": 40.409, "meg": 34.338}  # ft^2/s^3
BANDS = {"pn": (37.0, 47.0), "meg": (31.0, 39.0)}
SECOND = 1  # index of obstacle 2


def rows(episodes: int) -> list[Row]:
    """Efforts, their paired ratio, misses (ft) and the closest approach to obstacle 2 (ft, s)."""
    flown = {name: fly("thesis-3.5.1", law, episodes) for name, law in LAWS.items()}
    effort = {name: records["control_cost"] / FOOT**2 for name, records in flown.items()}
    near = {name: records["closest"][:, SECOND] / FOOT for name, records in flown.items()}
    out = [median(f"{CASE}/{n}/J_median", effort[n], PAPER[n], *BANDS[n]) for n in LAWS]
    ratio = effort["meg"] / effort["pn"]
    out.append(median(f"{CASE}/ratio_median", ratio, PAPER["meg"] / PAPER["pn"], 0.78, 0.90))
    out.append(mean(f"{CASE}/meg_better", ratio < 1.0, 1.0, 0.8))
    for name, records in flown.items():
        miss = float(records["miss_distance"].max() / FOOT)
        out.append(Row(f"{CASE}/{name}/miss_ft_max", None, miss, 0.0, episodes, None, 0.01))
        out.append(mean(f"{CASE}/{name}/closest_2_ft", near[name]))
        out.append(mean(f"{CASE}/{name}/closest_2_s", records["t_closest"][:, SECOND]))
    gain = near["meg"] - near["pn"]
    out.append(mean(f"{CASE}/closest_2_ft_meg_more", gain, None, 0.2, 0.5))
    return out
