"""The camera that looks down: what is in its picture, how wrong places are, false detections."""

import math

import numpy as np
import pytest
from scipy import stats
from scipy.spatial.transform import Rotation

from visenvs.sensors.ground_camera import (
    FALSE,
    HEIGHT,
    NOTHING,
    TOP,
    WIDTH,
    in_view,
    look,
    mount,
    pixel_size,
    stretch,
)

pytestmark = pytest.mark.kernel


def settings(fov=90.0, sigma_pixel=2.0, p_detect=1.0, false_detections=0.0):
    # not in the order of other tests: to Numba a record may be a part of one that begins alike
    names = ("false_detections", "p_detect", "sigma_pixel", "fov")
    out = np.zeros((), [(name, "f8") for name in names])
    for name, value in zip(
        names, (false_detections, p_detect, sigma_pixel, math.radians(fov)), strict=True
    ):
        out[name] = value
    return out[()]


def pose(north=0.0, east=0.0, height=3.0, heading=0.0, pitch=0.0, roll=0.0):
    out = np.zeros((4, 3))
    out[0] = north, east, -height
    C_BN = Rotation.from_euler("ZYX", [heading, pitch, roll]).as_matrix().T
    mount(np.ascontiguousarray(C_BN), out)
    return out


TILTED = {"north": 1.0, "east": -2.0, "heading": 0.4, "pitch": -0.28, "roll": 0.17}


def pixels(where, places, cfg):
    """Columns and rows from the middle of the picture, as of a pinhole, pixels."""
    r = np.insert(np.asarray(places) - where[0, :2], 2, -where[0, 2] - TOP, axis=1) @ where[1:].T
    assert (r[:, 0] > 0.0).all()
    return r[:, 1:] / r[:, :1] * 0.5 * WIDTH / math.tan(0.5 * cfg["fov"])


def pictures(r, where, cfg, count=400, seed=3):
    r, active = np.array(r, float), np.ones(len(r))
    seen, labels = np.zeros((len(r) + FALSE, 2)), np.zeros(len(r) + FALSE)
    out = []
    for step in range(count):
        n = look(where, r, active, cfg, seed, 0, step, 5, seen, labels)
        out.append((seen[:n].copy(), labels[:n].copy()))
    return out


def test_ninety_degrees_see_as_far_to_the_side_as_the_camera_is_above_the_plates():
    cfg, reach = settings(), 3.0 - TOP
    assert in_view(pose(), 0.0, 0.999 * reach, 0.0, cfg)
    assert not in_view(pose(), 0.0, 1.001 * reach, 0.0, cfg)
    assert in_view(pose(), 0.749 * reach, 0.0, 0.0, cfg)
    assert not in_view(pose(), 0.751 * reach, 0.0, 0.0, cfg)
    assert not in_view(pose(), 0.0, reach - 0.1, 0.2, cfg)


def test_the_picture_turns_with_the_aircraft():
    turned = pose(heading=math.pi / 2)
    assert in_view(turned, 2.5, 0.0, 0.0, settings())
    assert not in_view(turned, 0.0, 2.5, 0.0, settings())


def test_on_the_ground_nothing_is_seen():
    assert not pictures([[0.0, 0.0]], pose(height=0.05), settings(false_detections=2.0), 1)[0][
        0
    ].size


def test_places_are_wrong_by_the_pixel_noise():
    cfg = settings()
    found = np.vstack([seen for seen, _ in pictures([[1.0, 0.5]], pose(), cfg)])
    error = (found - [1.0, 0.5]) / (2.0 * pixel_size(pose(), cfg))
    assert stats.kstest(error.ravel(), "norm").pvalue > 1e-3
    assert pixel_size(pose(), cfg) == pytest.approx(2.9 / 160.0)


def test_so_many_are_found_as_p_detect_says():
    n = sum(len(labels) for _, labels in pictures([[0, 0], [1, 1]], pose(), settings(p_detect=0.7)))
    assert stats.binomtest(n, 800, 0.7).pvalue > 1e-3


