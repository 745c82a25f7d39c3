"""The Cartesian track: its first covariance, its update, what it cannot know."""

import math

import numpy as np
import pytest

from visenvs.core.sight import SENSORS, ray
from visenvs.core.units import FOOT
from visenvs.estimation import stationary
from visenvs.estimation.inertial import begin, begin_thesis, position, predict
from visenvs.estimation.sighting import assumed_variance, expect, spread, update, ztest

pytestmark = pytest.mark.kernel

HERE = np.array([100.0, -20.0, 5.0])
SEEN = np.array([0.2, -0.1])


def started(how, cfg, scratch, C, seen=SEEN, prior=(300.0, 50.0)):
    x, P = np.empty(3), np.empty((3, 3))
    how(x, P, HERE, C, seen, prior[0], prior[1], cfg, scratch)
    return x, P


def use(x, P, C, seen, cfg, scratch, here=HERE):
    r, J = np.empty(3), np.empty((3, 3))
    position(x, here, r, J)
    return update(x, P, r, J, C, seen, cfg, scratch)


@pytest.mark.parametrize("sensor", SENSORS)
@pytest.mark.parametrize("seed", range(3))
def test_the_first_covariance_is_that_of_range_and_noise(
    sensor, seed, settings, scratch, attitude, derivative
):
    cfg, C = settings(sensor), attitude(seed)
    x, P = started(begin, cfg, scratch, C)

    def place(given):
        D, work = np.empty((3, 3)), np.empty((3, 3))
        ray(int(cfg["sensor"]), C, given[1], given[2], work, D)
        return HERE + given[0] * D[:, 0]

    given = np.r_[300.0, SEEN]
    J, R = derivative(place, given), assumed_variance(300.0, cfg)
    assert x == pytest.approx(place(given), rel=1e-14)
    assert pytest.approx(J @ np.diag([2500.0, R, R]) @ J.T, rel=1e-6, abs=1e-6) == P
    assert np.array_equal(P, P.T)


def test_the_corrected_covariance_of_the_thesis(settings, scratch):
    """(3.7) with r0^2 R, and the terms z s^2 that tie the lateral position to the range."""
    x, P = started(begin, settings("image", sigma_angle=0.1), scratch, np.eye(3))
    s2, y, z, lateral = 2500.0, SEEN[0], SEEN[1], 300.0**2 * 0.01
    expected = s2 * np.outer([1, y, z], [1, y, z]) + np.diag([0.0, lateral, lateral])
    assert x - HERE == pytest.approx([300.0, 60.0, -30.0], rel=1e-14)
    assert pytest.approx(expected, rel=1e-14) == P


def test_the_printed_covariance_holds_in_feet(settings, scratch):
    prior = 300 * FOOT, 50 * FOOT
    cfg = settings("image", sigma_angle=0.1)
    x, P = started(begin_thesis, cfg, scratch, np.eye(3), prior=prior)
    assert pytest.approx(np.diag([2500.0, 3.0, 3.0]), rel=1e-12, abs=1e-12) == P / FOOT**2
    assert np.array_equal(x, started(begin, cfg, scratch, np.eye(3), prior=prior)[0])


@pytest.mark.parametrize("seed", range(3))
def test_the_update_is_that_of_the_rendezvous_filter(seed, settings, scratch, attitude):
    C = attitude(seed)
    cfg = settings("image", sigma_angle=0.02, sigma_range=0.3)
    x, P = started(begin, cfg, scratch, C)
    theirs = np.zeros((), [(n, "f8") for n in ("sigma_range", "sigma_angle", "min_range", "gate")])
    theirs["sigma_range"], theirs["sigma_angle"], theirs["min_range"] = 0.3, 0.02, 1.0
    rhat, W, seen = x - HERE, P.copy(), SEEN + 0.03
    work = np.zeros(1, stationary.SCRATCH)[0]
    expected = stationary.update(rhat, W, C, *seen, theirs[()], np.empty(2), work)
    assert use(x, P, C, seen, cfg, scratch) == pytest.approx(expected, rel=1e-9)
    assert x - HERE == pytest.approx(rhat, rel=1e-10)
    assert pytest.approx(W, rel=1e-9, abs=1e-9) == P


@pytest.mark.parametrize("sensor", SENSORS)
def test_the_test_value_is_the_nis_of_the_update(sensor, settings, scratch, attitude):
    cfg, C, seen = settings(sensor), attitude(7), SEEN + np.array([0.05, -0.02])
    x, P = started(begin, cfg, scratch, C)
    predicted, factor, r = np.empty(2), np.empty(3), x - HERE
    expect(r, P, C, cfg, scratch, predicted, factor)
    value = ztest(seen, predicted, factor, cfg, np.empty(2))
    assert predicted == pytest.approx(SEEN, rel=1e-12)
    assert value == pytest.approx(use(x, P, C, seen, cfg, scratch), rel=1e-10)


def test_the_threshold_of_the_thesis_rejects_every_fifth_right_sighting(settings, scratch):
    """ztest_max = 3 with two degrees of freedom: exp(-3/2) = 22.3 %, not the 9.364 % of 3.5.2."""
    cfg, rng, n = settings("image", sigma_angle=0.01), np.random.default_rng(4), 4000
    x, P = started(begin, cfg, scratch, np.eye(3), prior=(300.0, 2.0))
    predicted, factor, rejected = np.empty(2), np.empty(3), 0
    expect(x - HERE, P, np.eye(3), cfg, scratch, predicted, factor)
    for r in rng.multivariate_normal(x - HERE, P, n):
        seen = r[1:] / r[0] + 0.01 * rng.normal(size=2)
        rejected += ztest(seen, predicted, factor, cfg, np.empty(2)) > 3.0
    assert rejected / n == pytest.approx(math.exp(-1.5), abs=0.02)


def test_a_filter_that_doubts_its_camera_assumes_more_noise(settings, scratch):
    cfg, doubtful = settings("image", sigma_angle=0.02), settings("image", sigma_angle=0.02)
    doubtful["assumed_noise"] = 5.0
    assert assumed_variance(80.0, doubtful) == pytest.approx(25 * assumed_variance(80.0, cfg))


@pytest.mark.parametrize("sensor", SENSORS)
def test_the_range_of_what_is_dead_ahead_stays_unknown(sensor, settings, scratch):
    cfg, ahead = settings(sensor, sigma_angle=0.01), np.zeros(2)
    x, P = started(begin, cfg, scratch, np.eye(3), seen=ahead)
    for k in range(20):
        use(x, P, np.eye(3), ahead, cfg, scratch, HERE + 10.0 * k * np.eye(3)[0])
    assert P[0, 0] == pytest.approx(2500.0, rel=1e-9)
    assert max(P[1, 1], P[2, 2]) < 2.0


def test_process_noise_widens_every_axis_alike():
    P = np.diag([4.0, 5.0, 6.0]) + 0.1
    expected = P + 0.02 * np.eye(3)
    predict(P, 0.02)
    assert np.array_equal(P, expected)


def test_a_covariance_in_other_coordinates():
    rng = np.random.default_rng(0)
    J, root, cov = rng.normal(size=(3, 3)), rng.normal(size=(3, 3)), np.empty((3, 3))
    P = root @ root.T
    spread(P, J, np.empty((3, 3)), cov)
    assert cov == pytest.approx(J @ P @ J.T, abs=1e-13)
