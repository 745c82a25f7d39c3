"""Assignment against scipy's, and the thesis's rule for a single sighting."""

import math

import numpy as np
import pytest
from scipy.optimize import linear_sum_assignment

from visenvs.estimation.association import (
    IGNORED,
    NEW,
    assign,
    assign_scratch,
    by_label,
    set_aside,
)

pytestmark = pytest.mark.kernel


def choose(values, threshold=9.21, count=None):
    values = np.array(values, float)
    choice = np.full(len(values), -7)
    work = np.full(assign_scratch(*values.shape), np.nan)
    assign(values, len(values) if count is None else count, threshold, choice, work)
    return choice


def total(values, choice, threshold):
    return sum(threshold if j == NEW else values[i, j] for i, j in enumerate(choice))


def scipys(values, threshold):
    """Least total of z-test values where no track costs the threshold."""
    rows, columns = values.shape
    padded = np.full((rows, columns + rows), threshold)
    padded[:, :columns] = np.where(values <= threshold, values, 1e6)
    picked = linear_sum_assignment(padded)
    return padded[picked].sum(), np.where(picked[1] < columns, picked[1], NEW)


@pytest.mark.parametrize("seed", range(40))
def test_the_best_of_all_assignments(seed):
    rng = np.random.default_rng(seed)
    rows, columns = rng.integers(1, 9), rng.integers(1, 7)
    values = rng.chisquare(2, (rows, columns)) * rng.choice([0.5, 2.0, 6.0])
    values[rng.random(values.shape) < 0.2] = math.inf
    choice = choose(values)
    best, expected = scipys(values, 9.21)
    assert total(values, choice, 9.21) == pytest.approx(best, rel=1e-12)
    assert choice.tolist() == expected.tolist()
    taken = choice[choice != NEW]
    assert len(set(taken)) == len(taken)
    assert all(values[i, j] <= 9.21 for i, j in enumerate(choice) if j != NEW)


@pytest.mark.parametrize("seed", range(10))
def test_a_single_sighting_goes_to_its_nearest_track_or_to_none(seed):
    """(3.6)."""
    values = np.random.default_rng(seed).exponential(4.0, (1, 6))
    nearest = int(values.argmin())
    assert choose(values, 3.0)[0] == (nearest if values.min() <= 3.0 else NEW)


def test_ties_of_equal_sightings_give_each_track_once():
    assert sorted(choose(np.ones((4, 3)))) == [NEW, 0, 1, 2]


def test_who_comes_second_may_win_where_the_sum_is_less():
    """Track 0 is nearest to both; track 1 will do for the first one only."""
    assert choose([[1.0, 2.0], [1.5, 50.0]]).tolist() == [1, 0]


def test_staying_alone_may_be_the_best():
    assert choose([[0.1, 9.0], [9.0, 400.0]]).tolist() == [0, NEW]


@pytest.mark.parametrize("bad", [math.inf, math.nan])
def test_without_a_track_all_are_new(bad):
    assert choose(np.full((3, 2), bad)).tolist() == [NEW] * 3


def test_rows_beyond_the_count_are_left_alone():
    assert choose([[1.0], [0.5]], count=1).tolist() == [0, -7]
    assert choose([[1.0], [0.5]], count=0).tolist() == [-7, -7]


def test_the_threshold_itself_passes():
    assert choose([[3.0]], 3.0).tolist() == [0]
    assert choose([[np.nextafter(3.0, 4.0)]], 3.0).tolist() == [NEW]


def test_a_second_sighting_of_a_taken_track_is_set_aside():
    values = np.array([[0.5, 40.0], [0.8, 40.0], [30.0, 40.0]])
    choice = choose(values)
    set_aside(values, 3, 9.21, choice)
    assert choice.tolist() == [0, IGNORED, NEW]


def test_labels_find_living_tracks():
    choice, owner, alive = np.full(4, -7), np.array([2.0, 0.0, 1.0]), np.array([1.0, 0.0, 1.0])
    by_label(owner, alive, np.array([1.0, 0.0, 2.0, 9.0]), 3, choice)
    assert choice.tolist() == [2, NEW, 0, -7]
