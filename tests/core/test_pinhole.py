"""Projection and its Jacobian."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from visenvs.core.pinhole import jacobian, pixel_variance, project

pytestmark = pytest.mark.kernel

NEAREST = 0.5


def scenes(count=50, seed=0):
    """Random attitudes, and positions in front of the camera and within 60 degrees of its axis."""
    rng = np.random.default_rng(seed)
    for C in Rotation.random(count, rng=rng).as_matrix():
        depth = rng.uniform(1.0, 60.0)
        in_camera = depth * np.array([1.0, *rng.uniform(-1.7, 1.7, 2)])
        yield np.ascontiguousarray(C), C.T @ in_camera, in_camera


def image_point(C, r):
    return np.array(project(C, r, NEAREST)[1:])


def test_projection_is_the_ratio_of_camera_components():
    for C, r, (X, Y, Z) in scenes():
        assert project(C, r, NEAREST) == pytest.approx((X, Y / X, Z / X), rel=1e-12, abs=1e-12)


def test_right_is_positive_y_and_down_is_positive_z():
    X, y, z = project(np.eye(3), np.array([10.0, 2.0, -3.0]), NEAREST)
    assert (X, y, z) == pytest.approx((10.0, 0.2, -0.3), rel=1e-15)


@pytest.mark.parametrize("depth", [-20.0, 0.0, 0.4])
def test_nearer_points_are_projected_at_the_nearest_depth(depth):
    assert project(np.eye(3), np.array([depth, 1.0, 2.0]), NEAREST) == (
        NEAREST,
        1.0 / NEAREST,
        2.0 / NEAREST,
    )


def test_jacobian_against_central_differences():
    H = np.empty((2, 3))
    for C, r, _ in scenes():
        X, y, z = project(C, r, NEAREST)
        jacobian(C, X, y, z, H)
        h = 1e-5 * X
        numeric = np.stack(
            [
                (image_point(C, r + h * axis) - image_point(C, r - h * axis)) / (2 * h)
                for axis in np.eye(3)
            ],
            axis=1,
        )
        assert np.allclose(H, numeric, rtol=0, atol=1e-8 * np.abs(numeric).max())


def test_the_printed_jacobian_lacks_the_attitude():
    """Thesis (4.39) as printed is (3.14) without C_CN: right for a camera that looks north only."""
    H = np.empty((2, 3))
    C, r, (X, Y, Z) = next(scenes())
    jacobian(C, *project(C, r, NEAREST), H)
    printed = np.array([[-Y / X, 1.0, 0.0], [-Z / X, 0.0, 1.0]]) / X
    assert np.allclose(H, printed @ C, rtol=1e-12)
    assert np.abs(H - printed).max() > 0.1 * np.abs(H).max()


def test_pixel_variance_adds_a_constant_and_a_part_that_falls_with_depth():
    assert pixel_variance(10.0, 2.0, 0.0) == pytest.approx(0.04, rel=1e-15)
    assert pixel_variance(20.0, 2.0, 0.0) == pytest.approx(0.01, rel=1e-15)
    assert pixel_variance(20.0, 0.0, 0.3) == pytest.approx(0.09, rel=1e-15)
    assert pixel_variance(10.0, 2.0, 0.3) == pytest.approx(0.13, rel=1e-15)
