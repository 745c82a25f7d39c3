"""Perfect information."""

import numpy as np
import pytest

from visenvs.estimation.truth import reveal

pytestmark = pytest.mark.kernel


@pytest.mark.parametrize("n", [3, 6])
def test_the_mean_is_the_truth_and_nothing_is_uncertain(n):
    truth, mean, P = np.arange(1.0, n + 1), np.full(n, np.nan), np.full((n, n), np.nan)
    reveal(truth, mean, P)
    assert np.array_equal(mean, truth)
    assert np.array_equal(P, np.zeros((n, n)))
    mean[0] = -1.0
    assert truth[0] == 1.0
