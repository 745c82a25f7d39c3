"""A coloured aircraft is measured; what does not stand out is not registered."""

import math

import numpy as np
import pytest

from visenvs.sensors.images.aircraft import SPAN, WING_TIPS, draw_aircraft
from visenvs.sensors.images.exposure import Exposure, expose
from visenvs.sensors.images.leader import detect
from visenvs.sensors.images.optics import Optics
from visenvs.sensors.images.outdoor import Outdoor
from visenvs.sensors.images.prior import Prior
from visenvs.sensors.images.scenes import attitude

OPTICS = Optics(320, 240, 440.0)
DEPTH, POINT = 28.0, (0.1, -0.06)
PRIOR = Prior((0.104, -0.063), (0.006, 0.006), 0.5 * SPAN / DEPTH)


@pytest.fixture(scope="module")
def world():
    return Outdoor(2)


def picture(world, colour, roll=0.4):
    frame = world.render(OPTICS, np.eye(3), np.array([0.0, 0.0, -40.0]))
    r, C_BN = DEPTH * np.array([1.0, *POINT]), attitude(0.1, -0.05, roll)
    if colour:
        draw_aircraft(frame, OPTICS, np.eye(3), r, C_BN, colour)
    tips, _ = OPTICS.project(np.eye(3), WING_TIPS @ C_BN + r)
    return expose(frame, Exposure(), 1, 0, 0, 0), tips


@pytest.mark.parametrize("segmenter", ["threshold", "chan_vese"])
@pytest.mark.parametrize("roll", [-0.6, 0.0, 0.5])
@pytest.mark.parametrize("prior", [PRIOR, None])
def test_centre_and_tips_of_a_red_aircraft(world, segmenter, roll, prior):
    if segmenter == "chan_vese":
        pytest.importorskip("skimage", reason="the extra `vision` is not installed")
    image, tips = picture(world, (200.0, 50.0, 40.0), roll)
    view = detect(image, OPTICS, prior, segmenter)
    assert np.hypot(*(OPTICS.pixels(view.centre) - OPTICS.pixels(POINT))) < 1.0
    assert np.hypot(*(OPTICS.pixels(view.left) - tips[0])) < 1.5
    assert np.hypot(*(OPTICS.pixels(view.right) - tips[1])) < 1.5
    span = math.hypot(*(tips[1] - tips[0])) / OPTICS.focal
    assert view.subtended == pytest.approx(span, rel=0.06)


def test_an_empty_sky_registers_nothing(world):
    image, _ = picture(world, None)
    assert detect(image, OPTICS, PRIOR) is None
    assert detect(image, OPTICS, Prior((3.0, 0.0), (0.01, 0.01), 0.05)) is None


def test_an_unknown_segmenter_is_an_error(world):
    with pytest.raises(ValueError, match='write "threshold" or "chan_vese"'):
        detect(picture(world, None)[0], OPTICS, PRIOR, "watershed")
