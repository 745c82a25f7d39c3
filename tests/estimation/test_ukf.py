"""The unscented filter against the Kalman filter, a textbook form, and its own seam."""

import math

import numpy as np
import pytest

from visenvs.core.frames import wrap_angle
from visenvs.estimation.ekf import factorise, pack_lower
from visenvs.estimation.ukf import recombine, sigma_points, update_angle

pytestmark = pytest.mark.kernel


def covariance(rng, n):
    """A well-conditioned random covariance."""
    root = rng.normal(size=(n, n))
    return root @ root.T + 0.1 * np.eye(n)


def points_of(x, P, spread):
    n = len(x)
    factor, points = np.empty(n * (n + 1) // 2), np.empty((2 * n + 1, n))
    pack_lower(P, factor)
    factorise(factor, n)
    sigma_points(x, factor, spread, points)
    return points


def weights(n, spread):
    return np.r_[1.0 - n / spread, np.full(2 * n, 0.5 / spread)]


def update(x, P, spread, h, measured, variance):
    """The kernel on copies, with angles h(points): state, covariance, innovation, S."""
    x, P, points = x.copy(), P.copy(), points_of(x, P, spread)
    out = update_angle(x, P, points, spread, h(points), measured, variance, np.empty(len(x)))
    return x, P, *out


def textbook(x, P, spread, h, measured, variance):
    """Unscented update with numpy's Cholesky factor, for angles far from the seam."""
    n = len(x)
    L = math.sqrt(spread) * np.linalg.cholesky(P)
    points, w = np.vstack([x, x + L.T, x - L.T]), weights(n, spread)
    z = h(points)
    mean = w @ z
    S = w @ (z - mean) ** 2 + variance
    K = ((w * (z - mean)) @ (points - x)) / S
    return x + K * (measured - mean), P - S * np.outer(K, K), measured - mean, S


def sight(points):
    return np.arctan2(points[:, 1], points[:, 0])


@pytest.mark.parametrize("n", [1, 2, 4, 6])
@pytest.mark.parametrize("kappa", [0.0, 1.0, 3.0])
def test_the_points_have_the_mean_and_covariance_that_they_stand_for(n, kappa):
    rng = np.random.default_rng(n)
    x, P, w = rng.normal(size=n), covariance(rng, n), weights(n, n + kappa)
    points = points_of(x, P, n + kappa)
    assert points[0].tolist() == x.tolist()
    assert w @ points == pytest.approx(x, abs=1e-12)
    assert np.einsum("j,ja,jb->ab", w, points - x, points - x) == pytest.approx(P, abs=1e-11)


@pytest.mark.parametrize("seed", range(10))
def test_a_linear_angle_is_the_kalman_filter(seed):
    """Whatever the spread: x + K e and P - K S K' with K = P h / S."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 7))
    x, P, h = rng.normal(size=n), covariance(rng, n), rng.normal(size=n)
    h *= 0.1 / math.sqrt(h @ P @ h)  # all points within half a turn
    S = h @ P @ h + 0.04
    measured = h @ x + 0.3
    after = x + P @ h / S * 0.3, P - np.outer(P @ h, P @ h) / S
    measured = float(np.angle(np.exp(1j * measured)))
    for kappa in (0.0, 0.5, 3.0):
        got = update(x, P, n + kappa, lambda points: points @ h, measured, 0.04)
        assert got[0] == pytest.approx(after[0], abs=1e-10)
        assert got[1] == pytest.approx(after[1], abs=1e-10)
        assert got[2:] == pytest.approx((0.3, S), rel=1e-10)
        assert np.array_equal(got[1], got[1].T)


@pytest.mark.parametrize("kappa", [0.0, 2.0])
@pytest.mark.parametrize("seed", range(5))
def test_a_bearing_is_the_textbook_update(seed, kappa):
    rng = np.random.default_rng(seed)
    x, P = np.array([5.0, 1.0, 0.3, -0.2]) + rng.normal(size=4), covariance(rng, 4)
    args = (x, P, 4.0 + kappa, sight, sight(x[None])[0] + 0.2, 0.01)
    for ours, theirs in zip(update(*args), textbook(*args), strict=True):
        assert ours == pytest.approx(theirs, rel=1e-10, abs=1e-12)


@pytest.mark.parametrize("angle", np.linspace(-math.pi, math.pi, 13))
def test_no_direction_is_special(angle):
    """A scene and the same scene turned, also across the seam of the angles."""
    rng = np.random.default_rng(1)
    c, s = math.cos(angle), math.sin(angle)
    R = np.kron(np.eye(2), [[c, -s], [s, c]])
    x, P = np.array([9.0, 0.5, 0.3, -0.2]), covariance(rng, 4)
    points, turned = points_of(x, P, 4.0), points_of(x, P, 4.0) @ R.T
    still = x.copy(), P.copy()
    moved = R @ x, R @ P @ R.T
    out = update_angle(*still, points, 4.0, sight(points), 0.2, 0.01, np.empty(4))
    measured = wrap_angle(0.2 + angle)
    out_moved = update_angle(*moved, turned, 4.0, sight(turned), measured, 0.01, np.empty(4))
    assert out_moved == pytest.approx(out, rel=1e-9)
    assert moved[0] == pytest.approx(R @ still[0], abs=1e-10)
    assert moved[1] == pytest.approx(R @ still[1] @ R.T, abs=1e-10)


def test_a_wide_belief_is_told_less_than_its_linearisation_claims():
    """The points see how the bearing bends, so S exceeds H P H' + r."""
    x, P = np.array([10.0, 0.0, 0.0, 0.0]), np.diag([9.0, 4.0, 1.0, 1.0])
    S = update(x, P, 4.0, sight, 0.0, 0.0)[3]
    assert S != pytest.approx(4.0 / 100.0, rel=1e-3)
    narrow = update(x, 1e-6 * P, 4.0, sight, 0.0, 0.0)[3]
    assert narrow == pytest.approx(4e-6 / 100.0, rel=1e-5)


def test_covariance_stays_symmetric_and_positive_over_thousands_of_updates():
    rng = np.random.default_rng(5)
    x, P = np.array([100.0, 0.0, 0.0, 0.0]), 100.0 * np.eye(4)
    for _ in range(3000):
        P += 1e-3 * np.eye(4)
        measured = rng.uniform(-math.pi, math.pi)
        points = points_of(x, P, 4.0)
        update_angle(x, P, points, 4.0, sight(points), measured, 1e-4, np.empty(4))
        assert np.array_equal(P, P.T)
        assert np.linalg.eigvalsh(P)[0] > 0.0


@pytest.mark.parametrize("spread", [3.0, 4.0, 7.0])
def test_moved_points_give_mean_and_covariance_of_a_linear_motion_and_the_noise(spread):
    rng = np.random.default_rng(5)
    x, P, Q = rng.normal(size=4), covariance(rng, 4), covariance(rng, 4)
    A, shift = rng.normal(size=(4, 4)), rng.normal(size=4)
    points = points_of(x, P, spread) @ A.T + shift
    mean, spread_of = np.empty(4), np.empty((4, 4))
    recombine(points, spread, Q, mean, spread_of)
    assert mean == pytest.approx(A @ x + shift, abs=1e-12)
    assert spread_of == pytest.approx(A @ P @ A.T + Q, abs=1e-10)


def test_moved_points_see_a_curved_motion_to_second_order():
    """x^2 of a Gaussian has mean m^2 + s^2 exactly, whatever the spread."""
    points = points_of(np.array([2.0]), np.array([[0.25]]), 3.0) ** 2
    mean, variance = np.empty(1), np.empty((1, 1))
    recombine(points, 3.0, np.zeros((1, 1)), mean, variance)
    assert mean[0] == pytest.approx(4.25, abs=1e-12)
    assert variance[0, 0] == pytest.approx(4 * 4 * 0.25 + 2 * 0.25**2, abs=1e-12)


def bent(spread, shift, seed):
    """Least eigenvalue of nine unit variances after angles whose curvature moves their mean.

    The noise is 0.01 rad; the mean is moved by so many times that, by each pair of points alike.
    """
    odd = 0.2 * np.random.default_rng(seed).normal(size=9)
    even = np.full(9, 0.01 * shift * spread / 9)
    angles, x, P = np.r_[0.0, even + odd, even - odd], np.zeros(9), np.eye(9)
    update_angle(x, P, points_of(x, P, spread), spread, angles, 0.0, 1e-4, np.empty(9))
    return np.linalg.eigvalsh(P).min()


@pytest.mark.parametrize("seed", range(3))
def test_a_covariance_stays_one_while_the_mean_moves_by_less_than_the_noise(seed):
    """With a spread of n whatever the curvature; below, as the UKF paper has it, not always."""
    assert bent(3.0, 0.99, seed) > 0.0 and bent(9.0, 0.99, seed) > 0.0
    assert bent(3.0, 2.0, seed) < 0.0 < bent(9.0, 2.0, seed)