def test_false_detections_lie_anywhere_in_the_picture():
    cfg = settings(false_detections=0.6)
    found = pictures(np.zeros((0, 2)), pose(2.0, -1.0, heading=0.3), cfg)
    places = np.vstack([seen for seen, _ in found])
    assert stats.poisson(0.6 * 400).interval(0.999)[0] < len(places)
    assert len(places) < stats.poisson(0.6 * 400).interval(0.999)[1]
    assert all((labels == NOTHING).all() for _, labels in found)
    assert all(in_view(pose(2.0, -1.0, heading=0.3), n, e, 0.0, cfg) for n, e in places)
    c, s = math.cos(0.3), math.sin(0.3)
    right = (places - [2.0, -1.0]) @ [-s, c]
    assert stats.kstest(right / 2.9, "uniform", args=(-1, 2)).pvalue > 1e-3


def test_a_robot_more_changes_nothing_for_the_others():
    one = pictures([[0.5, 0.5]], pose(), settings(p_detect=0.8, false_detections=0.5), 50)
    two = pictures(
        [[0.5, 0.5], [9.0, 9.0]], pose(), settings(p_detect=0.8, false_detections=0.5), 50
    )
    for (seen, labels), (again, others) in zip(one, two, strict=True):
        assert np.array_equal(seen, again) and np.array_equal(labels, others)


def test_robots_that_are_not_there_are_not_found():
    seen, labels = np.zeros((1 + FALSE, 2)), np.zeros(1 + FALSE)
    assert look(pose(), np.zeros((1, 2)), np.zeros(1), settings(), 0, 0, 0, 0, seen, labels) == 0


# a camera that tilts


def test_what_a_tilted_camera_sees_is_in_its_picture():
    cfg, where, rng = settings(fov=70.0), pose(**TILTED), np.random.default_rng(0)
    places = where[0, :2] + rng.uniform(-4.0, 4.0, (400, 2))
    inside = np.all(np.abs(pixels(where, places, cfg)) < (0.5 * WIDTH, 0.5 * HEIGHT), axis=1)
    assert [in_view(where, *place, 0.0, cfg) for place in places] == inside.tolist()
    assert 40 < inside.sum() < 300


@pytest.mark.parametrize("pitch, seen", [(0.0, True), (-0.1, True), (0.1, False)])
def test_a_robot_at_the_edge_is_lost_by_tilt(pitch, seen):
    """Nose down it is seen farther back, nose up farther ahead."""
    cfg, back = settings(), -0.74 * (3.0 - TOP)
    assert in_view(pose(pitch=pitch), back, 0.0, 0.0, cfg) == seen
    assert in_view(pose(pitch=-pitch), -back, 0.0, 0.0, cfg) == seen


def test_the_noise_is_of_pixels_whatever_the_tilt():
    cfg, where, place = settings(), pose(**TILTED), np.array([-1.2, -4.0])
    found = np.vstack([seen for seen, _ in pictures([place], where, cfg)])
    noise = (pixels(where, found, cfg) - pixels(where, [place], cfg)) / cfg["sigma_pixel"]
    assert stats.kstest(noise.ravel(), "norm").pvalue > 1e-3
    area = np.linalg.det(np.cov((found - place).T)) ** 0.25  # mean of both deviations
    assumed = cfg["sigma_pixel"] * pixel_size(where, cfg) * stretch(where, *place)
    assert area == pytest.approx(assumed, rel=0.1)
    assert stretch(where, *place) > 1.4
    assert stretch(pose(), *place) == 1.0


def test_false_detections_fill_a_tilted_picture():
    cfg, where = settings(false_detections=0.6), pose(**TILTED)
    places = np.vstack([seen for seen, _ in pictures(np.zeros((0, 2)), where, cfg)])
    column, row = pixels(where, places, cfg).T
    assert stats.kstest(column / WIDTH, "uniform", args=(-0.5, 1.0)).pvalue > 1e-3
    assert stats.kstest(row / HEIGHT, "uniform", args=(-0.5, 1.0)).pvalue > 1e-3


def test_nothing_is_found_beyond_the_horizon():
    """Some of three false detections a picture would lie in the sky."""
    cfg, where = settings(false_detections=3.0), pose(pitch=1.2)
    places = np.vstack([seen for seen, _ in pictures(np.zeros((0, 2)), where, cfg, 40)])
    assert 40 < len(places) < 3 * 40
    assert (places[:, 0] > 0.0).all() and np.hypot(*places.T).max() < 2.9 / 0.03
    assert in_view(where, 8.0, 0.0, 0.0, cfg) and not in_view(where, -8.0, 0.0, 0.0, cfg)
