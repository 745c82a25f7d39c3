"""Image points and angles: geometry, derivatives, noise."""

import math

import numpy as np
import pytest

from visenvs.core.sight import ANGLES, IMAGE, differ, noise_variance, ray, see, slope, turn

pytestmark = pytest.mark.kernel

LEVEL = np.eye(3)


def tilted(seed):
    """A random rotation that keeps what is ahead ahead."""
    q = np.r_[3.0, np.random.default_rng(seed).normal(size=3) * 0.5]
    w, x, y, z = q / np.linalg.norm(q)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)],
            [2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x)],
            [2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def differences(f, x, h=1e-6):
    rows = [(np.array(f(x + h * e)) - np.array(f(x - h * e))) / (2 * h) for e in np.eye(len(x))]
    return np.array(rows).T


def record(sensor, **values):
    out = np.zeros((), [("sensor", "i8"), *((k, "f8") for k in values)])
    out["sensor"] = sensor
    for name, value in values.items():
        out[name] = value
    return out[()]


def test_right_and_below_are_positive():
    r = np.array([10.0, 5.0, 2.0])
    assert see(IMAGE, LEVEL, r, 1.0) == pytest.approx((0.5, 0.2, 10.0))
    theta, phi, length = see(ANGLES, LEVEL, r, 1.0)
    assert (theta, phi) == pytest.approx((math.atan(0.5), math.asin(2.0 / length)))
    assert length == pytest.approx(math.sqrt(129.0))


@pytest.mark.parametrize("sensor", [IMAGE, ANGLES])
@pytest.mark.parametrize("seed", range(5))
def test_the_slope_is_that_of_the_measurement(sensor, seed):
    C, H = tilted(seed), np.empty((2, 3))
    r = np.array([30.0, 4.0, -6.0]) + np.random.default_rng(seed).normal(size=3)
    slope(sensor, C, r, 1.0, H)
    expected = differences(lambda at: see(sensor, C, at, 1.0)[:2], r)
    assert pytest.approx(expected, abs=1e-9) == H


@pytest.mark.parametrize("sensor", [IMAGE, ANGLES])
@pytest.mark.parametrize("r", [(0.0, 0.0, 0.0), (1e-9, 0.0, 0.0), (0.0, 0.0, 5.0), (-3.0, 0, 0)])
def test_the_slope_is_finite_anywhere(sensor, r):
    H = np.empty((2, 3))
    slope(sensor, LEVEL, np.array(r), 0.5, H)
    assert np.isfinite(H).all()
    assert np.abs(H).max() <= 20.0


@pytest.mark.parametrize("sensor", [IMAGE, ANGLES])
@pytest.mark.parametrize("seed", range(3))
def test_a_ray_leads_back_to_its_measurement(sensor, seed):
    C, D, work = tilted(seed), np.empty((3, 3)), np.empty((3, 3))

    def towards(measured):
        ray(sensor, C, measured[0], measured[1], work, D)
        return D[:, 0].copy()

    measured = np.random.default_rng(seed).uniform(-0.5, 0.5, 2)
    expected = differences(towards, measured)
    d = towards(measured)
    assert see(sensor, C, 70.0 * d, 1.0) == pytest.approx((*measured, 70.0), rel=1e-12)
    assert D[:, 1:] == pytest.approx(expected, abs=1e-9)


def test_turned_axes():
    A = np.empty((3, 3))
    turn(0.7, -0.3, A)
    assert A[:, 0] == pytest.approx(
        [math.cos(0.3) * math.cos(0.7), math.cos(0.3) * math.sin(0.7), -math.sin(0.3)]
    )
    assert A.T @ A == pytest.approx(np.diag([1.0, math.cos(0.3) ** 2, 1.0]), abs=1e-15)


def test_angles_differ_by_the_shorter_way_and_image_points_do_not_wrap():
    assert differ(ANGLES, 3.1, -3.1) == pytest.approx(6.2 - 2 * math.pi)
    assert differ(IMAGE, 3.1, -3.1) == 6.2


@pytest.mark.parametrize(
    ("length", "sigma"),
    [(10.0, 0.0134), (30.0, 0.036), (60.0, 0.063), (100.0, 0.089), (300.0, 0.133), (1e4, 0.140)],
)
def test_the_noise_of_the_iisc_report(length, sigma):
    """20 % of 120 degrees is three standard deviations far away (3.25)-(3.26)."""
    cfg = record(ANGLES, sigma_angle=0.2 * math.radians(120) / 3, fade=0.99, sigma_range=7.0)
    assert math.sqrt(noise_variance(length, cfg)) == pytest.approx(sigma, abs=6e-4)


def test_the_noise_of_an_image_point_and_of_unfading_angles():
    image = record(IMAGE, sigma_angle=0.1, fade=0.99, sigma_range=0.0)
    angles = record(ANGLES, sigma_angle=0.1, fade=0.0, sigma_range=7.0)
    assert noise_variance(50.0, image) == pytest.approx(0.01)
    assert noise_variance(50.0, angles) == pytest.approx(0.01)
