"""Red balls are found where they are: whole, cut by the border, before one another, and none."""

import numpy as np
import pytest

from visenvs.sensors.images.exposure import Exposure, expose
from visenvs.sensors.images.optics import Optics
from visenvs.sensors.images.outdoor import Outdoor
from visenvs.sensors.images.prior import Prior
from visenvs.sensors.images.spheres import detect, fit_circle, solve

OPTICS = Optics(320, 240, 277.0)
WIDE = Optics(256, 256, 128.0)
RED, RADIUS = (200.0, 30.0, 30.0), 6.0

pytestmark = pytest.mark.kernel


@pytest.fixture(scope="module")
def world():
    return Outdoor(2)


def picture(world, optics, places, seed=0, radius=RADIUS):
    frame = world.render(optics, np.eye(3), np.array([0.0, 0.0, -20.0]))
    r = np.array(places, float).reshape(-1, 3)
    world.balls(frame, optics, np.eye(3), r, np.full(len(r), radius), RED)
    return expose(frame, Exposure(), seed, 0, 0, 0)


def off(ball, place, optics):
    return np.hypot(*(np.array(ball.point) - np.array(place[1:]) / place[0])) * optics.focal


@pytest.mark.parametrize("depth", [35.0, 120.0, 600.0])
@pytest.mark.parametrize("optics", [OPTICS, WIDE])
def test_a_whole_ball(world, optics, depth):
    place = (depth, 0.2 * depth, -0.15 * depth)
    size = np.arcsin(RADIUS / np.linalg.norm(place))
    if size * optics.focal < 2.0:
        pytest.skip("smaller than the detector promises")
    (ball,) = detect(picture(world, optics, place), optics)
    assert off(ball, place, optics) < 0.5
    assert ball.angle == pytest.approx(size, rel=0.08)
    assert ball.depth(RADIUS) == pytest.approx(depth, rel=0.08)


def test_a_ball_that_the_border_cuts(world):
    place = (30.0, 15.0, -8.0)
    (ball,) = detect(picture(world, OPTICS, place), OPTICS)
    assert off(ball, place, OPTICS) < 2.0
    assert not ball.whole


def test_two_balls_one_partly_before_the_other(world):
    near, far = (40.0, 0.0, 0.0), (70.0, 12.0, 3.0)
    found = detect(picture(world, OPTICS, [near, far]), OPTICS)
    assert len(found) == 2
    assert off(found[0], near, OPTICS) < 1.0
    assert off(found[1], far, OPTICS) < 2.0


def test_nothing_red_is_nothing(world):
    assert detect(picture(world, OPTICS, []), OPTICS) == []


def test_only_the_search_region_is_searched(world):
    places = [(60.0, 10.0, 0.0), (60.0, -20.0, 5.0)]
    image = picture(world, OPTICS, places)
    (ball,) = detect(image, OPTICS, Prior((10 / 60, 0.0), (0.01, 0.01), 0.1))
    assert off(ball, places[0], OPTICS) < 0.5
    assert detect(image, OPTICS, Prior((2.0, 0.0), (0.01, 0.01), 0.1)) == []


def test_a_circle_is_found_among_points_of_another():
    turns = np.linspace(0.0, 2 * np.pi, 60, endpoint=False)
    circle = np.stack([0.2 + 0.1 * np.cos(turns), 0.1 * np.sin(turns)], axis=1)
    arc = np.stack([0.33 + 0.04 * np.cos(turns[:20]), 0.04 * np.sin(turns[:20])], axis=1)
    points = np.concatenate([circle, arc])
    rays = np.concatenate([np.ones((80, 1)), points], axis=1)
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    normal = np.empty(3)
    assert fit_circle(rays, np.ones(80, np.uint8), 3e-3, normal) >= 55
    centre = normal / np.linalg.norm(normal)
    assert centre[1] / centre[0] == pytest.approx(0.2, abs=0.01)
    assert centre[2] / centre[0] == pytest.approx(0.0, abs=0.005)


def test_three_equations():
    A, b, x = np.array([[2.0, 1, 0], [1, 3, -1], [0, 2, 1]]), np.array([1.0, -2, 3]), np.empty(3)
    assert solve(A, b, x)
    assert A @ x == pytest.approx(b)
    assert not solve(np.ones((3, 3)), b, x)
