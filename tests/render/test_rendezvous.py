from __future__ import annotations

import math

import numpy as np
import pytest

from visenvs.core.config import override
from visenvs.core.lanes import Lanes
from visenvs.core.registry import load_task
from visenvs.render import rendezvous
from visenvs.render.rendezvous import draw
from visenvs.render.scene import figures, predicted_point
from visenvs.render.style import GREEN, MIDDLE_BLUE, PALE_BLUE, VERMILLION, WHITE

TASK = load_task("visenvs/Rendezvous-v0")
CONFIG = TASK.scenarios["random"]
SIZE = (540, 960, 3)


def episode(seed=7, config=CONFIG, steps=None):
    """Records of a flight with random commands, from the start on."""
    lanes, rng = Lanes(TASK, config, 1), np.random.default_rng(seed)
    lanes.reset([seed])
    records = [lanes.snapshot()]
    while not lanes.done[0] and (steps is None or len(records) <= steps):
        lanes.step(rng.uniform(-1.0, 1.0, (1, 3)).astype(np.float32))
        records.append(lanes.snapshot())
    return np.concatenate(records)


def shows(frame, colour, box=None):
    left, top, width, height = box or (0, 0, 960, 540)
    return (frame[top : top + height, left : left + width] == colour).all(axis=2)


def middle(mask):
    rows, columns = np.nonzero(mask)
    return np.array([columns.mean() + 0.5, rows.mean() + 0.5])


@pytest.mark.parametrize("scenario", TASK.scenarios)
@pytest.mark.parametrize("estimator", ["ekf", "truth"])
def test_every_step_of_an_episode_is_drawn(scenario, estimator):
    config = override(TASK.scenarios[scenario], {"estimator": estimator})
    records = episode(3, config)
    for k in range(0, len(records), 20):
        frame = draw(records[k], config, TASK, records[:k])
        assert frame.shape == SIZE and frame.dtype == np.uint8


def test_any_record_is_drawn_and_left_as_it_was():
    rng = np.random.default_rng(0)
    for record in episode(1)[rng.integers(0, 200, 60)]:
        size = 10.0 ** rng.uniform(-6.0, 9.0)
        root = rng.normal(size=(3, 3)) * size
        record["P"] = root @ root.T
        record["rhat_TV_N"] = rng.normal(size=3) * 10.0 ** rng.uniform(-3.0, 6.0)
        record["v_V_N"] = rng.normal(size=3) * 10.0 ** rng.uniform(-9.0, 4.0)
        record["r_V_N"] *= 10.0 ** rng.uniform(0.0, 4.0)
        record["C_CN"] = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        record["pixel"] = rng.normal(size=2) * 10.0 ** rng.uniform(-3.0, 6.0)
        before = record.tobytes()
        assert draw(record, CONFIG, TASK).shape == SIZE
        assert record.tobytes() == before


@pytest.mark.parametrize("number", [math.nan, math.inf, -math.inf, 1e300])
def test_the_last_record_of_a_diverged_lane_is_drawn(number):
    record = episode(steps=3)[-1]
    for name in TASK.lane.names or ():
        if name not in ("seed", "episode", "step", "outcome", "r_T_N"):
            record[name] = number
    record["outcome"] = 6
    assert draw(record, CONFIG, TASK).shape == SIZE


def test_a_target_at_the_start_is_drawn():
    record = episode(steps=0)[0]
    record["r_T_N"] = record["r_TV_N"] = record["rhat_TV_N"] = record["v_V_N"] = 0.0
    assert draw(record, CONFIG, TASK).shape == SIZE


def test_a_frame_follows_from_the_record_alone():
    records, others = episode(7), episode(8)
    first = draw(records[90], CONFIG, TASK)
    draw(others[40], CONFIG, TASK, others[:40])
    np.testing.assert_array_equal(draw(records[90], CONFIG, TASK), first)
    np.testing.assert_array_equal(draw(records[90].copy(), CONFIG, TASK), first)
    assert (draw(records[91], CONFIG, TASK) != first).any()


def test_the_trail_adds_the_path_flown_and_nothing_else():
    records = episode(7)
    without, trail = draw(records[90], CONFIG, TASK), draw(records[90], CONFIG, TASK, records[:90])
    assert (without != trail).any()
    np.testing.assert_array_equal(without[:, 760:], trail[:, 760:])


