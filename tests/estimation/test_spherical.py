"""The IISc filter: exact motion, published constants, means, guards."""

import math

import numpy as np
import pytest

from visenvs.core.sight import noise_variance, to_angles, turn
from visenvs.estimation.spherical import (
    COUNTS,
    HISTORY_ROWS,
    INERTIAL,
    LITERAL,
    NONE,
    SMOOTHED,
    begin,
    flow,
    guard,
    position,
    predict,
    restart,
    smooth,
    use,
)

pytestmark = pytest.mark.kernel

LEVEL, SEEN = np.eye(3), np.array([0.3, -0.2])


def cartesian(x):
    A = np.empty((3, 3))
    turn(x[1], x[2], A)
    return x[0] * A[:, 0]


def spherical(r):
    theta, phi, length = to_angles(*r)
    return np.array([length, theta, phi])


def started(cfg, scratch, seen=SEEN, prior=(500.0, 400.0)):
    x, P, history = np.empty(3), np.empty((3, 3)), np.full((HISTORY_ROWS, 3), np.nan)
    begin(x, P, history, LEVEL, np.array(seen), prior[0], prior[1], cfg, scratch)
    return x, P, history


def test_the_published_start(settings, scratch):
    x, P, history = started(settings(), scratch)
    assert x == pytest.approx([500.0, 0.3, -0.2])
    assert pytest.approx(np.diag([400.0**2, 0.592**2, 0.592**2]), rel=2e-3) == P
    assert not history.any()


def test_the_slope_of_the_motion(derivative):
    x, moved, F = np.array([60.0, 0.4, -0.7]), np.array([1e-3, -2e-3, 5e-4]), np.empty((3, 3))
    flow(x, moved, F)
    expected = derivative(lambda at: spherical(cartesian(at) - moved), x, [1e-3, 1e-5, 1e-5])
    assert np.eye(3) + F == pytest.approx(expected, abs=2e-7)
    assert np.abs(F).max() > 1e-3


def test_the_state_moves_exactly_and_its_covariance_by_one_euler_step(settings, scratch):
    cfg, here, moved = settings(), np.array([5.0, 6.0, 7.0]), np.array([30.0, -20.0, 10.0])
    x, P, history = started(cfg, scratch)
    r, before, F = cartesian(x), P.copy(), np.empty((3, 3))
    flow(x, moved, F)
    predict(x, P, history, here, moved, 400.0, cfg, scratch)
    assert cartesian(x) == pytest.approx(r - moved, rel=1e-13)
    expected = before + F @ before + before @ F.T + 0.1 * np.diag([0.2, 0.025, 0.025])
    assert pytest.approx(expected, rel=1e-12, abs=1e-12) == P
    assert np.array_equal(P, P.T)


def test_the_update_measures_the_angles_alone(settings, scratch):
    """(3.37)-(3.40) with C = [0 1 0; 0 0 1], in Joseph form."""
    cfg = settings()
    x, P, _ = started(cfg, scratch)
    P += np.array([[0, 20.0, -9.0], [20.0, 0, 0.01], [-9.0, 0.01, 0]])
    H, R = np.eye(3)[1:], noise_variance(500.0, cfg) * np.eye(2)
    S, e = H @ P @ H.T + R, np.array([0.1, -0.05])
    K = P @ H.T @ np.linalg.inv(S)
    keep = np.eye(3) - K @ H
    expected = x + K @ e, keep @ P @ keep.T + K @ R @ K.T
    nis = use(x, P, LEVEL, SEEN + e, 400.0, cfg, scratch)
    assert x == pytest.approx(expected[0], rel=1e-10)
    assert pytest.approx(expected[1], rel=1e-9, abs=1e-9) == P
    assert nis == pytest.approx(e @ np.linalg.solve(S, e), rel=1e-10)


def test_an_angle_across_the_seam_pulls_the_right_way(settings, scratch):
    cfg = settings()
    x, P, _ = started(cfg, scratch, (math.pi - 0.01, 0.0))
    use(x, P, LEVEL, np.array([-math.pi + 0.03, 0.0]), 400.0, cfg, scratch)
    assert -math.pi < x[1] < -math.pi + 0.03


def test_the_slope_of_the_position(derivative):
    x, r, J = np.array([60.0, 0.4, -0.7]), np.empty(3), np.empty((3, 3))
    position(x, np.empty((3, 3)), r, J)
    assert r == pytest.approx(cartesian(x), rel=1e-14)
    assert derivative(cartesian, x) == pytest.approx(J, abs=1e-6)


