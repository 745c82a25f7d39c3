"""Table V of the IISc report: two obstacles, nonlinear geometric guidance (NGG), as Table IV.

As printed. The S-2 figures of the two obstacles look exchanged: 70 and 79.3 would fit Table IV.
"""

from __future__ import annotations

from . import Row
from ._iisc import entry_rows

CASE = "iisc-5"
EPISODES = 1000  # bands are some standard errors wide then
PAPER = {
    "1": (46.8, 79.3, 80.4, 87.8),
    "2": (55.3, 70.0, 90.5, 96.4),
    "all": (27.6, 57.5, 73.9, 84.7),
}


def rows(episodes: int) -> list[Row]:
    """Success bands S-1 to S-4 of every entry, percent: both obstacles, and one at a time."""
    return entry_rows(CASE, "two", "ngg", episodes, PAPER)
