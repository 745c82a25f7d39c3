"""Figure 50 of the thesis: how the time to plan grows with the steps that it looks ahead.

The thesis fits a parabola, (4.72). One evaluation of the cost with its exact gradient is linear in
n, and so is the minimum as long as the number of evaluations does not grow.
"""

from __future__ import annotations

import numpy as np

from . import Row
from ._tracking import seconds

CASE = "fig50"
AHEAD = (12, 25, 50, 100)
FLIGHTS = 20


def rows(_episodes: int) -> list[Row]:
    """The exponent of time against n, fitted to first decisions."""
    times = np.array([seconds(f"nsa-{n}", FLIGHTS)[0] for n in AHEAD])
    fits = [np.polyfit(np.log(AHEAD), np.log(each), 1)[0] for each in times.T]
    mean = float(np.polyfit(np.log(AHEAD), np.log(times.mean(axis=1)), 1)[0])
    error = float(np.std(fits, ddof=1) / np.sqrt(FLIGHTS))
    return [Row(f"{CASE}/exact/exponent", 2.0, mean, error, FLIGHTS)]
