"""The navigation filter: its derivatives, dead reckoning, and consistency on drawn landmarks."""

import math

import numba
import numpy as np
import pytest
from scipy import stats

from visenvs.core.units import GRAVITY
from visenvs.estimation import ud, vio
from visenvs.estimation.navigator import START, settings
from visenvs.sensors.images.optics import Optics
from visenvs.sensors.imu import take_inertial

pytestmark = pytest.mark.kernel

DOWN = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])  # C_CB
DT = 0.01


def exponential(e):
    R = np.empty((3, 3))
    vio.rotation(np.array(e, float), R)
    return R


def somewhere():
    nav, scratch = np.zeros(1, vio.NAVIGATION)[0], np.zeros(1, vio.SCRATCH)[0]
    C = exponential([0.1, -0.2, 0.7])
    vio.begin(nav, np.array([1.0, 2.0, -2.0]), np.array([0.5, -0.3, 0.1]), C, START)
    nav["landmarks"][0], nav["alive"][0] = (1.3, 2.2, 0.0), 1.0
    nav["biases"][:] = [[0.05, -0.02, 0.03], [0.002, -0.001, 0.003]]
    return nav, scratch


def perturbed(nav, k, size):
    """A copy with one error added to it."""
    out = nav.copy()
    for name, start in (("p", 0), ("v", 3)):
        if start <= k < start + 3:
            out[name][k - start] += size
    if 6 <= k < 9:
        out["C"] = exponential(size * np.eye(3)[k - 6]) @ out["C"]
    if 9 <= k < 15:
        out["biases"][(k - 9) // 3, (k - 9) % 3] += size
    if k >= 15:
        out["landmarks"][(k - 15) // 3, (k - 15) % 3] += size
    return out


def error(one, other):
    """The errors of `one` relative to `other`, (15,)."""
    turn = one["C"] @ other["C"].T
    e = 0.5 * np.array([turn[1, 2] - turn[2, 1], turn[2, 0] - turn[0, 2], turn[0, 1] - turn[1, 0]])
    off = [one[name] - other[name] for name in ("p", "v")]
    return np.concatenate([*off, e, (one["biases"] - other["biases"]).ravel()])


def test_a_rotation_turns_the_axes():
    assert exponential([0.0, 0.0, math.pi / 2]) @ [1, 0, 0] == pytest.approx([0, -1, 0])
    R = exponential([0.3, -1.2, 0.4])
    assert R @ R.T == pytest.approx(np.eye(3), abs=1e-14)


def test_the_transition_is_the_derivative_of_the_integration():
    nav, scratch = somewhere()
    force, rate = np.array([0.4, -0.8, -9.5]), np.array([0.3, -0.2, 0.5])
    moved = nav.copy()
    for _ in range(5):
        vio.integrate(moved, force, rate, DT, scratch)
    for k in range(vio.VEHICLE):
        ends = []
        for sign in (1.0, -1.0):
            other = perturbed(nav, k, sign * 1e-6)
            for _ in range(5):
                vio.integrate(other, force, rate, DT, scratch)
            ends.append(error(other, moved))
        slope = (ends[0] - ends[1]) / 2e-6
        assert moved["Phi"][:, k] == pytest.approx(slope, abs=2e-3)


def test_the_sighting_has_its_derivative():
    nav, scratch = somewhere()
    pixel, other = np.empty(2), np.empty(2)
    vio.expect(nav, 0, DOWN, 0.2, scratch, pixel)
    h = scratch["h"].copy()
    for k in range(18):
        ends = []
        for sign in (1.0, -1.0):
            vio.expect(perturbed(nav, k, sign * 1e-6), 0, DOWN, 0.2, scratch, other)
            ends.append(other.copy())
        assert h[:, k] == pytest.approx((ends[0] - ends[1]) / 2e-6, abs=1e-6)
    assert not h[:, 18:].any()


def test_without_noise_the_samples_lead_along_the_path():
    """A turn at constant speed and rate, one minute."""
    nav, scratch = np.zeros(1, vio.NAVIGATION)[0], np.zeros(1, vio.SCRATCH)[0]
    rate, speed = 0.5, 2.0
    vio.begin(nav, np.zeros(3), np.array([speed, 0.0, 0.0]), np.eye(3), START)
    force = np.array([0.0, rate * speed, -GRAVITY])
    for _ in range(6000):
        vio.integrate(nav, force, np.array([0.0, 0.0, rate]), DT, scratch)
    end = speed / rate * np.array([math.sin(60 * rate), 1.0 - math.cos(60 * rate), 0.0])
    assert nav["p"] == pytest.approx(end, abs=1e-3)


@pytest.mark.skipif(numba.config.DISABLE_JIT, reason="many flights")
def test_flights_over_drawn_landmarks_are_as_good_as_the_covariance_says():
    """NEES of position and velocity after 3 s of hovering, 40 runs, 8 landmarks."""
    cfg, nees = settings(Optics(), DT)[0], []
    cfg["gate"] = 0.0
    for run in range(40):
        rng = np.random.default_rng(run)
        nav, scratch = np.zeros(1, vio.NAVIGATION)[0], np.zeros(1, vio.SCRATCH)[0]
        off = START.repeat(3) * rng.normal(size=15)
        p, C, biases = np.array([0.0, 0.0, -2.0]), np.eye(3), off[9:].reshape(2, 3).copy()
        vio.begin(nav, p - off[:3], -off[3:6], exponential(off[6:9]).T, START)
        places = np.append(rng.uniform(-0.8, 0.8, (8, 2)), np.zeros((8, 1)), axis=1)
        sample, pixel = np.empty((2, 3)), np.empty(2)
        for k in range(30):
            for m in range(10):
                args = (cfg, run, 0, 10 * k + m, 0, sample)
                take_inertial(C, np.zeros(3), np.zeros(3), biases, *args)
                vio.integrate(nav, sample[0], sample[1], DT, scratch)
            vio.predict(nav, cfg, scratch)
            vio.use_height(nav, 2.0 + 0.02 * rng.normal(), 0.02, scratch)
            for j, place in enumerate(places):
                r = DOWN @ C @ (place - p)
                seen = r[1:] / r[0] + cfg["sigma_pixel"] * rng.normal(size=2)
                if nav["alive"][j]:
                    assert vio.use_landmark(nav, j, DOWN, seen, cfg, scratch, pixel)
                else:
                    assert vio.add_landmark(nav, j, DOWN, seen, cfg, scratch, pixel)
            vio.correct(nav, scratch)
        P = np.empty((vio.STATES, vio.STATES))
        ud.covariance(nav["U"], nav["D"], P)
        e = np.concatenate([nav["p"] - p, nav["v"]])
        nees.append(e @ np.linalg.solve(P[:6, :6], e))
    low, high = stats.chi2.ppf([1e-4, 1 - 1e-4], 6 * 40) / 40
    assert low < np.mean(nees) < high


def test_a_landmark_that_is_too_near_is_not_begun():
    """Looking 45 deg ahead from just above the least range, the lower part of the picture is."""
    nav, scratch, pixel = np.zeros(1, vio.NAVIGATION)[0], np.zeros(1, vio.SCRATCH)[0], np.empty(2)
    vio.begin(nav, np.array([0.0, 0.0, -0.22]), np.zeros(3), np.eye(3), START)
    half = math.sqrt(0.5)
    ahead = np.array([[half, 0.0, half], [0.0, 1.0, 0.0], [-half, 0.0, half]])
    cfg, before = settings(Optics(), DT)[0], (nav["U"].copy(), nav["D"].copy())
    near, far = np.array([0.0, 0.9]), np.array([0.0, -0.2])
    assert not vio.add_landmark(nav, 0, ahead, near, cfg, scratch, pixel)
    assert nav["alive"][0] == 0.0
    assert np.array_equal(nav["U"][:15, :15], before[0][:15, :15])
    assert np.array_equal(nav["D"][:15], before[1][:15])
    assert vio.add_landmark(nav, 0, ahead, far, cfg, scratch, pixel)
    assert nav["alive"][0] == 1.0
