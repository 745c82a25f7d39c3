"""Rendered things are where geometry puts them, and pictures depend on their names alone."""

import math

import numpy as np
import pytest

from visenvs.sensors.images.aircraft import WING_TIPS, draw_aircraft, fill_triangles
from visenvs.sensors.images.arena import Arena, half_plane, shared_arena
from visenvs.sensors.images.exposure import Exposure, expose
from visenvs.sensors.images.optics import Optics
from visenvs.sensors.images.outdoor import Outdoor, Sky
from visenvs.sensors.images.robots import GREEN, RED, ROBOT
from visenvs.sensors.images.scenes import attitude
from visenvs.sensors.images.textures import fractal, periodic

pytestmark = pytest.mark.kernel

OPTICS = Optics(160, 120, 140.0)
NONE = np.zeros(0, ROBOT)
PLAIN = Exposure(blur=0.0, noise=0.0, gain_error=0.0)


@pytest.fixture(scope="module")
def arena():
    return shared_arena(0, True)


@pytest.fixture(scope="module")
def outdoor():
    return Outdoor(1)


@pytest.mark.parametrize("down", [90.0, 60.0, 40.0])
def test_grid_lines_lie_where_they_are_projected(arena, down):
    C, r_V = attitude(0.3, math.radians(down), 0.1), np.array([-1.0, 0.5, -2.0])
    frame = arena.render(OPTICS, C, r_V, NONE)
    checked = 0
    for north in range(-3, 6):
        for east in range(-3, 4):
            on, off = (np.array([north + d, east + d, 0.0]) - r_V for d in (0.0, 0.5))
            for r, white in ((on, True), (off, False)):
                pixel, depth = OPTICS.project(C, r)
                if 0.5 < depth < 4.0 and OPTICS.shows(pixel, 3.0):
                    u, v = np.rint(pixel).astype(int)
                    assert (frame[v, u].min() > 190) == white
                    checked += 1
    assert checked > 4


def test_the_ends_are_red_in_the_south_and_green_in_the_north(arena):
    C = attitude(0.0, math.pi / 2, 0.0)
    for north, channel in ((-10.0, 0), (10.0, 1)):
        frame = arena.render(OPTICS, C, np.array([north, 0.3, -2.0]), NONE).astype(int)
        middle = frame[60, 80]
        assert middle[channel] > 1.5 * np.delete(middle, channel).max()


@pytest.mark.parametrize(("plate", "channel"), [(GREEN, 1), (RED, 0)])
def test_a_robot_stands_where_it_is(arena, plate, channel):
    robot = np.zeros(1, ROBOT)
    robot["place"], robot["heading"], robot["plate"] = (1.2, 0.4), 0.8, plate
    C, r_V = attitude(0.2, math.radians(70), 0.0), np.array([0.8, 0.2, -2.0])
    frame = arena.render(OPTICS, C, r_V, robot).astype(int)
    pixel, _ = OPTICS.project(C, np.array([1.18, 0.38, -0.092]) - r_V)
    u, v = np.rint(pixel).astype(int)
    assert frame[v, u, channel] > 1.5 * np.delete(frame[v, u], channel).max()
    assert (frame != arena.render(OPTICS, C, r_V, NONE)).any()


def test_grey_is_the_grey_of_the_colours(arena):
    C, r_V = attitude(0.0, math.pi / 2, 0.0), np.array([2.0, 1.0, -2.0])
    grey = Arena(0, False).render(OPTICS, C, r_V, NONE).astype(float)
    colours = arena.render(OPTICS, C, r_V, NONE) @ [0.299, 0.587, 0.114]
    assert np.abs(grey - colours).max() < 3.0


def test_above_the_horizon_is_no_floor():
    assert not len(half_plane(OPTICS, attitude(0.0, math.pi / 2, 0.0)))
    level = half_plane(OPTICS, attitude(0.0, 0.0, 0.0))
    assert level[:, 1].min() < 0.0
    assert level[:, 1].max() == pytest.approx(59.5 + 0.02 * 140.0)
    assert len(half_plane(OPTICS, attitude(0.0, -math.pi / 2, 0.0))) == 4


def test_the_ground_is_below_and_fades_into_haze(outdoor):
    frame = outdoor.render(OPTICS, np.eye(3), np.array([0.0, 0.0, -20.0])).astype(int)
    assert frame[100, :, 2].mean() < frame[100, :, 1].mean()  # earth
    assert frame[5, :, 2].mean() > frame[5, :, 0].mean()  # sky
    assert np.abs(frame[60].mean(axis=0) - (196, 206, 214)).max() < 25
    under = outdoor.render(OPTICS, np.eye(3), np.array([0.0, 0.0, 500.0]))
    assert under.shape == frame.shape


