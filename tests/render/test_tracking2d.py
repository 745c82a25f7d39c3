"""The picture of tracking in a plane."""

from __future__ import annotations

import math

import numpy as np
import pytest

from visenvs.core.config import override
from visenvs.core.lanes import Lanes
from visenvs.core.registry import load_task
from visenvs.render import tracking2d
from visenvs.render.scene import first_record
from visenvs.render.style import BLUE, PALE_BLUE, VERMILLION
from visenvs.render.tracking2d import draw, window

TASK = load_task("visenvs/Tracking2D-v0")
CONFIG = TASK.scenarios["random"]
SIZE = (540, 960, 3)


def episode(seed=7, config=CONFIG, steps=100):
    """Records of a flight with random commands, from the start on."""
    lanes, rng = Lanes(TASK, config, 1), np.random.default_rng(seed)
    lanes.reset([seed])
    records = [lanes.snapshot()]
    for _ in range(steps):
        lanes.step(rng.uniform(-1.0, 1.0, (1, 2)).astype(np.float32))
        records.append(lanes.snapshot())
    return np.concatenate(records)


def mask(frame, colour, box):
    left, top, width, height = box
    return (frame[top : top + height, left : left + width] == colour).all(axis=2)


@pytest.mark.parametrize("scenario", TASK.scenarios)
@pytest.mark.parametrize("estimator", ["ekf", "ekf-thesis", "grid", "truth"])
def test_every_step_of_an_episode_is_drawn(scenario, estimator):
    config = override(TASK.scenarios[scenario], {"estimator": estimator})
    records = episode(3, config)
    for k in range(0, len(records), 20):
        frame = draw(records[k], config, TASK, records[:k])
        assert frame.shape == SIZE and frame.dtype == np.uint8


@pytest.mark.parametrize("number", [math.nan, math.inf, -math.inf, 1e300])
def test_the_last_record_of_a_diverged_lane_is_drawn(number):
    record = episode(steps=3)[-1]
    for name in TASK.lane.names or ():
        if name not in ("seed", "episode", "step", "outcome", "r_T_N", "posterior"):
            record[name] = number
    record["outcome"] = 6
    assert draw(record, CONFIG, TASK).shape == SIZE


def test_a_frame_follows_from_the_record_alone_and_leaves_it_as_it_was():
    records, others = episode(7), episode(8)
    before = records.tobytes()
    first = draw(records[60], CONFIG, TASK)
    draw(others[40], CONFIG, TASK, others[:40])
    np.testing.assert_array_equal(draw(records[60].copy(), CONFIG, TASK), first)
    assert (draw(records[61], CONFIG, TASK) != first).any()
    assert records.tobytes() == before


def test_the_window_holds_start_target_and_first_estimate_and_stays():
    lanes, image = Lanes(TASK, CONFIG, 200), np.zeros(SIZE, np.uint8)
    lanes.reset(np.arange(200))
    for record in lanes.records:
        panel = window(image, first_record(record, CONFIG, TASK))
        for point in (np.zeros(2), record["r_T_N"], record["rhat_TV_N"]):
            assert panel.shows(tracking2d.SEEN_FROM_ABOVE @ point)
    panels = [window(image, first_record(record, CONFIG, TASK)) for record in episode(2)]
    assert len({(panel.centre, panel.scale) for panel in panels}) == 1


def test_target_and_estimate_stand_one_above_the_other_in_both_plots():
    record = episode(steps=0)[0]
    record["r_V_N"] = (-1e4, 0.0)
    record["rhat_TV_N"] = record["r_T_N"] * 0.8 + (1e4, 0.0)
    frame, image = draw(record, CONFIG, TASK), np.zeros(SIZE, np.uint8)
    panel = window(image, first_record(record, CONFIG, TASK))
    for colour, x in ((VERMILLION, 1.0), (BLUE, 0.8)):
        column = panel.pixels((x * record["r_T_N"][0], 0.0))[0]
        for box in (tracking2d.TOP_VIEW, tracking2d.RANGE):
            found = mask(frame, colour, box).sum(axis=0)
            near = np.arange(len(found))[found >= max(4, found.max() // 2)]
            assert np.abs(near - column).min() <= 1.5


def test_the_density_is_as_wide_as_the_belief():
    record = episode(steps=0)[0]
    widths = []
    for deviation in (1.0, 2.0):
        record["P"][0, 0] = deviation**2
        row = mask(draw(record, CONFIG, TASK), PALE_BLUE, tracking2d.RANGE)[45]
        widths.append(np.ptp(np.flatnonzero(row)))
    assert widths[1] == pytest.approx(2 * widths[0], rel=0.1)


def test_the_measured_image_point_is_drawn_on_its_side():
    record = episode(steps=0)[0]
    record["P"], record["rhat_TV_N"] = 0.01 * np.eye(2), (20.0, 0.0)
    record["r_TV_N"] = (20.0, 0.3)
    columns = []
    for pixel in (-0.03, 0.03):
        record["pixel"] = pixel
        columns.append(draw(record, CONFIG, TASK))
    left, top, width, height = tracking2d.CAMERA
    changed = (columns[0] != columns[1]).any(axis=2)[top : top + height, left : left + width]
    found = np.flatnonzero(changed.any(axis=0)) - width / 2
    assert found.min() == pytest.approx(-found.max(), abs=2.0)
    assert 5 < found.max() < width / 2


def test_a_missed_detection_is_seen_at_the_border_of_the_camera_picture():
    record = episode(steps=5)[-1]
    left, top, width, _ = tracking2d.CAMERA
    for seen in (0.0, 1.0):
        record["seen"] = seen
        edge = draw(record, CONFIG, TASK)[top, left + 1 : left + width - 1]
        assert (edge == VERMILLION).all() == (seen == 0.0)
