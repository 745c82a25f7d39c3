"""Table II of the IISc report: one obstacle, differential geometric guidance (DGG)."""

from __future__ import annotations

from . import Row
from ._iisc import entry_rows

CASE = "iisc-2"
EPISODES = 1000  # bands are some standard errors wide then
PAPER = {"all": (51.3, 73.8, 84.1, 90.5)}


def rows(episodes: int) -> list[Row]:
    """Success bands S-1 to S-4 of every entry, percent."""
    return entry_rows(CASE, "one", "dgg", episodes, PAPER)
