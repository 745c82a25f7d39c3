"""The factored filter equals the textbook's, keeps its sign in single precision, and forgets."""

import numpy as np
import pytest

from visenvs.estimation.ud import covariance, factorise, predict_leading, replace, update

pytestmark = pytest.mark.kernel


def belief(n, seed):
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(n, n))
    P, U, D = root @ root.T + 0.1 * np.eye(n), np.zeros((n, n)), np.zeros(n)
    factorise(P, U, D)
    return rng, rng.normal(size=n), P, U, D


def product(U, D):
    P = np.empty_like(U)
    covariance(U, D, P)
    return P


def test_factors_are_unit_upper_triangular_and_give_the_covariance_back():
    _, _, P, U, D = belief(9, 0)
    assert np.array_equal(np.diag(U), np.ones(9))
    assert not np.tril(U, -1).any()
    assert product(U, D) == pytest.approx(P, abs=1e-13)
    assert product(U, D) == pytest.approx(U @ np.diag(D) @ U.T, abs=1e-13)


def test_a_singular_covariance_has_factors_too():
    a = np.array([1.0, -2.0, 0.5])
    U, D = np.zeros((3, 3)), np.zeros(3)
    factorise(np.outer(a, a), U, D)
    assert product(U, D) == pytest.approx(np.outer(a, a), abs=1e-14)
    factorise(np.zeros((3, 3)), U, D)
    assert not D.any()


@pytest.mark.parametrize("seed", range(4))
def test_updates_are_kalmans(seed):
    rng, x, P, U, D = belief(8, seed)
    f, v, b = np.empty(8), np.empty(8), np.empty(8)
    for _ in range(5):
        h, residual = rng.normal(size=8), rng.normal()
        S = h @ P @ h + 0.3
        gain = P @ h / S
        expected = x + gain * residual
        P = P - np.outer(gain, gain) * S
        assert update(x, U, D, h, residual, 0.3, f, v, b) == pytest.approx(S, rel=1e-12)
        assert b == pytest.approx(gain * S, abs=1e-12)
        assert x == pytest.approx(expected, abs=1e-12)
        assert product(U, D) == pytest.approx(P, abs=1e-12)


@pytest.mark.parametrize("leading", [3, 8])
def test_a_prediction_moves_the_leading_states_and_their_correlations(leading):
    rng, _, P, U, D = belief(8, 5)
    F, G, q = rng.normal(size=(leading, leading)), rng.normal(size=(leading, 2)), np.array([2, 0.5])
    whole = np.eye(8)
    whole[:leading, :leading] = F
    expected = whole @ P @ whole.T
    expected[:leading, :leading] += G @ np.diag(q) @ G.T
    W, weight, column = np.empty((leading, leading + 2)), np.empty(leading + 2), np.empty(leading)
    predict_leading(U, D, F, G, q, W, weight, column)
    assert product(U, D) == pytest.approx(expected, abs=1e-11)


@pytest.mark.parametrize("j", [0, 4, 7])
def test_a_replaced_state_is_new_and_the_others_know_what_they_knew(j):
    _, _, P, U, D = belief(8, 6)
    replace(U, D, j, 25.0, np.empty(8))
    expected = P.copy()
    expected[j], expected[:, j], expected[j, j] = 0.0, 0.0, 25.0
    assert product(U, D) == pytest.approx(expected, abs=1e-12)


def test_single_precision_keeps_its_sign_where_josephs_form_loses_it():
    """Bierman's example: two almost equal, almost exact measurements of a state hardly known."""
    e, r, one = np.float32(1e-4), np.float32(1e-10), np.float32(1.0)
    P, U, D = np.eye(3, dtype=np.float32), np.eye(3, dtype=np.float32), np.ones(3, np.float32)
    x = np.zeros(3, np.float32)
    scratch = [np.empty(3, np.float32) for _ in range(3)]
    for h in np.array([[1, 1, 1], [1, 1, 1 + e], [1, 1 + e, 1]], np.float32):
        gain = P @ h / (h @ P @ h + r)
        A = np.eye(3, dtype=np.float32) - np.outer(gain, h)
        P = A @ P @ A.T + r * np.outer(gain, gain)
        update(x, U, D, h, one, r, *scratch)
    assert np.linalg.eigvalsh(P.astype(float)).min() < 0.0
    assert U.dtype == D.dtype == np.float32
    assert (D > 0.0).all()
