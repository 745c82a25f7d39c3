"""The bank of filters: its prior, its weights, its mean, and its limit of one Gaussian."""

import math

import numpy as np
import pytest
from scipy import stats

from visenvs.core.sight import see
from visenvs.estimation import bank, inverse_range, sighting

pytestmark = pytest.mark.kernel

ANCHOR, LEVEL = np.array([3.0, -4.0, 1.0]), np.eye(3)
TRUTH = np.array([200.0, 30.0, -15.0])


class Bank:
    def __init__(self, cfg, scratch, prior=(220.0, 60.0)):
        self.cfg, self.scratch = cfg, scratch
        self.x, self.P = np.empty(3), np.empty((3, 3))
        self.weights, self.xs = np.empty(bank.CELLS), np.empty((bank.CELLS, 3))
        self.Ps = np.empty((bank.CELLS, 3, 3))
        seen = self.sight(ANCHOR)
        begin = inverse_range.begin
        self.r0 = begin(self.x, self.P, LEVEL, seen, prior[0], prior[1], cfg, scratch)
        bank.begin(self.x, self.P, self.r0, self.weights, self.xs, self.Ps)

    def sight(self, here):
        return np.array(see(1, LEVEL, TRUTH - here, 1.0)[:2])

    def use(self, here, seen):
        parts = self.weights, self.xs, self.Ps, ANCHOR, self.r0
        return bank.update(*parts, here, LEVEL, seen, self.cfg, self.scratch)

    def moments(self, here):
        r, cov = np.empty(3), np.empty((3, 3))
        bank.moments(self.weights, self.xs, self.Ps, ANCHOR, here, r, cov, self.scratch)
        return r, cov


def place(x, here):
    r, J = np.empty(3), np.empty((3, 3))
    inverse_range.position(x, ANCHOR, here, np.empty((3, 3)), r, J)
    return r, J


def test_the_cells_share_the_prior(settings, scratch):
    made = Bank(settings(), scratch, (220.0, 33.0))
    w, rho = made.weights, made.xs[:, 2]
    mean = w @ rho
    assert w.sum() == pytest.approx(1.0, rel=1e-14)
    assert mean == pytest.approx(made.x[2], rel=1e-12)
    assert w @ (rho - mean) ** 2 + w @ made.Ps[:, 2, 2] == pytest.approx(made.P[2, 2], rel=0.05)
    assert (made.xs[:, :2] == made.x[:2]).all()
    assert (made.Ps[:, :2, :2] == made.P[:2, :2]).all()


def test_cells_of_a_wide_prior_keep_to_the_bounds(settings, scratch):
    made = Bank(settings(), scratch, (220.0, 200.0))
    scaled = made.xs[:, 2] * made.r0
    assert inverse_range.LEAST < scaled.min() < 0.5
    assert 1.7 < scaled.max() < inverse_range.MOST


def test_weights_follow_from_the_density_of_each_prediction(settings, scratch):
    """Bayes: by the normal density of the sighting, with the noise at each cell's own range."""
    cfg = settings()
    made, here = Bank(cfg, scratch), ANCHOR + np.array([60.0, 20.0, 5.0])
    seen = made.sight(here) + np.array([0.05, -0.02])
    density, values = [], []
    for x, P in zip(made.xs, made.Ps, strict=True):
        (r, J), predicted, factor = place(x, here), np.empty(2), np.empty(3)
        sighting.expect(r, J @ P @ J.T, LEVEL, cfg, scratch, predicted, factor)
        L = np.array([[factor[0], 0.0], [factor[1], factor[2]]])
        density.append(stats.multivariate_normal(predicted, L @ L.T).pdf(seen))
        values.append(np.sum(np.linalg.solve(L, seen - predicted) ** 2))
    expected = made.weights * density
    mean = made.weights @ values
    assert made.use(here, seen) == pytest.approx(mean, rel=1e-9)
    assert made.weights == pytest.approx(expected / expected.sum(), rel=1e-9)


def test_the_position_is_the_mean_direction_at_the_mean_inverse_range(settings, scratch):
    made, here = Bank(settings(), scratch), ANCHOR + np.array([60.0, 20.0, 5.0])
    made.use(here, made.sight(here))
    r, cov = made.moments(here)
    at = np.array([place(x, here)[0] for x in made.xs])
    slopes = [place(x, here)[1] for x in made.xs]
    lengths = np.linalg.norm(at, axis=1)
    u = made.weights @ (at / lengths[:, None])
    expected = u / np.linalg.norm(u) / (made.weights @ (1 / lengths))
    within = [w * J @ P @ J.T for w, J, P in zip(made.weights, slopes, made.Ps, strict=True)]
    about = (made.weights[:, None] * (at - expected)).T @ (at - expected)
    assert r == pytest.approx(expected, rel=1e-12)
    assert cov == pytest.approx(sum(within) + about, rel=1e-9, abs=1e-8)
    assert np.array_equal(cov, cov.T)


def test_where_sight_is_straight_the_bank_is_one_filter(settings, scratch):
    cfg = settings(fade=0.0, sigma_angle=2e-3)
    made = Bank(cfg, scratch, (203.0, 4.0))
    x, P = made.x.copy(), made.P.copy()
    for k in range(1, 15):
        here = ANCHOR + k * np.array([1.0, 3.0, 0.5])
        seen = made.sight(here) + 2e-3 * np.array([math.sin(3.0 * k), math.cos(5.0 * k)])
        sighting.update(x, P, *place(x, here), LEVEL, seen, cfg, scratch)
        made.use(here, seen)
    r, J = place(x, here)
    expected, deviation = J @ P @ J.T, np.sqrt(np.diag(J @ P @ J.T))
    mean, cov = made.moments(here)
    assert (mean - r) / deviation == pytest.approx(np.zeros(3), abs=0.05)
    scale = np.outer(deviation, deviation)
    assert cov / scale == pytest.approx(expected / scale, abs=0.05)


def test_cells_that_sightings_rule_out_are_dropped_for_good(settings, scratch):
    made = Bank(settings(fade=0.0, sigma_angle=5e-3), scratch)
    for k in range(1, 60):
        here = ANCHOR + k * np.array([2.0, 1.0, 0.0])
        made.use(here, made.sight(here))
    alive = made.weights > 0.0
    assert 1 <= alive.sum() < bank.CELLS
    assert made.weights.sum() == pytest.approx(1.0, rel=1e-12)
    assert made.moments(here)[0] == pytest.approx(TRUTH - here, abs=1.0)


def test_a_sighting_that_no_cell_can_explain_leaves_weights_that_are_numbers(settings, scratch):
    made = Bank(settings(fade=0.0, sigma_angle=1e-4), scratch)
    made.use(ANCHOR + 1.0, np.array([-3.0, 1.4]))
    assert np.isfinite(made.weights).all()
    assert made.weights.sum() == pytest.approx(1.0)
