"""Pixels, image points and positions belong together; a prediction leaves a region to search."""

import numpy as np
import pytest

from visenvs.sensors.images.optics import Optics
from visenvs.sensors.images.prior import Prior, search_region, whole

OPTICS = Optics(320, 240, 277.0)


def test_a_position_is_projected_where_its_image_point_lies():
    r = np.array([[10.0, 2.0, -1.0]])
    pixels, depth = OPTICS.project(np.eye(3), r)
    assert pixels[0] == pytest.approx([159.5 + 277 * 0.2, 119.5 - 277 * 0.1])
    assert OPTICS.points(pixels)[0] == pytest.approx([0.2, -0.1])
    assert depth[0] == 10.0
    assert np.isnan(OPTICS.project(np.eye(3), -r)[0]).all()


def test_a_picture_needs_pixels():
    with pytest.raises(ValueError, match=r"write `Optics\(320, 240, 277.0\)`"):
        Optics(4, 240, 277.0)


def test_a_region_holds_the_prediction_and_its_uncertainty():
    region = search_region(OPTICS, Prior((0.1, 0.0), (0.01, 0.02), 0.05), margin=0.0)
    u, half = 159.5 + 27.7, 277 * (3 * 0.01 + 0.05)
    assert region.left <= u - half < region.left + 1
    assert region.right - 2 < u + half <= region.right
    assert region.height > region.width


def test_what_says_little_is_sought_everywhere_and_what_is_out_of_view_nowhere():
    assert search_region(OPTICS, None) == whole(OPTICS)
    assert search_region(OPTICS, Prior((0.0, 0.0), (1.0, 1.0), 0.1)) == whole(OPTICS)
    assert search_region(OPTICS, Prior((0.0, 0.0), (np.nan, 1.0), 0.1)) == whole(OPTICS)
    assert search_region(OPTICS, Prior((3.0, 0.0), (0.01, 0.01), 0.1)) is None
