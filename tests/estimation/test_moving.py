"""Filters of a constant-velocity target seen by bearing: model, linear limit, consistency."""

import math

import numpy as np
import pytest
from scipy import stats

from visenvs.estimation.moving import (
    SCRATCH,
    predict,
    turn_axes,
    update_extended,
    update_unscented,
)

pytestmark = pytest.mark.kernel

SIGMA = math.radians(1.0)


def settings(kappa=0.0):
    out = np.zeros((), [("sigma_bearing", "f8"), ("kappa", "f8"), ("min_range", "f8")])
    out["sigma_bearing"], out["kappa"], out["min_range"] = SIGMA, kappa, 1.0
    return out[()]


def scratch():
    return np.zeros(1, SCRATCH)[0]


def belief(seed):
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(4, 4)) * [[1.0], [1.0], [0.1], [0.1]]
    return np.array([900.0, -400.0, 3.0, -2.0]) + rng.normal(size=4), root @ root.T


def test_the_prediction_is_the_linear_one():
    x, P = belief(0)
    Phi, moved = np.eye(4) + 2.5 * np.eye(4, k=2), np.array([30.0, 7.0])
    expected = Phi @ x - np.r_[moved, 0.0, 0.0], Phi @ P @ Phi.T
    predict(x, P, moved, 2.5)
    assert x == pytest.approx(expected[0], rel=1e-13)
    assert P == pytest.approx(expected[1], rel=1e-12)
    assert np.array_equal(P, P.T)


@pytest.mark.parametrize("angle", [0.0, 0.7, math.pi / 2, -3.0])
def test_turned_axes_are_a_rotation(angle):
    x, P = belief(1)
    y, W = np.empty(4), np.empty((4, 4))
    turn_axes(angle, x, P, y, W)
    R = np.kron(
        np.eye(2), [[math.cos(angle), math.sin(angle)], [-math.sin(angle), math.cos(angle)]]
    )
    assert y == pytest.approx(R @ x, abs=1e-12)
    assert W == pytest.approx(R @ P @ R.T, abs=1e-12)
    assert np.array_equal(W, W.T)


@pytest.mark.parametrize("update", [update_unscented, update_extended])
@pytest.mark.parametrize("angle", [0.7, math.pi / 2, -3.0])
def test_north_does_not_matter(update, angle):
    x, P = np.array([900.0, -400.0, 3.0, -2.0]), np.diag([4e4, 1e4, 9.0, 4.0])
    y, W = np.empty(4), np.empty((4, 4))
    turn_axes(angle, x, P, y, W)
    one = update(x, P, -0.3, settings(), scratch())
    other = update(y, W, -0.3 - angle, settings(), scratch())
    back, C = np.empty(4), np.empty((4, 4))
    turn_axes(-angle, y, W, back, C)
    assert other == pytest.approx(one, rel=1e-9)
    assert back == pytest.approx(x, rel=1e-10)
    assert C == pytest.approx(P, abs=1e-7)


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("kappa", [0.0, 2.0])
def test_both_filters_agree_where_the_bearing_is_straight(seed, kappa):
    """Far away and well known: the bearing is linear across the belief."""
    x, P = belief(seed)
    y, Q, before = x.copy(), P.copy(), x.copy()
    measured = math.atan2(x[1], x[0]) + 0.5 * SIGMA
    one = update_unscented(x, P, measured, settings(kappa), scratch())
    other = update_extended(y, Q, measured, settings(), scratch())
    assert one == pytest.approx(other, abs=1e-3 * SIGMA)
    step = np.abs(y - before).max()
    assert step > 1e-3
    assert x == pytest.approx(y, abs=1e-2 * step)
    assert P == pytest.approx(Q, abs=1e-4)


@pytest.mark.parametrize("update", [update_unscented, update_extended])
def test_bearings_across_the_seam_pull_the_right_way(update):
    x, P = np.array([-1000.0, 1.0, 0.0, 0.0]), np.diag([1e4, 1e4, 1.0, 1.0])
    innovation = update(x, P, -math.pi + 0.02, settings(), scratch())
    assert innovation == pytest.approx(0.021, abs=1e-3)
    assert -22.0 < x[1] < -10.0


@pytest.mark.parametrize("update", [update_unscented, update_extended])
def test_a_manoeuvring_observer_is_told_the_truth_consistently(update):
    """NEES of position and velocity over 300 runs of a legged path, from a 5 % prior of range."""
    runs, steps, dt = 300, 60, 2.0
    prior = np.array([100.0, 70.0, 3.0, 3.0])
    rng, cfg, work = np.random.default_rng(3), settings(), scratch()
    nees = np.empty((runs, steps))
    for run in range(runs):
        x, P = np.array([2000.0, 0.0, 0.0, 0.0]), np.diag(prior**2)
        truth = x + prior * rng.normal(size=4)
        for k in range(steps):
            moved = dt * 18.0 * np.array([0.5, 0.8 if k // 15 % 2 else -0.8])
            truth = truth + np.r_[dt * truth[2:] - moved, 0.0, 0.0]
            predict(x, P, moved, dt)
            measured = math.atan2(truth[1], truth[0]) + SIGMA * rng.normal()
            update(x, P, measured, cfg, work)
            nees[run, k] = (x - truth) @ np.linalg.solve(P, x - truth)
    low, high = stats.chi2.ppf([1e-4, 1 - 1e-4], 4 * runs) / runs
    assert low < nees[:, -1].mean() < high
    assert low < nees[:, steps // 2].mean() < high
    assert np.trace(P[:2, :2]) < 0.2 * (prior[:2] ** 2).sum()
