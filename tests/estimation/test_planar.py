"""The filters in a plane, against textbook formulas and the density of the measurement itself."""

import numpy as np
import pytest
from scipy import stats

from visenvs.core.units import FOOT
from visenvs.estimation.planar import SCRATCH, begin, begin_thesis, update, update_thesis

pytestmark = pytest.mark.kernel

NAMES = ("prior_range", "prior_deviation", "sigma_range", "sigma_angle", "min_range", "gate")
P0 = np.array([[36.0, 1.2], [1.2, 0.7]])


def settings(sigma_range=0.3, sigma_angle=0.0, min_range=0.3, gate=0.0):
    values = (80 * FOOT, 20 * FOOT, sigma_range, sigma_angle, min_range, gate)
    return np.array([values], [(name, "f8") for name in NAMES])[0]


def updated(filter_, rhat, P, z, cfg):
    """A kernel on copies: estimate, covariance, innovation."""
    rhat, P = np.array(rhat, float), np.array(P, float)
    return rhat, P, filter_(rhat, P, z, cfg, np.zeros(1, SCRATCH)[0])


def started(filter_, z, cfg):
    rhat, P = np.zeros(2), np.zeros((2, 2))
    filter_(rhat, P, z, cfg)
    return rhat, P


def variance(X, cfg):
    return (cfg["sigma_range"] / X) ** 2 + cfg["sigma_angle"] ** 2


def log_density(x, z, cfg):
    """Of z = (Y + nu) / X, up to a constant, where all noise grows as 1 / X."""
    return np.log(x[0]) - 0.5 * ((z * x[0] - x[1]) / cfg["sigma_range"]) ** 2


def test_the_literal_start_in_feet():
    """(4.69): 80 [1, z], diag(400, 400 z^2)."""
    rhat, P = started(begin_thesis, 0.05, settings())
    assert rhat / FOOT == pytest.approx([80, 4])
    assert P / FOOT**2 == pytest.approx(np.diag([400, 1]))


def test_the_start_has_the_covariance_of_its_error():
    """Over X from the prior and the noise of the first image, for a target anywhere across."""
    rng, cfg, n = np.random.default_rng(1), settings(), 20_000
    X, Y = 80 * FOOT + 20 * FOOT * rng.normal(size=n), 3.0
    squares = []
    for x, z in zip(X, (Y + 0.3 * rng.normal(size=n)) / X, strict=True):
        rhat, P = started(begin, z, cfg)
        error = rhat - (x, Y)
        squares.append(error @ np.linalg.solve(P, error))
    assert stats.kstest(squares, stats.chi2(2).cdf).pvalue > 1e-3


@pytest.mark.parametrize("gate", [0.0, 5.0])
@pytest.mark.parametrize("rhat", [(20.0, 1.0), (0.1, 1.0), (-3.0, 0.2)])
def test_the_literal_update_is_the_textbook_one(rhat, gate):
    """h = Y / X, its Jacobian and noise at the estimate or at the least range, Joseph form."""
    cfg, z = settings(gate=gate), 0.08
    ours, P_ours, innovation = updated(update_thesis, rhat, P0, z, cfg)
    X = max(rhat[0], 0.3)
    t, R = rhat[1] / X, variance(X, cfg)
    H = np.array([-t / X, 1 / X])
    K = P0 @ H / (H @ P0 @ H + R)
    keep = np.eye(2) - np.outer(K, H)
    assert innovation == pytest.approx(z - t)
    assert ours == pytest.approx(np.array(rhat) + K * (z - t))
    assert P_ours == pytest.approx(keep @ P0 @ keep.T + R * np.outer(K, K))


