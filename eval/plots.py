"""Geometry of the page's plots: places on a logarithmic axis, paths of curves and clouds.

Places are percent of the plot's width from the left, or of its height from the bottom. Paths are
SVG in a box of 1000 by 1000 that the page stretches to the screen.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .stats import percentile

BOX = 1000
QUARTILES = (25.0, 75.0)
SPREAD = (5.0, 95.0)  # percentiles at the ends of the thin bar


@dataclass(frozen=True)
class LogAxis:
    """A logarithmic axis from `low` to `high`, both positive; what lies beyond sits on its end."""

    low: float
    high: float

    def at(self, values: float | NDArray[np.float64]) -> NDArray[np.float64]:
        """Places of values, percent."""
        inside = np.clip(values, self.low, self.high)
        return 100.0 * np.log(inside / self.low) / math.log(self.high / self.low)

    def ticks(self) -> list[tuple[float, str]]:
        """Place and label of every tick: decades, or 1, 2 and 5 where there are few of them."""
        first, last = math.floor(math.log10(self.low)), math.ceil(math.log10(self.high))
        steps = (1, 2, 5) if last - first <= 2 else (1,)
        stride = 1 if last - first <= 8 else 2
        marks = [m * 10.0**d for d in range(first, last + 1, stride) for m in steps]
        inside = [mark for mark in marks if self.low * 0.999 <= mark <= self.high * 1.001]
        return [(float(self.at(mark)), tick_label(mark)) for mark in inside]


def log_axis(values: Iterable[float]) -> LogAxis:
    """An axis that holds all finite positive values, from one 1, 2 or 5 times 10^n to another."""
    positive = [value for value in values if 0.0 < value < math.inf]
    if not positive:
        return LogAxis(0.1, 1.0)
    low, high = _round_down(min(positive)), _round_up(max(positive))
    return LogAxis(low, high if high > low else 10.0 * low)


def tick_label(value: float) -> str:
    """0.001, 0.5, 20, 1k, 500k, 1M."""
    for size, letter in ((1e9, "G"), (1e6, "M"), (1e3, "k")):
        if value >= size * 0.999:
            return f"{value / size:g}{letter}"
    return f"{value:g}"


def spread(costs: NDArray[np.float64]) -> tuple[float, float, float, float, float]:
    """5th percentile, lower quartile, median, upper quartile and 95th percentile of costs (n,)."""
    low, high = (percentile(costs, share) for share in SPREAD)
    lower, upper = (percentile(costs, share) for share in QUARTILES)
    return low, lower, float(np.median(costs)), upper, high


def step_path(costs: NDArray[np.float64], axis: LogAxis) -> str:
    """Share of episodes that cost no more, against the cost (n,): a staircase from 0 to 1."""
    x = np.rint(axis.at(np.sort(costs)) * BOX / 100).astype(int)
    y = BOX - np.rint(BOX * np.arange(1, len(x) + 1) / len(x)).astype(int)
    last = np.append(x[1:] != x[:-1], True)  # steps narrower than the drawing's grain become one
    stairs = "".join(f"H{i}V{j}" for i, j in zip(x[last], y[last], strict=True))
    return f"M0 {BOX}{stairs}H{BOX}"


def cloud_path(across: NDArray[np.float64], up: NDArray[np.float64], axis: LogAxis) -> str:
    """Dots of `up` (n,) against `across` (n,) on the same axis; coincident ones once."""
    x = np.rint(axis.at(across) * BOX / 100).astype(int)
    y = BOX - np.rint(axis.at(up) * BOX / 100).astype(int)
    return "".join(f"M{i} {j}h0" for i, j in sorted(set(zip(x.tolist(), y.tolist(), strict=True))))


def _round_down(value: float) -> float:
    decade = 10.0 ** math.floor(math.log10(value))
    return max((m * decade for m in (1, 2, 5) if m * decade <= value), default=decade)


def _round_up(value: float) -> float:
    decade = 10.0 ** math.floor(math.log10(value))
    return min(m * decade for m in (1, 2, 5, 10) if m * decade >= value or m == 10)
