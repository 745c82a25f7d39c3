"""The filter's kernels against the textbook: gain, innovation covariance and Joseph form."""

import numpy as np
import pytest
from scipy import stats

from visenvs.estimation.ekf import (
    factorise,
    pack_lower,
    predict_covariance,
    update_scalar,
    update_sequential,
    update_vector,
    white_acceleration,
    whiten,
)

pytestmark = pytest.mark.kernel

PROBLEMS = [(n, m, seed) for n, m in [(1, 1), (2, 1), (3, 2), (6, 3)] for seed in range(5)]


def covariance(rng, n):
    """A well-conditioned random covariance."""
    root = rng.normal(size=(n, n))
    return root @ root.T + 0.1 * np.eye(n)


def problem(n, m, seed):
    rng = np.random.default_rng(seed)
    return (
        rng.normal(size=n),
        covariance(rng, n),
        rng.normal(size=(m, n)),
        rng.normal(size=m),
        covariance(rng, m),
    )


def textbook(x, P, H, residual, R):
    """Updated state, covariance in Joseph form, and NIS (thesis (2.17)-(2.19))."""
    S = H @ P @ H.T + R
    K = P @ H.T @ np.linalg.inv(S)
    keep = np.eye(len(x)) - K @ H
    return (
        x + K @ residual,
        keep @ P @ keep.T + K @ R @ K.T,
        residual @ np.linalg.solve(S, residual),
    )


