from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from visenvs.render.canvas import FAR, NOTHING, Panel, ellipse_points, nice_step
from visenvs.render.style import BLUE, VERMILLION, WHITE, paint, write

COVARIANCE = np.array([[5.0, 2.0], [2.0, 3.0]])


@pytest.fixture
def panel() -> Panel:
    """Ten pixels a metre, (3, -1) in the middle, amid a larger white picture."""
    image = np.full((200, 300, 3), 255, np.uint8)
    return Panel(image, 40, 30, 200, 120, (3.0, -1.0), 10.0)


def painted(panel: Panel, colour: tuple[int, int, int]) -> np.ndarray:
    return (panel.view == colour).all(axis=2)


def middle(mask: np.ndarray) -> np.ndarray:
    rows, columns = np.nonzero(mask)
    return np.array([columns.mean() + 0.5, rows.mean() + 0.5])


@given(
    a=st.floats(0.1, 30.0),
    b=st.floats(0.1, 30.0),
    turn=st.floats(-math.pi, math.pi),
    sigmas=st.sampled_from([1.0, 3.0]),
)
def test_ellipse_points_satisfy_the_quadratic_form(a, b, turn, sigmas):
    axes = np.array([[math.cos(turn), -math.sin(turn)], [math.sin(turn), math.cos(turn)]])
    covariance = axes @ np.diag([a * a, b * b]) @ axes.T
    offset = ellipse_points((7.0, -4.0), covariance, sigmas) - (7.0, -4.0)
    distance = np.einsum("ni,ij,nj->n", offset, np.linalg.inv(covariance), offset)
    np.testing.assert_allclose(distance, sigmas**2, rtol=1e-6)


def test_ellipse_axes_are_those_of_the_eigen_decomposition():
    values, axes = np.linalg.eigh(COVARIANCE)
    points = ellipse_points((0.0, 0.0), COVARIANCE, 3.0)
    np.testing.assert_allclose((points @ axes).max(axis=0), 3.0 * np.sqrt(values), rtol=2e-3)


def test_a_singular_covariance_gives_a_flat_ellipse():
    points = ellipse_points((1.0, 2.0), [[4.0, 0.0], [0.0, 0.0]], 1.0)
    assert np.ptp(points[:, 0]) == pytest.approx(4.0)
    assert (points[:, 1] == 2.0).all()


def test_a_cut_ellipse_keeps_its_direction():
    points = ellipse_points((0.0, 0.0), [[1e12, 1e12], [1e12, 1e12]], 1.0, longest=50.0)
    np.testing.assert_allclose(points[:, 0], points[:, 1], atol=1e-3)
    assert np.hypot(*points.T).max() == pytest.approx(50.0)


def test_a_filled_ellipse_has_its_area_in_pixels(panel):
    panel.fill(panel.ellipse((3.0, -1.0), COVARIANCE, 2.5), BLUE)
    area = math.pi * math.sqrt(np.linalg.det(COVARIANCE)) * (2.5 * panel.scale) ** 2
    assert painted(panel, BLUE).sum() == pytest.approx(area, rel=0.03)


def test_an_ellipse_below_a_pixel_or_without_numbers_is_nothing(panel):
    assert panel.ellipse((0.0, 0.0), 1e-4 * np.eye(2), 3.0) is NOTHING
    assert panel.ellipse((0.0, 0.0), np.full((2, 2), np.nan), 3.0) is NOTHING


def test_right_and_up_have_one_scale(panel):
    np.testing.assert_allclose(panel.pixels((3.0, -1.0)), (100.0, 60.0))
    np.testing.assert_allclose(panel.pixels((5.0, -1.0)), (120.0, 60.0))
    np.testing.assert_allclose(panel.pixels((3.0, 1.0)), (100.0, 40.0))


@given(x=st.floats(-5.0, 11.0), y=st.floats(-5.0, 3.0))
def test_a_disc_is_drawn_at_its_point(x, y):
    panel = Panel(np.full((120, 200, 3), 255, np.uint8), 0, 0, 200, 120, (3.0, -1.0), 10.0)
    panel.disc((x, y), 6.0, VERMILLION)
    np.testing.assert_allclose(middle(painted(panel, VERMILLION)), panel.pixels((x, y)), atol=0.5)


def test_an_arrow_ends_where_the_vector_ends(panel):
    panel.arrow((0.0, -1.0), (6.0, 0.0), BLUE)
    _, columns = np.nonzero(painted(panel, BLUE))
    start, end = panel.pixels([(0.0, -1.0), (6.0, -1.0)])[:, 0]
    assert columns.min() == pytest.approx(start, abs=2)
    assert columns.max() == pytest.approx(end, abs=2)


