from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy import stats as scipy_stats

from eval.stats import (
    compare,
    interquartile_mean,
    mean_interval,
    percentile,
    probability_of_improvement,
)

COSTS = arrays(np.float64, st.integers(1, 30), elements=st.floats(0.0, 1e6))


@pytest.mark.parametrize("draw", ["standard_normal", "standard_exponential"])
def test_a_95_percent_interval_holds_the_true_mean_in_95_percent_of_experiments(draw):
    rng = np.random.default_rng(1)
    true_mean = {"standard_normal": 0.0, "standard_exponential": 1.0}[draw]
    held = 0
    experiments = 400
    for _ in range(experiments):
        low, high = mean_interval(getattr(rng, draw)(60), resamples=499)
        held += low <= true_mean <= high
    deviation = np.sqrt(0.95 * 0.05 / experiments)
    assert 0.95 - 4 * deviation < held / experiments < 0.95 + 4 * deviation


def test_the_interval_of_normal_values_is_students_t_interval():
    x = np.random.default_rng(2).normal(5.0, 2.0, 1000)
    exact = scipy_stats.t.interval(0.95, len(x) - 1, x.mean(), scipy_stats.sem(x))
    np.testing.assert_allclose(mean_interval(x), exact, atol=0.03 * scipy_stats.sem(x) * 4)


def test_the_interval_of_a_heavy_tail_reaches_further_up_than_down():
    x = np.exp(2.0 * np.random.default_rng(3).standard_normal(500))
    low, high = mean_interval(x)
    assert high - x.mean() > 1.2 * (x.mean() - low)


def test_the_same_values_give_the_same_interval():
    x = np.random.default_rng(4).standard_exponential(100)
    assert mean_interval(x) == mean_interval(x)


def test_values_without_spread_have_an_interval_without_width():
    assert mean_interval([3.0] * 5) == (3.0, 3.0)
    assert mean_interval([0.0, 0.0]) == (0.0, 0.0)


@pytest.mark.parametrize("values", [[1.0], [1.0, np.inf], [1.0, np.nan]])
def test_no_interval_is_invented(values):
    assert mean_interval(values) is None


def test_the_interquartile_mean_ignores_a_quarter_at_either_end():
    x = [1e9, 2.0, 4.0, 3.0, 5.0, -1e9, 1e8, -1e8]
    assert interquartile_mean(x) == 3.5
    assert interquartile_mean([*x[1:], np.inf]) == 3.5


@given(COSTS, st.floats(1.0, 100.0))
def test_a_percentile_is_a_value_that_so_many_do_not_exceed(costs, share):
    value = percentile(costs, share)
    assert value in costs
    assert np.mean(costs <= value) >= share / 100 - 1e-12
    assert np.mean(costs < value) < share / 100 + 1e-12


def test_a_percentile_beyond_the_diverged_episodes_is_infinite():
    costs = [1.0] * 90 + [np.inf] * 10
    assert percentile(costs, 90.0) == 1.0
    assert percentile(costs, 95.0) == np.inf


def test_the_probability_of_improvement_counts_seeds_and_halves_ties():
    assert probability_of_improvement([1.0, 2.0, 3.0, 9.0], [2.0, 2.0, 1.0, 9.5]) == 0.625


def test_the_probability_of_improvement_of_normal_costs_is_the_normal_distribution_function():
    rng = np.random.default_rng(5)
    x, y = rng.normal(0.0, 1.0, 40_000), rng.normal(0.5, 1.0, 40_000)
    exact = scipy_stats.norm.cdf(0.5 / np.sqrt(2.0))
    assert probability_of_improvement(x, y) == pytest.approx(exact, abs=4 * 0.5 / 200)


@given(COSTS)
def test_nothing_improves_on_itself(costs):
    against = compare(costs, costs)
    assert (against.mean, against.better) == (0.0, 0.5)
    assert against.interval in (None, (0.0, 0.0))


def test_pairing_takes_away_what_the_seeds_have_in_common():
    rng = np.random.default_rng(6)
    seeds = 1000.0 * rng.standard_exponential(300)
    x, y = seeds + rng.normal(-1.0, 1.0, 300), seeds
    against = compare(x, y)
    assert against.mean == pytest.approx(np.mean(x) - np.mean(y))
    assert against.interval[0] < -1.0 < against.interval[1] < 0.0
    assert against.interval[1] - against.interval[0] < 0.5


def test_a_diverged_episode_makes_the_mean_difference_infinite_but_not_the_rank():
    against = compare([1.0, np.inf, 3.0], [2.0, 5.0, 4.0])
    assert against.mean == np.inf
    assert against.interval is None
    assert against.better == pytest.approx(2 / 3)
    assert compare([np.inf, 1.0], [np.inf, 2.0]).mean == -0.5


def test_pairs_must_be_of_the_same_seeds():
    with pytest.raises(ValueError, match="same seeds on both sides, got 3 and 2"):
        compare([1.0, 2.0, 3.0], [1.0, 2.0])
    with pytest.raises(ValueError, match="at least one value"):
        compare([], [])