def test_the_window_holds_start_target_and_first_estimate_at_one_scale():
    config = override(CONFIG, {"range_error": 0.33, "azimuth_drawn": math.pi})
    lanes, image = Lanes(TASK, config, 200), np.zeros(SIZE, np.uint8)
    lanes.reset(np.arange(200))
    for record in lanes.records:
        along = rendezvous.bearing(record["r_T_N"])
        top, side = rendezvous.windows(image, record, config, TASK, along)
        assert top.scale == side.scale
        for point in (np.zeros(3), record["r_T_N"], record["rhat_TV_N"]):
            assert top.shows(rendezvous.EAST_NORTH @ point)
            assert side.shows(along @ point)


def test_the_window_stays_throughout_an_episode():
    records, image = episode(2), np.zeros(SIZE, np.uint8)
    along = rendezvous.bearing(records[0]["r_T_N"])
    windows = set()
    for record in records:
        panels = rendezvous.windows(image, record, CONFIG, TASK, along)
        windows.add(tuple((panel.centre, panel.scale) for panel in panels))
    assert len(windows) == 1


def test_the_ellipses_are_those_of_one_and_three_sigma():
    record, image = episode(steps=0)[0], np.zeros(SIZE, np.uint8)
    along = rendezvous.bearing(record["r_T_N"])
    panels = rendezvous.windows(image, record, CONFIG, TASK, along)
    record["P"] = 8 * np.array([[9.0, 4.0, 2.0], [4.0, 8.0, 1.0], [2.0, 1.0, 7.0]])
    record["rhat_TV_N"] = record["r_T_N"] / 2 + 1e4
    record["r_V_N"] = -1e4  # out of sight
    frame = draw(record, CONFIG, TASK)
    angle = np.linspace(0.0, 2.0 * math.pi, 48, endpoint=False)
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    for panel, rows in zip(panels, (rendezvous.EAST_NORTH, along), strict=True):
        root = np.linalg.cholesky(rows @ record["P"] @ rows.T)
        view = frame[panel.top : panel.top + panel.height, panel.left : panel.left + panel.width]
        for sigmas, colour in (
            (0.8, MIDDLE_BLUE),
            (1.2, PALE_BLUE),
            (2.8, PALE_BLUE),
            (3.2, WHITE),
        ):
            points = rows @ record["r_T_N"] / 2 + sigmas * circle @ root.T
            x, y = panel.pixels(points).astype(int).T
            assert np.mean((view[y, x] == colour).all(axis=1)) > 0.7  # the rest lie on grid lines


def test_the_side_view_runs_along_the_bearing_of_the_target():
    rows = rendezvous.bearing(np.array([3.0, 4.0, -7.0]))
    np.testing.assert_allclose(rows @ [3.0, 4.0, -7.0], [5.0, 7.0])


def test_the_target_is_drawn_where_it_is():
    record = episode(steps=0)[0]
    record["r_V_N"] = record["rhat_TV_N"] = -1e4  # everything else away
    record["seen"] = 1.0
    image = np.zeros(SIZE, np.uint8)
    along = rendezvous.bearing(record["r_T_N"])
    panels = rendezvous.windows(image, record, CONFIG, TASK, along)
    frame = draw(record, CONFIG, TASK)
    for panel, rows in zip(panels, (rendezvous.EAST_NORTH, along), strict=True):
        mask = shows(frame, VERMILLION, (panel.left, panel.top, panel.width, panel.height))
        np.testing.assert_allclose(middle(mask), panel.pixels(rows @ record["r_T_N"]), atol=1.0)


def test_the_expected_image_point_is_the_projection_and_its_covariance():
    record = episode(11, steps=25)[-1]
    root = np.random.default_rng(1).normal(size=(3, 3))
    record["P"] = root @ root.T

    def project(r):
        X, Y, Z = record["C_CN"] @ r
        return np.array([Y / X, -Z / X])

    rhat, h = record["rhat_TV_N"], 1e-6
    H = np.column_stack([(project(rhat + e) - project(rhat - e)) / (2 * h) for e in h * np.eye(3)])
    point, spread = predicted_point(record["C_CN"], rhat, record["P"], CONFIG.min_range)
    np.testing.assert_allclose(point, project(rhat), atol=1e-12)
    np.testing.assert_allclose(spread, H @ record["P"] @ H.T, rtol=1e-6)


