"""Table 3 of the thesis: average processing times of n-step-ahead guidance (MATLAB, Core 2 Duo).

A decision has to be made within the control period of 0.1 s.
"""

from __future__ import annotations

from . import Row
from ._tracking import time_rows

CASE = "table3"
PAPER = {
    0: (0.0002132, 0.0215),
    1: (0.0016, 0.1585),
    50: (8.6948, 543.84),
    100: (34.5938, 1134.0),
}  # n: first step, whole flight, s


def rows(episodes: int) -> list[Row]:
    """Both solvers for every published n."""
    return time_rows(CASE, "nsa", "n", episodes, PAPER)