def test_a_ball_covers_its_share_of_the_picture(outdoor):
    C, r = np.eye(3), np.array([[60.0, 8.0, -5.0]])
    before = outdoor.render(OPTICS, C, np.zeros(3))
    after = before.copy()
    outdoor.balls(after, OPTICS, C, r, np.array([6.0]), (255.0, 0.0, 0.0))
    changed = (after != before).any(axis=2)
    rows, columns = np.nonzero(changed)
    assert changed.sum() == pytest.approx(math.pi * (6.0 / 60.0 * 140.0) ** 2, rel=0.12)
    assert columns.mean() == pytest.approx(OPTICS.pixels((8 / 60, -5 / 60))[0], abs=0.3)
    assert rows.mean() == pytest.approx(OPTICS.pixels((8 / 60, -5 / 60))[1], abs=0.3)


def test_a_ball_around_the_camera_or_behind_it_is_no_error(outdoor):
    frame = outdoor.render(OPTICS, np.eye(3), np.zeros(3))
    before = frame.copy()
    r = np.array([[1.0, 0.0, 0.0], [-20.0, 0.0, 0.0]])
    outdoor.balls(frame, OPTICS, np.eye(3), r, np.array([5.0, 5.0]), (255.0, 0.0, 0.0))
    assert np.array_equal(frame, before)


def test_wing_tips_are_where_they_are_projected(outdoor):
    frame = outdoor.render(OPTICS, np.eye(3), np.zeros(3))
    before, r = frame.copy(), np.array([8.0, 0.5, -0.3])
    C_BN = np.eye(3)
    draw_aircraft(frame, OPTICS, np.eye(3), r, C_BN, (255.0, 0.0, 0.0))
    columns = np.nonzero((frame != before).any(axis=2))[1]
    tips, _ = OPTICS.project(np.eye(3), WING_TIPS @ C_BN + r)
    assert columns.min() == pytest.approx(tips[:, 0].min(), abs=1.0)
    assert columns.max() == pytest.approx(tips[:, 0].max(), abs=1.0)


@pytest.mark.kernel
def test_the_nearer_triangle_hides_the_farther():
    far = [[0.0, 0.0, 20.0], [9.0, 0.0, 20.0], [0.0, 9.0, 20.0]]
    near = [[0.0, 0.0, 10.0], [4.0, 0.0, 10.0], [0.0, 4.0, 10.0]]
    for order in ([far, near], [near, far]):
        shine = np.array([0.5 if one is far else 1.0 for one in order], np.float32)
        buffers = [np.zeros((10, 10), np.float32) for _ in range(3)]
        fill_triangles(np.array(order), shine, *buffers)
        assert buffers[1][1, 1] == 1.0
        assert buffers[1][1, 6] == 0.5
        assert buffers[2].sum() == 55
        assert buffers[1][8, 8] == 0.0


def test_pictures_are_named_by_seed_episode_stream_and_step():
    frame = np.full((40, 60, 3), 128, np.uint8)
    names = (5, 0, 2, 7)
    one = expose(frame.copy(), Exposure(), *names)
    assert np.array_equal(one, expose(frame.copy(), Exposure(), *names))
    for other in ((6, 0, 2, 7), (5, 1, 2, 7), (5, 0, 3, 7), (5, 0, 2, 8)):
        assert not np.array_equal(one, expose(frame.copy(), Exposure(), *other))


def test_exposure_is_blur_gain_and_noise_and_saturates():
    frame = np.full((60, 80), 128, np.uint8)
    assert np.array_equal(expose(frame.copy(), PLAIN, 0, 0, 0, 0), frame)
    noisy = expose(frame.copy(), Exposure(0.0, 3.0, 0.0), 0, 0, 0, 0).astype(float)
    assert noisy.std() == pytest.approx(3.0, rel=0.1)
    assert noisy.mean() == pytest.approx(128.0, abs=0.3)
    bright = expose(np.full((60, 80), 255, np.uint8), Exposure(), 3, 0, 0, 0)
    assert bright.min() > 150
    with pytest.raises(ValueError, match="gain_error lies in"):
        Exposure(gain_error=1.5)
    with pytest.raises(ValueError, match="must be positive"):
        Sky(visibility=0.0)


def test_textures_are_seeded_and_of_the_size_that_they_promise():
    one = fractal(64, 8, 3, 0, 0)
    assert np.array_equal(one, fractal(64, 8, 3, 0, 0))
    assert not np.array_equal(one, fractal(64, 8, 3, 1, 0))
    assert one.std() == pytest.approx(1.0, abs=0.35)
    field = periodic(64, 1.5, 0, 0)
    assert 0.0 <= field.min() < field.max() <= 1.0
    seam, inside = np.abs(field[0] - field[-1]).mean(), np.abs(np.diff(field, axis=0)).mean()
    assert seam < 2.0 * inside