def test_the_measured_image_point_is_drawn_where_it_is():
    record = episode(steps=0)[0]
    record["seen"] = 1.0
    frames = []
    for pixel in ((0.6, 0.25), (-0.4, -0.7)):
        record["pixel"] = pixel
        frames.append(draw(record, CONFIG, TASK))
    left, top, width, height = rendezvous.CAMERA
    changed = (frames[0] != frames[1]).any(axis=2)[top : top + height, left : left + width]
    right = changed & (np.arange(width) > width / 2)
    for mask, (y, z) in ((right, (0.6, 0.25)), (changed & ~right, (-0.4, -0.7))):
        expected = width / 2 * np.array([1.0 + y, 1.0 + z])  # right and down, half width 1
        np.testing.assert_allclose(middle(mask), expected, atol=1.0)


def test_an_estimate_behind_the_camera_is_not_in_its_picture():
    record = episode(steps=0)[0]
    record["P"] = 4.0 * np.eye(3)
    ahead = draw(record, CONFIG, TASK)
    record["rhat_TV_N"] *= -1.0
    behind = draw(record, CONFIG, TASK)
    for colour in (PALE_BLUE, MIDDLE_BLUE):
        assert shows(ahead, colour, rendezvous.CAMERA).any()
        assert not shows(behind, colour, rendezvous.CAMERA).any()


def test_no_covariance_no_ellipse():
    record = episode(steps=5)[-1]
    record["P"] = 4.0 * np.eye(3)
    frame = draw(record, CONFIG, TASK)
    ellipses = [shows(frame, c, (0, 60, 960, 480)).any() for c in (PALE_BLUE, MIDDLE_BLUE)]
    assert ellipses == [True, True]
    record["P"] = 0.0
    frame = draw(record, CONFIG, TASK)
    ellipses = [shows(frame, c, (0, 60, 960, 480)).any() for c in (PALE_BLUE, MIDDLE_BLUE)]
    assert ellipses == [False, False]


def test_a_missed_detection_is_seen_at_the_border_of_the_camera_picture():
    record = episode(steps=5)[-1]
    left, top, width, _ = rendezvous.CAMERA
    for seen in (0.0, 1.0):
        record["seen"] = seen
        edge = draw(record, CONFIG, TASK)[top, left + 1 : left + width - 1]
        assert (edge == VERMILLION).all() == (seen == 0.0)


@pytest.mark.parametrize(("half_width", "half_angle"), [(1.0, 45.0), (0.5, 26.565), (1e9, 90.0)])
def test_the_field_of_view_opens_by_its_half_width(half_width, half_angle):
    config = override(CONFIG, {"half_width": half_width})
    record, image = episode(steps=0)[0], np.zeros(SIZE, np.uint8)
    record["C_CN"] = np.eye(3)
    along = rendezvous.bearing(record["r_T_N"])
    top, _ = rendezvous.windows(image, record, config, TASK, along)
    outline = rendezvous.field_of_view(top, rendezvous.EAST_NORTH, record, config)
    east, north = (outline[1:] - outline[0]).T
    angles = np.degrees(np.arctan2(east, north))
    assert angles.max() == pytest.approx(half_angle, abs=0.01)
    assert angles.min() == pytest.approx(-half_angle, abs=0.01)


@pytest.mark.parametrize(("outcome", "colour"), [(0, None), (1, GREEN), (2, VERMILLION)])
def test_how_the_episode_ended_is_shown(outcome, colour):
    record = episode(steps=5)[-1]
    record["outcome"] = outcome
    frame = draw(record, CONFIG, TASK)
    for shade in (GREEN, VERMILLION):
        assert (shows(frame, shade, rendezvous.STATUS).sum() > 2000) == (shade == colour)


@pytest.mark.parametrize(
    ("value", "text"),
    [(0.0, "0.00"), (3.14159, "3.14"), (12.345, "12.3"), (15012.3, "15,012"), (3e7, "3.00e+07")],
)
def test_figures_are_short(value, text):
    assert figures(value) == text
    assert figures(math.nan) == "?"