def test_nothing_is_drawn_outside_the_rectangle(panel):
    before = panel.image.copy()
    panel.line([(-1e9, -1e9), (1e9, 1e9)], BLUE, 3)
    panel.disc((3.0, -1.0), 1e9, BLUE)
    panel.clear(VERMILLION)
    outside = np.ones(panel.image.shape[:2], bool)
    outside[30:150, 40:240] = False
    np.testing.assert_array_equal(panel.image[outside], before[outside])


@pytest.mark.parametrize("number", [math.nan, math.inf])
def test_marks_without_a_place_are_left_out(panel, number):
    before = panel.image.copy()
    at = (math.nan, 0.0)
    panel.disc(at, 5.0, BLUE)
    panel.disc((3.0, -1.0), number, BLUE)
    panel.arrow((3.0, -1.0), (number, 0.0), BLUE)
    panel.reticle(at, BLUE)
    panel.cross(at, BLUE)
    panel.pointer(at, BLUE)
    panel.dart(at, (number, 0.0), BLUE)
    panel.path(np.array([(0.0, 0.0), at]), BLUE)
    panel.fill(panel.sector(at, (1.0, 0.0), (1.0, 1.0), 50.0), BLUE)
    panel.fill(panel.sector((3.0, -1.0), (number * 0.0, 0.0), (1.0, 1.0), 50.0), BLUE)
    np.testing.assert_array_equal(panel.image, before)


def test_a_sector_opens_by_the_angle_to_its_side(panel):
    outline = panel.sector((1.0, 2.0), (0.0, 1.0), (0.5, 1.0), 40.0)
    np.testing.assert_allclose(outline[0], (1.0, 2.0))
    np.testing.assert_allclose(np.hypot(*(outline[1:] - outline[0]).T), 4.0)
    angles = np.arctan2(*(outline[1:] - outline[0]).T)  # from up, clockwise
    assert angles.min() == pytest.approx(-math.atan(0.5))
    assert angles.max() == pytest.approx(math.atan(0.5))


def test_a_pointer_shows_the_way_to_what_lies_outside(panel):
    panel.pointer((3.0, -1.0), BLUE)
    assert not painted(panel, BLUE).any()
    panel.pointer((1003.0, -1.0), BLUE)
    x, y = middle(painted(panel, BLUE))
    assert y == pytest.approx(60.0, abs=1.0)
    assert x > 180.0


def test_a_path_runs_from_its_first_to_its_last_point(panel):
    points = np.column_stack([np.linspace(-4.0, 8.3, 5000), np.full(5000, -1.0)])
    panel.path(points, BLUE)
    _, columns = np.nonzero(painted(panel, BLUE))
    start, end = panel.pixels(points[[0, -1]])[:, 0]
    assert columns.min() == pytest.approx(start, abs=2)
    assert columns.max() == pytest.approx(end, abs=2)


@given(scale=st.floats(1e-3, 1e3), x=st.floats(-1e3, 1e3), y=st.floats(-1e3, 1e3))
def test_ticks_are_round_inside_and_apart(scale, x, y):
    panel = Panel(np.zeros((1, 1, 3), np.uint8), 0, 0, 400, 300, (x, y), scale)
    across, up = panel.ticks()
    assert 3 <= len(across) <= 9
    assert np.diff(across).min() * scale >= 47.9
    step = across[1] - across[0]
    mantissa = step / 10 ** math.floor(math.log10(step) + 1e-9)
    assert round(mantissa, 6) in (1.0, 2.0, 5.0)
    slack = 1e-6 * (400 + abs(x) + abs(y) + 1 / scale)
    assert all(-slack * scale <= panel.pixels((t, y))[0] <= 400 + slack * scale for t in across)
    assert all(-slack * scale <= panel.pixels((x, t))[1] <= 300 + slack * scale for t in up)


@pytest.mark.parametrize(
    ("least", "step"), [(0.3, 0.5), (1.0, 1.0), (1.01, 2.0), (5.1, 10.0), (70.0, 100.0)]
)
def test_nice_steps_are_one_two_or_five(least, step):
    assert nice_step(least) == pytest.approx(step)


@pytest.mark.parametrize(("align", "left"), [("left", 100), ("middle", 50), ("right", 0)])
def test_text_stands_where_its_alignment_says(align, left):
    image = np.empty((40, 300, 3), np.uint8)
    paint(image, WHITE)
    write(image, "x" * 12, (100.0, 25.0), 15, align=align)
    columns = np.nonzero((image < 128).any(axis=(0, 2)))[0]
    width = np.ptp(columns)
    assert columns[0] == pytest.approx(100 - width * (100 - left) / 100, abs=3)


def test_the_far_limit_fits_the_pixel_grid():
    assert FAR * 16 < 2**31
