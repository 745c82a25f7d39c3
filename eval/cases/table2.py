"""Table 2 of the thesis: average costs of n-step-ahead guidance.

The published "optimal" plan of n = 100 is a truncated iteration, about twice as costly as the
optimum of its own problem: `gauss_seidel` repeats it, `exact` solves the problem.
"""

from __future__ import annotations

from . import Row
from ._tracking import Bands, Published, cost_rows

CASE = "table2"
EPISODES = 1000  # bands are some standard errors wide then
PAPER: dict[int, Published] = {
    0: {"Jf": 50.865, "Jc": 5.831, "J": 56.696},
    1: {"Jf": 14.917, "Jc": 7.873, "J": 22.791},
    50: {"Jf": 1.678, "Jc": 7.705, "J": 9.383},
    100: {"Jf": 1.867, "Jc": 7.5585, "J": 9.424},
}
BOTH = {0: {"Jf": (46.0, 55.0)}, 1: {"J": (19.0, 23.0)}}
BANDS: Bands = {
    "exact": {**BOTH, 50: {"J": (4.6, 5.1)}, 100: {"J": (4.6, 5.1)}},
    "gauss_seidel": {**BOTH, 100: {"J": (9.3, 10.5)}},
}


def rows(episodes: int) -> list[Row]:
    """Both solvers for every published n."""
    return cost_rows(CASE, "nsa", "n", episodes, PAPER, BANDS)
