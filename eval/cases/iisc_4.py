"""Table IV of the IISc report: two obstacles, differential geometric guidance (DGG)."""

from __future__ import annotations

from . import Row
from ._iisc import entry_rows

CASE = "iisc-4"
EPISODES = 1000  # bands are some standard errors wide then
PAPER = {
    "1": (48.6, 68.8, 82.5, 88.5),
    "2": (51.9, 75.0, 88.5, 95.6),
    "all": (31.4, 54.6, 74.3, 84.3),
}


def rows(episodes: int) -> list[Row]:
    """Success bands S-1 to S-4 of every entry, percent: both obstacles, and one at a time."""
    return entry_rows(CASE, "two", "dgg", episodes, PAPER)
