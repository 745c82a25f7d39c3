"""What the cases of image processing count, and that their filters beside the filter are right."""

from __future__ import annotations

import math

import numpy as np
import pytest

from eval.cases import leader, ncc, vio
from eval.cases._flights import fly
from eval.cases.iarc_fig3 import whole_robots
from visenvs.sensors.images.scenes import NADIR, OPTICS, draw_scene


def test_flips_are_no_errors_of_the_others():
    middle, flips = ncc.heading_rows("at", np.array([0.1, 0.2, 0.3, 3.0]), None, None)
    assert middle.ours == pytest.approx(math.degrees(0.2)) and middle.n == 3
    assert flips.ours == 0.25 and flips.n == 4


def test_robots_that_the_border_cuts_are_not_whole():
    for seed in range(900_000, 900_005):
        pixels, sizes, whole = whole_robots(draw_scene(seed, NADIR, 4))
        edge = np.minimum(pixels, (OPTICS.width - 1, OPTICS.height - 1) - pixels).min(axis=1)
        assert np.array_equal(whole, edge >= 0.42 * sizes)


def test_a_few_scenes_hold_the_bands_of_template_matching():
    rows = ncc.rows(6)
    assert len([row for row in rows if row.ok]) == 16
    assert all(row.ok is not False for row in rows)


def test_the_contour_sees_the_same_pictures_as_the_threshold(monkeypatch):
    pytest.importorskip("skimage")
    found = {row.id: row.ours for row in leader.rows(3)}
    of = [name for name in found if "/red/" in name and name.endswith("registered")]
    assert [found[name.replace("/red/", "/red-chan-vese/")] for name in of] == [
        found[name] for name in of
    ]
    monkeypatch.setattr(leader, "find_spec", lambda name: None)
    assert not any("chan-vese" in row.id for row in leader.rows(1))


def test_in_double_precision_the_textbooks_covariance_is_that_of_the_factors():
    """So that what single precision does to it is not a mistake of ours."""
    beside, single = vio.Textbook(np.float64), vio.Textbook()
    for textbook in (beside, single):
        fly(0, 1.5, vio.RATE, "nadir", steps=textbook)
    assert beside.gap < 1e-9 and beside.broken == 0
    assert 1e-9 < single.gap < 0.1
