"""The camera: field of view, dropouts and noise."""

import math

import numba
import numpy as np
import pytest
from scipy import stats

from visenvs.core.compile import kernel
from visenvs.core.frames import camera_towards
from visenvs.sensors.camera import in_view, take_image

pytestmark = pytest.mark.kernel

COUNT = 2_000 if numba.config.DISABLE_JIT else 50_000
SETTINGS = np.dtype(
    [(name, "f8") for name in ("min_range", "half_width", "p_detect", "sigma_range", "sigma_angle")]
)


@kernel
def photograph(C, r, settings, seed, stream, seen, pixels):
    """One image at each step, into seen (n,) and pixels (n, 2)."""
    for step in range(seen.shape[0]):
        seen[step] = take_image(C, r, settings[0], seed, 0, step, stream, pixels[step])


def camera(min_range=0.5, half_width=1.0, p_detect=1.0, sigma_range=0.0, sigma_angle=0.0):
    return np.array([(min_range, half_width, p_detect, sigma_range, sigma_angle)], SETTINGS)


def images(r, settings, C=None, seed=7, stream=1, count=COUNT):
    seen, pixels = np.zeros(count, bool), np.full((count, 2), np.nan)
    photograph(
        np.eye(3) if C is None else C, np.array(r, float), settings, seed, stream, seen, pixels
    )
    return seen, pixels


@pytest.mark.parametrize(
    ("X", "y", "z", "visible"),
    [
        (10.0, 0.0, 0.0, True),
        (0.5, 0.0, 0.0, False),
        (math.nextafter(0.5, 1.0), 0.0, 0.0, True),
        (-10.0, 0.0, 0.0, False),
        (10.0, math.nextafter(1.0, 0.0), 0.0, True),
        (10.0, 1.0, 0.0, False),
        (10.0, -1.0, 0.0, False),
        (10.0, -math.nextafter(1.0, 0.0), 0.0, True),
        (10.0, 0.0, 1.0, False),
        (10.0, 0.0, -1.0, False),
        (10.0, 0.9, -0.9, True),
    ],
)
def test_the_view_ends_at_the_edges_of_the_image(X, y, z, visible):
    assert in_view(X, y, z, 0.5, 1.0) == visible


@pytest.mark.parametrize(
    ("r", "visible"),
    [
        ((10, 9, 0), True),
        ((10, 11, 0), False),
        ((10, 0, -11), False),
        ((-10, 0, 0), False),
        ((0.4, 0, 0), False),
    ],
)
def test_a_target_outside_the_view_leaves_no_measurement(r, visible):
    seen, pixels = images(r, camera(), count=3)
    assert (seen == visible).all()
    assert (np.isfinite(pixels) == visible).all()


def test_without_noise_the_measurement_is_the_projection():
    r = np.array([20.0, 30.0, -5.0])
    C = np.empty((3, 3))
    camera_towards(np.array([20.0, 25.0, 0.0]), C)
    X, Y, Z = C @ r
    _, pixels = images(r, camera(), C, count=3)
    assert np.allclose(pixels, [Y / X, Z / X], rtol=1e-14)


@pytest.mark.parametrize("p_detect", [0.0, 0.3, 0.95])
def test_detection_rate(p_detect):
    seen, pixels = images((20, 1, 1), camera(p_detect=p_detect))
    assert stats.binomtest(int(seen.sum()), COUNT, p_detect).pvalue > 1e-3
    assert np.isnan(pixels[~seen]).all()


def test_misses_come_independently():
    seen, _ = images((20, 1, 1), camera(p_detect=0.5))
    assert abs(np.corrcoef(seen[:-1], seen[1:])[0, 1]) < 4.5 / math.sqrt(COUNT)


@pytest.mark.parametrize("depth", [2.0, 10.0, 80.0])
@pytest.mark.parametrize(("sigma_range", "sigma_angle"), [(0.3, 0.0), (0.0, 0.02), (0.3, 0.02)])
def test_noise_falls_with_depth(depth, sigma_range, sigma_angle):
    """sd^2 = (sigma_range / X)^2 + sigma_angle^2 (4.68), inside chi-square bounds, on both axes."""
    settings = camera(half_width=2.0, sigma_range=sigma_range, sigma_angle=sigma_angle)
    _, pixels = images((depth, 0.25 * depth, -0.5 * depth), settings)
    noise = (pixels - [0.25, -0.5]) / math.hypot(sigma_range / depth, sigma_angle)
    low, high = stats.chi2.ppf([5e-4, 1 - 5e-4], COUNT) / COUNT
    assert ((noise**2).mean(axis=0) > low).all()
    assert ((noise**2).mean(axis=0) < high).all()
    assert np.abs(noise.mean(axis=0)).max() < 4.5 / math.sqrt(COUNT)
    assert abs(np.corrcoef(noise.T)[0, 1]) < 4.5 / math.sqrt(COUNT)
    assert stats.kstest(noise.ravel(), "norm").pvalue > 1e-3


def test_dropouts_do_not_shift_the_noise():
    always = images((20, 1, 1), camera(sigma_range=0.3))[1]
    seen, sometimes = images((20, 1, 1), camera(sigma_range=0.3, p_detect=0.5))
    assert np.array_equal(sometimes[seen], always[seen])


def test_noise_and_detection_are_independent():
    seen, pixels = images((20, 0, 0), camera(sigma_range=0.3, p_detect=0.3))
    assert stats.kstest(pixels[seen].ravel() * 20 / 0.3, "norm").pvalue > 1e-3


def test_streams_and_seeds_are_different_cameras():
    settings = camera(sigma_range=0.3)
    here = images((20, 0, 0), settings)[1]
    for there in (
        images((20, 0, 0), settings, stream=2)[1],
        images((20, 0, 0), settings, seed=8)[1],
    ):
        assert abs(np.corrcoef(here[:, 0], there[:, 0])[0, 1]) < 4.5 / math.sqrt(COUNT)
