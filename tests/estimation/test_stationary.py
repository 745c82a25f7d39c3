"""The filter of a stationary target, against a textbook EKF written apart from it."""

import numpy as np
import pytest

from visenvs.core.frames import camera_towards, identity
from visenvs.estimation.stationary import SCRATCH, predict, update

pytestmark = pytest.mark.kernel

SETTINGS = np.dtype([(name, "f8") for name in ("sigma_range", "sigma_angle", "min_range", "gate")])


def settings(sigma_range=0.3, sigma_angle=0.0, min_range=0.5, gate=0.0):
    return np.array([(sigma_range, sigma_angle, min_range, gate)], SETTINGS)[0]


def scratch():
    return np.zeros(1, SCRATCH)[0]


def updated(rhat, P, point, cfg, C=None):
    """The kernel on copies: estimate, covariance, innovation, NIS."""
    rhat, P, innovation = np.array(rhat, float), P.copy(), np.full(2, np.nan)
    nis = update(rhat, P, np.eye(3) if C is None else C, *point, cfg, innovation, scratch())
    return rhat, P, innovation, nis


def textbook(rhat, P, C, point, cfg):
    """EKF update with h = (Y/X, Z/X), H by the chain rule, Joseph form (thesis (3.11)-(3.14))."""
    X, Y, Z = C @ rhat
    H = np.array([[-Y / X**2, 1 / X, 0], [-Z / X**2, 0, 1 / X]]) @ C
    R = (cfg["sigma_range"] ** 2 / X**2 + cfg["sigma_angle"] ** 2) * np.eye(2)
    S = H @ P @ H.T + R
    K = np.linalg.solve(S, H @ P).T
    innovation = np.array(point) - [Y / X, Z / X]
    keep = np.eye(3) - K @ H
    nis = innovation @ np.linalg.solve(S, innovation)
    return rhat + K @ innovation, keep @ P @ keep.T + K @ R @ K.T, innovation, nis


def test_prediction_shifts_the_estimate_and_widens_its_covariance():
    rhat, P = np.array([10.0, 2.0, 3.0]), np.diag([4.0, 5.0, 6.0]) + 0.1
    expected = P + 0.02 * np.eye(3)
    predict(rhat, P, np.array([1.0, -2.0, 0.5]), 0.02)
    assert rhat.tolist() == [9.0, 4.0, 2.5]
    assert np.allclose(P, expected, rtol=1e-15)


def flight(gimbal, seed, steps=200, dt=0.1):
    """A rendezvous filtered twice, here and by the kernels, with one image in ten missing."""
    rng = np.random.default_rng(seed)
    r = np.array([30.0, 6.0, -5.0])
    v = np.array([2.5, 0.5, 0.0])
    rhat, P = r * 0.8, np.diag([30.0, 20.0, 10.0])
    ours = rhat.copy(), P.copy()
    cfg = settings(sigma_range=0.3, sigma_angle=0.001)
    C, innovation, work = np.empty((3, 3)), np.empty(2), scratch()
    for k in range(steps):
        a = np.array([-0.2, np.sin(0.05 * k), 0.5 * np.cos(0.07 * k)])
        moved, v = dt * (v + 0.5 * dt * a), v + dt * a
        r, rhat, P = r - moved, rhat - moved, P + 0.001 * np.eye(3)
        predict(ours[0], ours[1], moved, 0.001)
        if gimbal:
            camera_towards(ours[0], C)
        else:
            identity(C)
        X, Y, Z = C @ r
        nis = None
        if X > 1.0 and rng.random() < 0.9:  # missed measurement: prediction only
            point = np.array([Y, Z]) / X + rng.normal(size=2) * np.hypot(0.3 / X, 0.001)
            rhat, P, _, nis = textbook(rhat, P, C, point, cfg)
            assert update(*ours, C, *point, cfg, innovation, work) == pytest.approx(nis, rel=1e-9)
        yield k, ours, (rhat, P), nis is not None


@pytest.mark.parametrize("gimbal", [False, True])
def test_every_step_of_a_rendezvous_matches_a_textbook_filter(gimbal):
    seen = 0
    for _, (r_ours, P_ours), (r_theirs, P_theirs), measured in flight(gimbal, seed=3):
        assert np.abs(r_ours - r_theirs).max() < 1e-10
        assert np.abs(P_ours - P_theirs).max() < 1e-10
        assert np.array_equal(P_ours, P_ours.T)
        seen += measured
    assert 60 < seen < 200


def test_the_innovation_is_measured_minus_predicted():
    _, _, innovation, _ = updated((10.0, 2.0, -3.0), np.eye(3), (0.25, -0.1), settings())
    assert innovation == pytest.approx([0.05, 0.2], abs=1e-15)


def test_an_outlier_is_left_out_and_reported():
    rhat, P, cfg = np.array([20.0, 1.0, 1.0]), np.diag([4.0, 1.0, 1.0]), settings(gate=5.0)
    near, far = updated(rhat, P, (0.1, 0.1), cfg), updated(rhat, P, (3.0, 0.1), cfg)
    assert near[3] < 25.0 < far[3]
    assert near[0][1] > rhat[1]
    assert np.array_equal(far[0], rhat)
    assert np.array_equal(far[1], P)
    assert far[2] == pytest.approx([3.0 - 0.05, 0.1 - 0.05], rel=1e-12)
    ungated = updated(rhat, P, (3.0, 0.1), settings(gate=0.0))
    assert ungated[3] == pytest.approx(far[3], rel=1e-15)
    assert not np.array_equal(ungated[0], rhat)


@pytest.mark.parametrize("depth", [0.1, 0.0, -5.0])
def test_nearer_estimates_are_linearised_at_the_minimum_range(depth):
    """An estimate at or behind the camera gives the finite update of one at the minimum range."""
    P, point, cfg = np.diag([4.0, 1.0, 1.0]), (0.2, -0.1), settings(min_range=0.5)
    rhat, P_near, innovation, nis = updated((depth, 0.1, 0.2), P, point, cfg)
    at_floor, P_floor, same_innovation, same_nis = updated((0.5, 0.1, 0.2), P, point, cfg)
    assert np.allclose(rhat - [depth, 0.1, 0.2], at_floor - [0.5, 0.1, 0.2], rtol=1e-12, atol=1e-15)
    assert np.array_equal(P_near, P_floor)
    assert np.array_equal(innovation, same_innovation)
    assert nis == same_nis


def test_the_range_of_a_target_dead_ahead_is_not_observable():
    """On the optical axis one image says nothing about depth; off the axis it does."""
    P = np.diag([4.0, 1.0, 1.0])
    assert updated((20.0, 0.0, 0.0), P, (0.01, 0.02), settings())[1][0, 0] == 4.0
    assert updated((20.0, 15.0, 0.0), P, (0.75, 0.0), settings())[1][0, 0] < 3.0
