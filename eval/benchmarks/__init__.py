"""Throughput, one file for each group, with `GROUP`, `WANTS` and `rows`; and how it is measured.

Everything is measured in CPU time. Sides that are compared take turns, so that a busy machine
slows both alike, and their ratio is the median over the rounds.
"""

from __future__ import annotations

import importlib
import pkgutil
import statistics
import sys
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import ModuleType

ENV_ID = "visenvs/Rendezvous-v0"
SEEDS = range(1024)  # lane i flies the i-th, in every group

Portion = Callable[[], int]  # does a part of the work, and says how many units that was
Rates = Mapping[str, list[float]]  # units per CPU second by side, one for each round


@dataclass(frozen=True)
class Budget:
    """How long to measure: `rounds` turns of at least `seconds` of CPU time for each side."""

    seconds: float = 0.3
    rounds: int = 7


@dataclass(frozen=True)
class Row:
    """One measured figure.

    Attributes:
        id: path of plain words; it does not change once published.
        value: median over the rounds, in `unit`.
        reference: id of the row that it is compared with, if any.
        ratio: value over the reference's, round by round, and of that the median.
    """

    id: str
    value: float
    unit: str
    reference: str | None
    ratio: float | None


def groups() -> dict[str, ModuleType]:
    """Every group by name: a module with `WANTS` (one line) and `rows(budget) -> list[Row]`."""
    names = [info.name for info in pkgutil.iter_modules(__path__)]
    modules = [importlib.import_module(f"{__name__}.{name}") for name in names]
    return {module.GROUP: module for module in modules}


def race(sides: Mapping[str, Portion], budget: Budget) -> Rates:
    """The rates of all sides in every round, after one portion of each that may compile."""
    for portion in sides.values():
        portion()
    rates: dict[str, list[float]] = {side: [] for side in sides}
    order = list(sides)
    for _ in range(budget.rounds):
        for side in order:
            rates[side].append(_rate(sides[side], budget.seconds))
        order.reverse()
    return rates


def row(side: str, unit: str, rates: Rates, reference: str | None = None) -> Row:
    """The figure of one side, compared with another side of the same race."""
    value = statistics.median(rates[side])
    if reference is None:
        return Row(side, value, unit, None, None)
    pairs = zip(rates[side], rates[reference], strict=True)
    return Row(side, value, unit, reference, statistics.median(a / b for a, b in pairs))


def left_out(row_id: str, why: str) -> None:
    """Say on stderr that a row is missing, and what would bring it back."""
    print(f"{row_id}: n/a: {why}", file=sys.stderr)


def _rate(portion: Portion, seconds: float) -> float:
    began, units = time.process_time(), 0
    while True:
        units += portion()
        spent = time.process_time() - began
        if spent > 0.0 and spent >= seconds:
            return units / spent