def vector_update(x, P, H, residual, R, gate=0.0):
    """The kernel on copies: state, covariance, NIS."""
    n, m = len(x), len(residual)
    x, P = x.copy(), P.copy()
    nis = update_vector(
        x, P, H, residual.copy(), R, gate, np.empty((n, m)), np.empty(m * (m + 1) // 2)
    )
    return x, P, nis


def lower(packed, n):
    L = np.zeros((n, n))
    L[np.tril_indices(n)] = packed
    return L


def factor_of(A):
    packed = np.empty(len(A) * (len(A) + 1) // 2)
    pack_lower(A, packed)
    factorise(packed, len(A))
    return packed


def test_white_acceleration_spreads_position_and_velocity_as_its_integral_does():
    """q times the integral of (T - t, 1)' (T - t, 1) over T; Gauss's rule is exact here."""
    q, T = 0.3, 0.7
    nodes, weights = np.polynomial.legendre.leggauss(3)
    moves = np.stack([0.5 * T * (1.0 - nodes), np.ones(3)])
    Q = q * (moves * (0.5 * T * weights)) @ moves.T
    assert white_acceleration(q, T) == pytest.approx((Q[0, 0], Q[0, 1], Q[1, 1]), rel=1e-14)


@pytest.mark.parametrize("n", [1, 2, 3, 6])
def test_predicted_covariance(n):
    rng = np.random.default_rng(n)
    P, Q, Phi = covariance(rng, n), covariance(rng, n), rng.normal(size=(n, n))
    expected = Phi @ P @ Phi.T + Q
    predict_covariance(P, Phi, Q, np.empty((n, n)))
    assert np.allclose(P, expected, rtol=1e-12, atol=1e-12)
    assert np.array_equal(P, P.T)


@pytest.mark.parametrize(("n", "m", "seed"), PROBLEMS)
def test_scalar_update(n, m, seed):
    x, P, H, residual, R = problem(n, m, seed)
    i = m - 1
    expected_x, expected_P, _ = textbook(x, P, H[[i]], residual[[i]], R[[i]][:, [i]])
    expected_S = (H @ P @ H.T + R)[i, i]
    S = update_scalar(x, P, H, i, residual[i], R[i, i], np.empty(n))
    assert S == pytest.approx(expected_S, rel=1e-12)
    assert np.allclose(x, expected_x, rtol=1e-10, atol=1e-10)
    assert np.allclose(P, expected_P, rtol=1e-10, atol=1e-10)
    assert np.array_equal(P, P.T)


@pytest.mark.parametrize(("n", "m", "seed"), PROBLEMS)
def test_vector_update_with_correlated_noise(n, m, seed):
    x, P, H, residual, R = problem(n, m, seed)
    expected = textbook(x, P, H, residual, R)
    got = vector_update(x, P, H, residual, R)
    for ours, theirs in zip(got, expected, strict=True):
        assert np.allclose(ours, theirs, rtol=1e-10, atol=1e-10)
    assert np.array_equal(got[1], got[1].T)


def sequential_update(x, P, H, residual, variance, gate=0.0):
    """The kernel on copies: state, covariance, NIS."""
    m, n = H.shape
    x, P, B, S = x.copy(), P.copy(), np.empty((m, n)), np.empty(m)
    return x, P, update_sequential(x, P, H, residual.copy(), variance, gate, B, S)


@pytest.mark.parametrize(("n", "m", "seed"), PROBLEMS)
def test_sequential_update_equals_the_vector_update(n, m, seed):
    x, P, H, residual, R = problem(n, m, seed)
    variance = np.diag(R).copy()
    expected = vector_update(x, P, H, residual, np.diag(variance))
    got = sequential_update(x, P, H, residual, variance)
    for ours, theirs in zip(got, expected, strict=True):
        assert np.allclose(ours, theirs, rtol=1e-10, atol=1e-10)
    assert np.array_equal(got[1], got[1].T)


@pytest.mark.parametrize(("n", "m", "seed"), PROBLEMS)
def test_the_order_of_independent_measurements_does_not_matter(n, m, seed):
    x, P, H, residual, R = problem(n, m, seed)
    variance = np.diag(R).copy()
    forwards = sequential_update(x, P, H, residual, variance)
    backwards = sequential_update(
        x, P, H[::-1].copy(), residual[::-1].copy(), variance[::-1].copy()
    )
    for ours, theirs in zip(forwards, backwards, strict=True):
        assert np.allclose(ours, theirs, rtol=1e-10, atol=1e-10)


def test_correlation_of_the_noise_matters():
    x, P, H, residual, R = problem(3, 2, 1)
    correlated = vector_update(x, P, H, residual, R)
    independent = vector_update(x, P, H, residual, np.diag(np.diag(R)))
    assert np.abs(correlated[0] - independent[0]).max() > 1e-3


@pytest.mark.parametrize("kind", ["vector", "sequential"])
def test_the_gate_leaves_out_what_is_too_far(kind):
    x, P, H, residual, R = problem(3, 2, 2)
    variance = np.diag(R).copy()
    R = R if kind == "vector" else np.diag(variance)
    nis = textbook(x, P, H, residual, R)[2]

    def gated(gate):
        if kind == "vector":
            return vector_update(x, P, H, residual, R, gate)
        return sequential_update(x, P, H, residual, variance, gate)

    inside, outside = gated(np.sqrt(nis) * (1 + 1e-9)), gated(np.sqrt(nis) * (1 - 1e-9))
    assert np.array_equal(inside[0], gated(0.0)[0])
    assert np.array_equal(outside[0], x)
    assert np.array_equal(outside[1], P)
    assert outside[2] == pytest.approx(nis, rel=1e-12)


def test_the_innovation_is_returned_white():
    x, P, H, residual, R = problem(3, 2, 3)
    white = residual.copy()
    update_vector(x.copy(), P.copy(), H, white, R, 0.0, np.empty((3, 2)), np.empty(3))
    assert np.allclose(np.linalg.cholesky(H @ P @ H.T + R) @ white, residual, rtol=1e-12)


def test_a_measurement_told_twice_without_noise_counts_once():
    """S is singular then: the second row carries no information, and nothing blows up."""
    x, P, H, residual, _ = problem(3, 1, 4)
    once = textbook(x, P, H, residual, np.zeros((1, 1)))
    again = np.vstack([H, H]), np.repeat(residual, 2)
    for twice in (
        vector_update(x, P, *again, np.zeros((2, 2))),
        sequential_update(x, P, *again, np.zeros(2)),
    ):
        assert np.allclose(twice[0], once[0], rtol=1e-6)
        assert np.allclose(twice[1], once[1], atol=1e-6)


@pytest.mark.parametrize("n", [1, 2, 3, 6])
def test_packed_cholesky_is_numpys(n):
    A = covariance(np.random.default_rng(n), n)
    assert np.allclose(lower(factor_of(A), n), np.linalg.cholesky(A), rtol=1e-12, atol=1e-13)


@pytest.mark.parametrize("rank", [0, 1, 2, 3])
def test_singular_covariances_have_a_factor(rank):
    root = np.random.default_rng(rank).normal(size=(4, rank))
    A = root @ root.T
    L = lower(factor_of(A), 4)
    assert np.isfinite(L).all()
    assert np.allclose(L @ L.T, A, atol=1e-12)


def test_pivots_that_rounding_made_negative_count_as_zero():
    A = np.diag([1.0, -1e-18, 4.0])
    assert np.array_equal(lower(factor_of(A), 3), np.diag([1.0, 0.0, 2.0]))


@pytest.mark.parametrize("n", [1, 3, 6])
def test_whitened_length_is_the_nees(n):
    rng = np.random.default_rng(n)
    P, error = covariance(rng, n), rng.normal(size=n)
    out = np.empty(n)
    nees = whiten(factor_of(P), error, out)
    assert nees == pytest.approx(error @ np.linalg.solve(P, error), rel=1e-11)
    assert np.allclose(np.linalg.cholesky(P) @ out, error, rtol=1e-11)
    assert whiten(factor_of(P), error, error) == pytest.approx(nees, rel=1e-15)
    assert np.array_equal(error, out)


def test_perfect_information_has_no_nees():
    assert whiten(np.zeros(6), np.array([1.0, 2.0, 3.0]), np.empty(3)) == 0.0


@pytest.mark.parametrize("noise", [1.0, 1e-6])
def test_covariance_stays_symmetric_and_positive_over_thousands_of_updates(noise):
    rng = np.random.default_rng(5)
    n, m = 4, 2
    P, Q, x = 100.0 * np.eye(n), 1e-6 * np.eye(n), np.zeros(n)
    Phi, work = np.eye(n) + 0.1 * np.eye(n, k=2), np.empty((n, n))
    B, factor, R = np.empty((n, m)), np.empty(3), noise * np.eye(m)
    for _ in range(3000):
        predict_covariance(P, Phi, Q, work)
        update_vector(x, P, rng.normal(size=(m, n)), rng.normal(size=m), R, 0.0, B, factor)
        assert np.array_equal(P, P.T)
        assert np.linalg.eigvalsh(P)[0] > 0.0


def test_a_linear_filter_is_consistent():
    """NEES and NIS of a constant-velocity target, averaged over runs, lie in their 95 % bounds.

    Such a bound holds in 95 % of all steps; 40 steps allow for chance: at least 34 inside.
    """
    runs, steps, dt, q, r = 200, 40, 0.5, 0.02, 0.3
    rng = np.random.default_rng(6)
    Phi = np.array([[1.0, dt], [0.0, 1.0]])
    Q = q * np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]])
    H, start, root = np.array([[1.0, 0.0]]), np.diag([4.0, 1.0]), np.linalg.cholesky(Q)
    nees, nis = np.empty((runs, steps)), np.empty((runs, steps))
    work, B, one, white = np.empty((2, 2)), np.empty((2, 1)), np.empty(1), np.empty(2)
    for run in range(runs):
        truth, x, P = np.sqrt(np.diag(start)) * rng.normal(size=2), np.zeros(2), start.copy()
        for k in range(steps):
            truth = Phi @ truth + root @ rng.normal(size=2)
            x = Phi @ x
            predict_covariance(P, Phi, Q, work)
            residual = H @ (truth - x) + np.sqrt(r) * rng.normal(size=1)
            nis[run, k] = update_vector(x, P, H, residual, np.array([[r]]), 0.0, B, one)
            nees[run, k] = whiten(factor_of(P), x - truth, white)
    for values, degrees in ((nees, 2), (nis, 1)):
        low, high = stats.chi2.ppf([0.025, 0.975], degrees * runs) / runs
        mean = values.mean(axis=0)
        assert ((mean > low) & (mean < high)).sum() >= 34
    low, high = (
        stats.chi2.ppf([0.025, 0.975], nis.size) / nis.size
    )  # innovations are white: all count
    assert low < nis.mean() < high
