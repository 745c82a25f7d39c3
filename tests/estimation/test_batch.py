"""The batch estimate against scipy's least squares, and its window."""

import numpy as np
import pytest
from scipy.optimize import least_squares

from visenvs.core.sight import see
from visenvs.estimation import batch, inverse_range, sighting

pytestmark = pytest.mark.kernel

ANCHOR, LEVEL = np.array([3.0, -4.0, 1.0]), np.eye(3)
TRUTH = np.array([200.0, 30.0, -15.0])


def run(cfg, scratch, seed, rows, count, attitude=None, noise=None):
    """Fly past the object; returns estimate, covariance, prior and all sightings."""
    rng = np.random.default_rng(seed)
    window, sightings = np.zeros((1 + rows, batch.WIDTH)), []
    x, P, r0 = np.empty(3), np.empty((3, 3)), 0.0
    for k in range(count + 1):
        here = ANCHOR + k * np.array([4.0, 1.5, -0.5])
        C = LEVEL if attitude is None else attitude(k)
        sd = noise or float(cfg["sigma_angle"])
        seen = np.array(see(1, C, TRUTH - here, 1.0)[:2]) + sd * rng.normal(size=2)
        if k == 0:
            r0 = inverse_range.begin(x, P, C, seen, 280.0, 81.0, cfg, scratch)
            batch.begin(x, P, window)
            prior = x.copy(), P.copy()
        else:
            batch.update(x, P, window, ANCHOR, r0, here, C, seen, cfg, scratch)
            sightings.append((here, C, seen))
    return x, P, prior, sightings


def scipys(start, prior, sightings, cfg):
    """Most probable state with the noise that the batch assumes at its own estimate."""
    root = np.linalg.inv(np.linalg.cholesky(prior[1]))

    def position(x, here):
        r = np.empty(3)
        inverse_range.position(x, ANCHOR, here, np.empty((3, 3)), r, np.empty((3, 3)))
        return r

    def sees(x, here, C):
        return np.array(see(1, C, position(x, here), 1.0)[:2])

    deviation = [
        np.sqrt(sighting.assumed_variance(np.linalg.norm(position(start, here)), cfg))
        for here, _, _ in sightings
    ]

    def residuals(x):
        parts = [root @ (x - prior[0])]
        for (here, C, seen), sd in zip(sightings, deviation, strict=True):
            parts.append((seen - sees(x, here, C)) / sd)
        return np.concatenate(parts)

    best = least_squares(residuals, start, x_scale=[1, 1, 1e-3], xtol=1e-15, ftol=1e-15, gtol=1e-15)
    return best.x, np.linalg.inv(best.jac.T @ best.jac)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("tilted", [False, True])
def test_the_most_probable_state_of_all_sightings(seed, tilted, settings, scratch, attitude):
    cfg = settings(sigma_angle=0.03)
    got = run(cfg, scratch, seed, rows=30, count=30, attitude=attitude if tilted else None)
    x, P, prior, sightings = got
    expected, covariance = scipys(x, prior, sightings, cfg)
    deviation = np.sqrt(np.diag(P))
    assert (x - expected) / deviation == pytest.approx(np.zeros(3), abs=0.02)
    assert P / np.outer(deviation, deviation) == pytest.approx(
        covariance / np.outer(deviation, deviation), abs=0.02
    )
    assert np.array_equal(P, P.T)


def test_a_short_window_keeps_what_it_forgets_in_the_prior(settings, scratch):
    """With little noise the linearisation of the forgotten sightings holds."""
    cfg = settings(sigma_angle=2e-4, fade=0.0)
    x, P, _, _ = run(cfg, scratch, 1, rows=40, count=40)
    y, Q, _, _ = run(cfg, scratch, 1, rows=10, count=40)
    deviation = np.sqrt(np.diag(P))
    assert (x - y) / deviation == pytest.approx(np.zeros(3), abs=0.05)
    assert np.sqrt(np.diag(Q)) / deviation == pytest.approx(np.ones(3), abs=0.02)


def test_a_window_of_one_is_an_iterated_kalman_filter(settings, scratch):
    """One sighting: the prior, updated with the row linearised where the iteration ends."""
    cfg = settings(sigma_angle=0.02, fade=0.0)
    x, _, prior, sightings = run(cfg, scratch, 5, rows=1, count=1)
    expected, _ = scipys(x, prior, sightings, cfg)
    assert x == pytest.approx(expected, rel=1e-6)


def test_the_prior_is_kept_as_it_was_given():
    rng = np.random.default_rng(0)
    x, root, window = rng.normal(size=3), rng.normal(size=(3, 3)), np.ones((3, batch.WIDTH))
    P, y, Q = root @ root.T, np.empty(3), np.empty((3, 3))
    P = 0.5 * (P + P.T)
    batch.begin(x, P, window)
    batch.read_prior(window, y, Q)
    assert np.array_equal(x, y)
    assert np.array_equal(P, Q)
    assert window[0, batch.COUNT] == 0.0
