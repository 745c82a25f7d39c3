"""Inverse-range filters: coordinates, first covariance, agreement of the two updates, bounds."""

import math

import numpy as np
import pytest

from visenvs.core.frames import rotate
from visenvs.core.sight import SENSORS, noise_variance, ray, see, to_angles
from visenvs.estimation import sighting
from visenvs.estimation.inverse_range import (
    LEAST,
    MOST,
    begin,
    keep_in_bounds,
    position,
    update_unscented,
)

pytestmark = pytest.mark.kernel

ANCHOR, HERE = np.array([3.0, -4.0, 1.0]), np.array([60.0, 10.0, -5.0])
SEEN = np.array([0.2, -0.1])
LEVEL = np.eye(3)


def started(cfg, scratch, C=LEVEL, seen=SEEN, prior=(300.0, 86.6)):
    x, P = np.empty(3), np.empty((3, 3))
    r0 = begin(x, P, C, seen, prior[0], prior[1], cfg, scratch)
    return x, P, r0


def place(x, here=HERE):
    r, J = np.empty(3), np.empty((3, 3))
    position(x, ANCHOR, here, np.empty((3, 3)), r, J)
    return r, J


def extended(x, P, seen, cfg, scratch, here=HERE, C=LEVEL):
    return sighting.update(x, P, *place(x, here), C, seen, cfg, scratch)


def unscented(x, P, seen, cfg, scratch, here=HERE, C=LEVEL):
    return update_unscented(x, P, ANCHOR, here, C, seen, cfg, scratch)


def test_the_position_and_its_slope(derivative):
    x = np.array([0.3, -0.2, 1 / 250.0])
    r, J = place(x)
    u = [math.cos(0.2) * math.cos(0.3), math.cos(0.2) * math.sin(0.3), -math.sin(0.2)]
    assert r == pytest.approx(250.0 * np.array(u) + ANCHOR - HERE, rel=1e-13)
    steps = [1e-6, 1e-6, 1e-9]
    assert derivative(lambda at: place(at)[0], x, steps) == pytest.approx(J, rel=1e-6, abs=1e-5)


@pytest.mark.parametrize("sensor", SENSORS)
@pytest.mark.parametrize("seed", range(3))
def test_the_first_covariance(sensor, seed, settings, scratch, attitude, derivative):
    """Angles in N with the noise of the measured numbers; 1/r with that of the prior."""
    cfg, C = settings(sensor), attitude(seed)
    x, P, r0 = started(cfg, scratch, C)

    def towards(seen):
        D = np.empty((3, 3))
        ray(int(cfg["sensor"]), C, seen[0], seen[1], np.empty((3, 3)), D)
        return to_angles(*D[:, 0])

    J = derivative(towards, SEEN)[:2]
    theta, phi, length = towards(SEEN)
    assert x == pytest.approx([theta, phi, 1.0 / r0], rel=1e-12)
    assert r0 == pytest.approx(300.0 * length)
    expected = J @ J.T * sighting.assumed_variance(300.0, cfg)
    assert P[:2, :2] == pytest.approx(expected, rel=1e-7, abs=1e-10)
    assert P[2].tolist() == [0.0, 0.0, pytest.approx((86.6 / 300.0 / r0) ** 2, rel=1e-12)]
    assert np.array_equal(P, P.T)


def textbook(x, P, seen, cfg, here, C):
    """Cubature update with numpy, far from any seam."""
    root = np.linalg.cholesky(P) * math.sqrt(3.0)
    points = np.vstack([x + root.T, x - root.T])
    sensor, nearest = int(cfg["sensor"]), float(cfg["min_range"])
    z = np.array([see(sensor, C, place(p, here)[0], nearest)[:2] for p in points])
    dx, dz, mean = points - x, z - z.mean(axis=0), z.mean(axis=0)
    R = noise_variance(see(sensor, C, place(x, here)[0], nearest)[2], cfg)
    S, cross = dz.T @ dz / 6 + R * np.eye(2), dx.T @ dz / 6
    K, e = cross @ np.linalg.inv(S), seen - mean
    return x + K @ e, P - K @ S @ K.T, e @ np.linalg.solve(S, e)


@pytest.mark.parametrize("sensor", SENSORS)
@pytest.mark.parametrize("seed", range(4))
def test_the_unscented_update_is_the_textbooks(sensor, seed, settings, scratch, attitude):
    cfg, C = settings(sensor, sigma_angle=0.05), attitude(seed)
    x, P, _ = started(cfg, scratch, C)
    rng = np.random.default_rng(seed)
    for k in range(10):
        here = ANCHOR + k * np.array([12.0, 2.0, -1.0])
        seen = see(int(cfg["sensor"]), C, place(x, here)[0], 1.0)[:2] + 0.05 * rng.normal(size=2)
        expected = textbook(x, P, seen, cfg, here, C)
        nis = unscented(x, P, seen, cfg, scratch, here, C)
        assert x == pytest.approx(expected[0], rel=1e-9)
        assert pytest.approx(expected[1], rel=1e-7, abs=1e-12) == P
        assert nis == pytest.approx(expected[2], rel=1e-8)
        assert np.array_equal(P, P.T)


