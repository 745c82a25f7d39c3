"""Perfect information as an estimator: mean = truth, covariance = 0."""

from __future__ import annotations

from visenvs.core.compile import kernel


@kernel
def reveal(truth, mean, P):
    """Write the true state (n,) into the mean and zeros into the covariance (n, n)."""
    for i in range(truth.shape[0]):
        mean[i] = truth[i]
        for j in range(truth.shape[0]):
            P[i, j] = 0.0