@pytest.mark.parametrize("z", [-0.2, 0.05, 0.06, 0.4])
def test_an_update_is_one_newton_step_on_the_posterior(z):
    """Prior times density of z, whose slope and curvature are taken by central differences."""
    x, cfg, h = np.array([20.0, 1.0]), settings(), 1e-3
    unit = h * np.eye(2)
    slope = np.array([log_density(x + e, z, cfg) - log_density(x - e, z, cfg) for e in unit])
    bend = [
        [
            log_density(x + e + d, z, cfg)
            - log_density(x + e - d, z, cfg)
            - log_density(x - e + d, z, cfg)
            + log_density(x - e - d, z, cfg)
            for d in unit
        ]
        for e in unit
    ]
    information = np.linalg.inv(P0) - np.array(bend) / (4 * h * h)
    rhat, P, innovation = updated(update, x, P0, z, cfg)
    assert np.linalg.inv(information) == pytest.approx(P, rel=1e-4)
    assert rhat - x == pytest.approx(np.linalg.solve(information, slope / (2 * h)), rel=1e-4)
    assert innovation == pytest.approx(z - 0.05)


def test_where_noise_does_not_tell_range_the_two_updates_agree():
    cfg = settings(sigma_range=1e-6, sigma_angle=0.01)
    ours, theirs = (updated(f, (20.0, 1.0), P0, 0.07, cfg) for f in (update, update_thesis))
    for one, other in zip(ours, theirs, strict=True):
        assert one == pytest.approx(other, rel=1e-9)


@pytest.mark.parametrize(("sigma_range", "sigma_angle"), [(0.3, 0.0), (0.2, 0.0125), (0.05, 0.01)])
def test_an_update_at_the_truth_has_no_bias(sigma_range, sigma_angle):
    """Over the noise, the slope of the log density P^-1 (x' - x) has mean zero."""
    cfg, truth, P = settings(sigma_range, sigma_angle), np.array([20.0, 1.0]), 0.01 * np.eye(2)
    noise = np.random.default_rng(2).normal(size=4000) * np.sqrt(variance(20.0, cfg))
    slopes = []
    for z in 0.05 + noise:
        rhat, after, _ = updated(update, truth, P, z, cfg)
        slopes.append(np.linalg.solve(after, rhat - truth))
    standard_error = np.std(slopes, axis=0) / np.sqrt(len(slopes))
    assert (np.abs(np.mean(slopes, axis=0)) < 4 * standard_error).all()


@pytest.mark.parametrize("filter_", [update, update_thesis])
def test_the_gate_leaves_outliers_out(filter_):
    near, far, P = 0.07, 0.9, 0.5 * np.eye(2)
    free = updated(filter_, (20.0, 1.0), P, far, settings())
    gated = updated(filter_, (20.0, 1.0), P, far, settings(gate=5.0))
    assert gated[0].tolist() == [20.0, 1.0] and gated[1].tolist() == P.tolist()
    assert gated[2] == free[2] == pytest.approx(far - 0.05)
    assert abs(free[0][1] - 1.0) > 0.1
    same = [updated(filter_, (20.0, 1.0), P, near, settings(gate=gate)) for gate in (0.0, 5.0)]
    assert same[0][0].tolist() == same[1][0].tolist() != [20.0, 1.0]


@pytest.mark.parametrize("filter_", [update, update_thesis])
@pytest.mark.parametrize("depth", [0.0, -5.0])
def test_an_estimate_behind_the_camera_keeps_a_finite_positive_covariance(filter_, depth):
    rhat, P, _ = updated(filter_, (depth, 0.2), P0, 0.3, settings())
    assert np.isfinite(rhat).all()
    assert (np.linalg.eigvalsh(P) > 0).all()


def test_a_singular_start_is_repaired_by_process_noise_alone():
    """(4.69) with z = 0: no image moves Y until the prediction adds to its variance."""
    cfg = settings()
    rhat, P = started(begin_thesis, 0.0, cfg)
    after, P_after, _ = updated(update_thesis, rhat, P, 0.02, cfg)
    assert after.tolist() == rhat.tolist() and P_after.tolist() == P.tolist()
    moved, _, _ = updated(update_thesis, rhat, P + 1e-4 * np.eye(2), 0.02, cfg)
    assert moved[1] > 0.0
