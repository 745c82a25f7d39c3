"""Table 5 of the thesis: average processing times of p %-ahead guidance (MATLAB, Core 2 Duo).

A decision has to be made within the control period of 0.1 s.
"""

from __future__ import annotations

from . import Row
from ._tracking import time_rows

CASE = "table5"
PAPER = {
    0: (0.000936, 0.0215),
    10: (0.37, 5.213),
    60: (12.483, 405.96),
    100: (34.594, 1134.0),
}  # p: first step, whole flight, s


def rows(episodes: int) -> list[Row]:
    """Both solvers for every published p."""
    return time_rows(CASE, "ahead", "p", episodes, PAPER)
