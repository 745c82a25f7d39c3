"""The papers' tables and figures: one file each, with its name `CASE` and its `rows`."""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Callable
from dataclasses import dataclass
from types import ModuleType

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Row:
    """One published figure beside ours.

    Attributes:
        id: path of plain words; it does not change once published.
        paper: the published figure, None where the paper gives a picture or only words.
        ours, se: our figure and its standard error (0 for a figure without chance).
        n: episodes or trials behind it.
        low, high: the band that we accept; both None where the figure is only reported.
    """

    id: str
    paper: float | None
    ours: float
    se: float
    n: int
    low: float | None = None
    high: float | None = None

    @property
    def ok(self) -> bool | None:
        """Whether our figure lies in the band; None without a band."""
        if self.low is None and self.high is None:
            return None
        low = -np.inf if self.low is None else self.low
        return bool(low <= self.ours <= (np.inf if self.high is None else self.high))


def cases() -> dict[str, ModuleType]:
    """Every case by name: a module with `rows(episodes)`.

    Some have `plot(folder, episodes)`, or `image_rows(episodes)`, the same on rendered pictures;
    EPISODES says how many it takes to tell inside a band from outside, where 100 are too few.
    """
    files = [info.name for info in pkgutil.iter_modules(__path__) if not info.name.startswith("_")]
    modules = [importlib.import_module(f"{__name__}.{name}") for name in files]
    return {module.CASE: module for module in modules}


def standard_error(
    values: NDArray[np.float64], statistic: Callable[..., NDArray[np.float64]] = np.mean
) -> float:
    """Bootstrap standard error of a statistic of values (n,), seed fixed; 0 for one value."""
    if len(values) < 2:
        return 0.0
    picks = np.random.default_rng(2008).integers(len(values), size=(2000, len(values)))
    return float(np.std(statistic(values[picks], axis=1), ddof=1))