def approach(cfg, scratch, steps, u=20.0):
    """Fly straight at speed u past an object whose range is known; returns its filter and place."""
    truth, here, moved = np.array([600.0, 80.0, -50.0]), np.zeros(3), np.array([0.1 * u, 0.0, 0.0])
    x, P, history = started(cfg, scratch)
    x[:] = spherical(truth)
    for _ in range(steps):
        here = here + moved
        predict(x, P, history, here, moved, 400.0, cfg, scratch)
    return x, P, history, here, truth


def test_the_printed_mean_of_the_pre_run_is_too_far_by_half_of_what_was_flown(settings, scratch):
    """(3.32) averages what is left behind: u times half the pre-run, along the way."""
    cfg = settings(reinit=LITERAL)
    x, P, history, here, truth = approach(cfg, scratch, 100)
    assert cartesian(x) == pytest.approx(truth - here, rel=1e-9)
    restart(x, P, history, here, 400.0, cfg, scratch)
    error = cartesian(x) - (truth - here)
    assert error[0] == pytest.approx(20.0 * 5.0, abs=3.0)
    assert np.abs(error[1:]).max() < 8.0
    assert pytest.approx(np.diag([400.0**2, 0.592**2, 0.592**2]), rel=2e-3) == P


def test_the_inertial_mean_has_no_such_error(settings, scratch):
    cfg = settings(reinit=INERTIAL)
    x, P, history, here, truth = approach(cfg, scratch, 100)
    restart(x, P, history, here, 400.0, cfg, scratch)
    assert cartesian(x) == pytest.approx(truth - here, rel=1e-9)
    assert P[0, 0] == 400.0**2


def test_without_a_restart_the_filter_goes_on(settings, scratch):
    cfg = settings(reinit=NONE)
    x, P, history, here, _ = approach(cfg, scratch, 30)
    before = x.copy(), P.copy()
    restart(x, P, history, here, 400.0, cfg, scratch)
    assert np.array_equal(x, before[0])
    assert np.array_equal(P, before[1])
    assert history[COUNTS, 0] == 0.0


@pytest.mark.parametrize("steps", [0, 4, 9, 40])
def test_means_of_the_last_ten_estimates(steps, settings, scratch):
    """At constant speed the relative mean (3.41) lags half its length, the inertial one not."""
    lag = 0.5 * min(steps, SMOOTHED - 1) * 2.0
    for smoothing, expected in ((LITERAL, lag), (INERTIAL, 0.0), (NONE, 0.0)):
        cfg = settings(smoothing=smoothing)
        x, _, history, here, truth = approach(cfg, scratch, steps)
        r = cartesian(x)
        smooth(x, history, here, np.empty((3, 3)), cfg, r)
        error = r - (truth - here)
        assert error == pytest.approx([expected, 0.0, 0.0], abs=0.05)


def test_the_mean_of_directions_about_the_seam(settings, scratch):
    cfg = settings(smoothing=LITERAL)
    x, history = np.array([100.0, -math.pi + 0.02, 0.0]), np.zeros((HISTORY_ROWS, 3))
    history[0], history[COUNTS, 0] = [100.0, math.pi - 0.04, 0.0], 1.0
    r = cartesian(x)
    smooth(x, history, np.zeros(3), np.empty((3, 3)), cfg, r)
    assert spherical(r) == pytest.approx([100.0, math.pi - 0.01, 0.0])


def test_a_spoilt_covariance_and_a_lost_range_start_anew(settings, scratch):
    cfg = settings()
    x, P, _ = started(cfg, scratch)
    fresh = P.copy()
    x[0], x[1], P[1, 1], P[0, 1] = -50.0, 4.0, -1e-9, 3.0
    guard(x, P, 400.0, cfg)
    assert x[0] == 1.0
    assert x[1] == pytest.approx(4.0 - 2 * math.pi)
    assert np.array_equal(P, fresh)
    P[0, 0] = np.nan
    guard(x, P, 400.0, cfg)
    assert np.array_equal(P, fresh)


@pytest.mark.parametrize("phi", [math.pi / 2, -math.pi / 2, 1.5])
def test_straight_above_the_motion_is_finite(phi, settings, scratch):
    cfg = settings()
    x, P, history = started(cfg, scratch)
    x[2] = phi
    predict(x, P, history, np.zeros(3), np.array([2.0, 0.0, 0.0]), 400.0, cfg, scratch)
    assert np.isfinite(x).all()
    assert np.isfinite(P).all()
