"""Table III of the IISc report: one obstacle, nonlinear geometric guidance (NGG), as Table II."""

from __future__ import annotations

from . import Row
from ._iisc import entry_rows

CASE = "iisc-3"
EPISODES = 1000  # bands are some standard errors wide then
PAPER = {"all": (50.1, 72.5, 84.1, 91.2)}


def rows(episodes: int) -> list[Row]:
    """Success bands S-1 to S-4 of every entry, percent."""
    return entry_rows(CASE, "one", "ngg", episodes, PAPER)
