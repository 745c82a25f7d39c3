"""The filter of an object at constant velocity: textbook algebra, and what it is at rest."""

import numpy as np
import pytest

from visenvs.core.sight import ANGLES, IMAGE, see, slope
from visenvs.estimation.drifting import SCRATCH, begin, predict, update

pytestmark = pytest.mark.kernel

SETTINGS = [
    ("sensor", "i8"),
    *((n, "f8") for n in ("min_range", "sigma_range", "sigma_angle", "fade", "assumed_noise")),
]
R_V, C = np.array([3.0, 1.0, -2.0]), np.eye(3)


def settings(sensor):
    return np.array([(sensor, 0.5, 0.3, 0.02, 0.9, 2.0)], SETTINGS)[0]


def random_state(seed=1):
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(6, 6))
    return np.array([40.0, 5.0, -3.0, 1.0, -2.0, 0.5]), root @ root.T


def test_the_start_is_at_rest_with_the_deviation_that_is_told():
    _, P0 = random_state()
    x, P = np.ones(6), np.ones((6, 6))
    begin(x, P, R_V, P0[:3, :3].copy(), 1.5)
    assert x.tolist() == [3.0, 1.0, -2.0, 0.0, 0.0, 0.0]
    assert np.array_equal(P[:3, :3], P0[:3, :3])
    assert np.array_equal(P[3:, 3:], 2.25 * np.eye(3)) and not P[:3, 3:].any()


def test_prediction_is_the_textbook_one():
    x, P = random_state()
    Phi = np.eye(6) + 0.3 * np.eye(6, k=3)
    expected = Phi @ x, Phi @ P @ Phi.T + np.diag([0.2] * 3 + [0.0] * 3)
    predict(x, P, 0.3, 0.2)
    assert x == pytest.approx(expected[0])
    assert P == pytest.approx(expected[1])


@pytest.mark.parametrize("sensor", [IMAGE, ANGLES])
def test_the_update_is_the_textbook_one(sensor):
    x, P = random_state()
    cfg, G = settings(sensor), np.zeros((2, 3))
    first, second, distance = see(sensor, C, x[:3] - R_V, 0.5)
    slope(sensor, C, x[:3] - R_V, 0.5, G)
    H, e = np.hstack([G, np.zeros((2, 3))]), np.array([0.03, -0.02])
    sigma = 0.02 * (1 - 0.9**distance) if sensor == ANGLES else np.hypot(0.3 / distance, 0.02)
    S = H @ P @ H.T + (2.0 * sigma) ** 2 * np.eye(2)
    K = P @ H.T @ np.linalg.inv(S)
    expected = x + K @ e, P - K @ S @ K.T
    measured = np.array([first, second]) + e
    nis = update(x, P, R_V, C, measured, cfg, np.zeros(1, SCRATCH)[0])
    assert nis == pytest.approx(e @ np.linalg.solve(S, e))
    assert x == pytest.approx(expected[0])
    assert P == pytest.approx(expected[1])


def test_the_velocity_is_found_by_one_who_does_not_fly_straight():
    """Noise-free sightings from a weaving vehicle: position and velocity come out right."""
    r, v = np.array([60.0, 4.0, -2.0]), np.array([-1.0, 0.8, 0.3])
    x, P, cfg = np.zeros(6), np.zeros((6, 6)), settings(IMAGE)
    cfg["sigma_range"], cfg["sigma_angle"] = 0.0, 0.001
    begin(x, P, 1.2 * r, np.diag([150.0, 4.0, 4.0]), 2.0)
    for k in range(300):
        t = 0.02 * (k + 1)
        r_V = np.array([5.0 * t, 2.0 * np.sin(t), 3.0 * np.cos(0.7 * t)])
        predict(x, P, 0.02, 0.0)
        now = r + t * v - r_V
        update(x, P, r_V, C, now[1:] / now[0], cfg, np.zeros(1, SCRATCH)[0])
    assert x[:3] == pytest.approx(r + 6.0 * v, abs=0.2)
    assert x[3:] == pytest.approx(v, abs=0.1)