@pytest.mark.parametrize("sensor", SENSORS)
def test_both_updates_agree_where_sight_is_straight(sensor, settings, scratch):
    cfg = settings(sensor, sigma_angle=1e-3)
    x, P, _ = started(cfg, scratch, prior=(300.0, 0.5))
    y, Q, before = x.copy(), P.copy(), x.copy()
    seen = np.array(see(int(cfg["sensor"]), LEVEL, place(x)[0], 1.0)[:2])
    seen += np.array([1e-3, -5e-4])
    one, other = unscented(x, P, seen, cfg, scratch), extended(y, Q, seen, cfg, scratch)
    assert one == pytest.approx(other, rel=1e-3)
    assert x - before == pytest.approx(y - before, rel=1e-3, abs=1e-9)
    assert pytest.approx(Q, rel=1e-3, abs=1e-13) == P


@pytest.mark.parametrize("update", [extended, unscented])
@pytest.mark.parametrize("angle", [0.7, 2.0, math.pi, -2.9])
def test_north_does_not_matter(update, angle, settings, scratch):
    """Camera, anchor and path turned about the vertical: the same track, its azimuth turned."""
    cfg, offset = settings(), np.array([40.0, 15.0, -8.0])
    c, s = math.cos(angle), math.sin(angle)
    turned = np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])  # the camera's axes in N, as C_CN
    x, P, _ = started(cfg, scratch)
    y, Q, _ = started(cfg, scratch, turned)
    seen = np.array([0.35, -0.2])
    one = update(x, P, seen, cfg, scratch, ANCHOR + offset)
    moved = np.array(rotate(turned.T.copy(), offset))
    other = update(y, Q, seen, cfg, scratch, ANCHOR + moved, turned)
    assert other == pytest.approx(one, rel=1e-9)
    assert math.remainder(y[0] - angle - x[0], 2 * math.pi) == pytest.approx(0.0, abs=1e-10)
    assert y[1:] == pytest.approx(x[1:], rel=1e-9)
    assert pytest.approx(P, rel=1e-7, abs=1e-12) == Q


@pytest.mark.parametrize("update", [extended, unscented])
def test_a_sighting_from_the_anchor_says_nothing_of_the_range(update, settings, scratch):
    cfg = settings()
    x, P, r0 = started(cfg, scratch)
    update(x, P, SEEN + 0.05, cfg, scratch, ANCHOR)
    assert x[2] == pytest.approx(1.0 / r0, rel=1e-12)
    assert P[2, 2] == pytest.approx((86.6 / 300.0 / r0) ** 2, rel=1e-9)
    assert P[0, 0] < 0.51 * sighting.assumed_variance(300.0, cfg)


@pytest.mark.parametrize("update", [extended, unscented])
def test_parallax_tells_a_near_object_from_a_far_one(update, settings, scratch):
    """Passing it at 30 m: the range comes out within a few standard deviations, and those small."""
    cfg, truth = settings(fade=0.0, sigma_angle=0.01), ANCHOR + np.array([200.0, 40.0, -20.0])
    for prior in (130.0, 205.0, 390.0):
        C, seen = LEVEL, np.array(see(1, LEVEL, truth - ANCHOR, 1.0)[:2])
        x, P, r0 = started(cfg, scratch, C, seen, (prior, 0.2887 * prior))
        for k in range(1, 150):
            here = ANCHOR + np.array([k, 0.0, 0.0])
            noise = 0.01 * np.array([math.sin(7.0 * k), math.cos(11.0 * k)])
            seen = np.array(see(1, C, truth - here, 1.0)[:2]) + noise
            update(x, P, seen, cfg, scratch, here)
            keep_in_bounds(x, r0)
        assert 1 / x[2] == pytest.approx(np.linalg.norm(truth - ANCHOR), rel=0.02)
        assert math.sqrt(P[2, 2]) < 0.02 * x[2]


def test_the_range_is_kept_in_bounds():
    for rho, kept in ((-1.0, LEAST / 50), (0.0, LEAST / 50), (1 / 50, 1 / 50), (9.0, MOST / 50)):
        x = np.array([0.1, 0.2, rho])
        keep_in_bounds(x, 50.0)
        assert x.tolist() == [0.1, 0.2, kept]
