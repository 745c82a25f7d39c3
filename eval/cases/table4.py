"""Table 4 of the thesis: average costs of p %-ahead guidance, see `table2` for the two solvers."""

from __future__ import annotations

from . import Row
from ._tracking import Bands, Published, cost_rows

CASE = "table4"
EPISODES = 1000  # bands are some standard errors wide then
PAPER: dict[int, Published] = {
    0: {"Jf": 50.865, "Jc": 5.831, "J": 56.696},
    10: {"Jf": 1.221, "Jc": 24.307, "J": 25.529},
    60: {"Jf": 1.402, "Jc": 7.082, "J": 8.485},
    100: {"Jf": 1.867, "Jc": 7.558, "J": 9.424},
}
BANDS: Bands = {
    "exact": {60: {"J": (4.6, 5.1)}},
    "gauss_seidel": {10: {"J": (24.8, 25.8)}, 60: {"J": (8.6, 9.6)}},
}


def rows(episodes: int) -> list[Row]:
    """Both solvers for every published p."""
    return cost_rows(CASE, "ahead", "p", episodes, PAPER, BANDS)
