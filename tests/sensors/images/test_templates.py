"""Robots are matched near their prediction with their heading; corners stay where they are."""

import math

import numpy as np
import pytest

from visenvs.sensors.images import corners, templates
from visenvs.sensors.images.scenes import NADIR, OPTICS, TILTED, draw_scene


@pytest.mark.parametrize("down", [NADIR, TILTED])
def test_a_robot_is_matched_where_it_is(down):
    off, turned, missed = [], [], 0
    for k in range(6):
        scene = draw_scene(500 + k, down, 3)
        pixels, sizes = scene.tops()
        for robot, pixel, size in zip(scene.robots, pixels, sizes, strict=True):
            if not OPTICS.shows(pixel, 0.5 * size):
                continue
            headings = robot["heading"] + 0.3 * np.array([-1.0, 0.0, 1.0])
            place = robot["place"] + (0.03, -0.02)
            camera = (scene.image, OPTICS, scene.C, scene.r_V_N)
            match = templates.detect(*camera, place, headings, int(robot["plate"]))
            missed += match is None
            if match is not None:
                off.append(math.hypot(*(np.array(match.pixel) - pixel)))
                turned.append(abs(match.heading - headings[1]) < 0.15)
    assert len(off) > 5 * missed
    assert np.median(off) < 0.7
    assert np.mean(turned) > 0.8


def test_an_empty_floor_registers_nothing():
    scene = draw_scene(5, NADIR, 0, clutter=0)
    camera = (scene.image, OPTICS, scene.C, scene.r_V_N)
    assert templates.detect(*camera, scene.r_V_N[:2], [0.0], 0) is None
    assert templates.detect(*camera, scene.r_V_N[:2] + 50.0, [0.0], 0) is None


def test_a_corner_is_found_again_by_its_patch():
    image = np.full((120, 160), 60, np.uint8)
    for x, y in ((30, 30), (100, 40), (60, 90)):
        image[y : y + 20, x : x + 20] = 200
    pixels, patches = corners.detect(image)
    assert len(pixels) >= 12
    assert min(np.hypot(*(pixels - (29.5, 29.5)).T)) < 0.3
    shifted, others = corners.detect(np.roll(image, (4, 7), axis=(0, 1)))
    i = int(np.argmin(np.hypot(*(pixels - (29.5, 29.5)).T)))
    alike = others @ patches[i]
    near = np.hypot(*(shifted - pixels[i] - (7, 4)).T)
    assert alike[int(np.argmin(near))] > 0.99
    assert corners.detect(np.full((60, 60), 90, np.uint8))[0].shape == (0, 2)
