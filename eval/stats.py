"""Statistics of episode costs: means with intervals, robust middles, paired comparisons.

Costs can have heavy tails, so that a mean alone says little: the median, the interquartile mean
and the 95th percentile stand beside it everywhere. `scipy.stats` is slower to import than all the
rest together, so that it waits for the first figure.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

LEVEL = 0.95  # of every interval
RESAMPLES = 9999
SEED = 2008  # of the bootstrap, fixed so that a table can be made again
BATCH = 500  # resamples at a time, to bound memory

Interval = tuple[float, float]


class Comparison(NamedTuple):
    """A policy against a reference on the same seeds.

    Attributes:
        mean: mean of policy - reference; infinite or NaN if an episode of either diverged.
        interval: 95 % bootstrap interval of that mean; None where it cannot be had.
        better: probability of improvement, see `probability_of_improvement`.
    """

    mean: float
    interval: Interval | None
    better: float


def mean_interval(values: ArrayLike, resamples: int = RESAMPLES) -> Interval | None:
    """95 % bootstrap interval of the mean of values (n,), bias-corrected and accelerated (BCa).

    BCa follows the skewness of a heavy tail, which the plain percentile interval does not.

    Returns:
        (low, high), or None for fewer than two values or where one is not finite.
    """
    from scipy import stats

    x = _one_dimensional(values)
    if len(x) < 2 or not np.isfinite(x).all():
        return None
    if np.ptp(x) <= 1e-12 * np.abs(x).max():  # BCa is undefined without spread
        return float(x.min()), float(x.max())
    interval = stats.bootstrap(
        (x,),
        np.mean,
        confidence_level=LEVEL,
        n_resamples=resamples,
        batch=BATCH,
        method="BCa",
        rng=np.random.default_rng(SEED),
    ).confidence_interval
    return float(interval.low), float(interval.high)


def interquartile_mean(values: ArrayLike) -> float:
    """Mean of the middle half of values (n,): a quarter is cut from either end."""
    from scipy import stats

    return float(stats.trim_mean(_one_dimensional(values), 0.25))


def percentile(values: ArrayLike, share: float) -> float:
    """Smallest of the values (n,) that `share` percent of them do not exceed; may be infinite."""
    return float(np.percentile(_one_dimensional(values), share, method="inverted_cdf"))


def probability_of_improvement(costs: ArrayLike, reference: ArrayLike) -> float:
    """Share of seeds on which the policy costs less than the reference, ties counted half.

    Paired: each seed is compared with itself, not with every other seed.
    """
    x, y = _paired(costs, reference)
    return float(np.mean(np.where(x == y, 0.5, x < y)))


def compare(costs: ArrayLike, reference: ArrayLike) -> Comparison:
    """Policy minus reference, paired by seed; both of shape (n,), in the same order of seeds.

    A seed on which both costs are infinite counts as no difference.
    """
    x, y = _paired(costs, reference)
    difference = np.subtract(x, y, out=np.zeros_like(x), where=x != y)
    with np.errstate(invalid="ignore"):  # infinity on both sides of different seeds
        mean = float(np.mean(difference))
    return Comparison(mean, mean_interval(difference), probability_of_improvement(x, y))


def _paired(first: ArrayLike, second: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    x, y = _one_dimensional(first), _one_dimensional(second)
    if x.shape != y.shape:
        raise ValueError(
            f"a paired comparison needs the same seeds on both sides, "
            f"got {len(x)} and {len(y)} values"
        )
    return x, y


def _one_dimensional(values: ArrayLike) -> NDArray[np.float64]:
    x = np.asarray(values, dtype=np.float64)
    if x.ndim != 1 or not len(x):
        raise ValueError(f"expected at least one value in one dimension, got shape {x.shape}")
    return x
