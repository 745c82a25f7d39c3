"""The picture of a formation flight: every record is drawn, and marks are where things are."""

from __future__ import annotations

import math

import numpy as np
import pytest

from agents.registry import load
from visenvs.core.config import override
from visenvs.core.lanes import Lanes
from visenvs.core.registry import load_task
from visenvs.render.formation import CAMERA, STATUS, TOP_VIEW, draw, image_point, windows
from visenvs.render.style import MIDDLE_BLUE, PALE_BLUE, VERMILLION

TASK = load_task("visenvs/Formation-v0")
CONFIG = TASK.scenarios["random"]
SIZE = (540, 960, 3)


def episode(seed=7, config=CONFIG, steps=120):
    """Records of a flight with the law `follow`, from the start on."""
    lanes, policy = Lanes(TASK, config, 1), load("follow", TASK, config).policy
    lanes.reset([seed])
    records = [lanes.snapshot()]
    while not lanes.done[0] and len(records) <= steps:
        lanes.step(policy.predict(lanes.rows)[0])
        records.append(lanes.snapshot())
    return np.concatenate(records)


def inside(frame, box):
    left, top, width, height = box
    return frame[top : top + height, left : left + width]


def has(frame, box, colour):
    return (inside(frame, box) == colour).all(axis=2).any()


@pytest.mark.parametrize("scenario", [s for s, c in TASK.scenarios.items() if TASK.team(c) == 1])
def test_every_scenario_is_drawn_with_leader_and_estimate_inside(scenario):
    config = TASK.scenarios[scenario]
    records = episode(3, config, steps=30)
    for k in range(0, len(records), 15):
        frame = draw(records[k], config, TASK, records[:k])
        assert frame.shape == SIZE and frame.dtype == np.uint8
        assert has(frame, TOP_VIEW, VERMILLION) and has(frame, CAMERA, VERMILLION)
        top, chase = windows(frame, config)
        for rows, panel in (((1, 0), top), ((1, 2), chase)):
            assert panel.shows(records[k]["rhat_LV_F"][list(rows)] * (1, -1 if rows[1] else 1))


def test_the_ellipse_grows_with_the_uncertainty_and_is_absent_with_the_truth():
    record = episode(2, steps=30)[-1]
    doubtful = record.copy()
    doubtful["belief"]["C"] = record["belief"]["C"] * 100.0
    sizes = [
        (inside(draw(r, CONFIG, TASK), TOP_VIEW) == PALE_BLUE).all(axis=2).sum()
        for r in (record, doubtful)
    ]
    assert sizes[1] > 3 * sizes[0]
    truth = override(CONFIG, {"estimator": "truth"})
    frame = draw(episode(2, truth, steps=30)[-1], truth, TASK)
    assert not has(frame, TOP_VIEW, PALE_BLUE) and not has(frame, TOP_VIEW, MIDDLE_BLUE)


def test_the_camera_shows_the_leader_where_the_pinhole_puts_it():
    assert image_point(np.array([10.0, 2.0, -1.0])) == pytest.approx([0.2, 0.1])


def test_the_trail_adds_the_paths_flown_and_nothing_else():
    records = episode(7)
    without, trail = draw(records[90], CONFIG, TASK), draw(records[90], CONFIG, TASK, records[:90])
    assert (inside(without, TOP_VIEW) != inside(trail, TOP_VIEW)).any()
    for box in (STATUS, CAMERA):
        np.testing.assert_array_equal(inside(without, box), inside(trail, box))


def test_a_missing_image_is_said():
    seen, unseen = episode(2, steps=30)[-1], episode(2, steps=30)[-1]
    seen["seen"], unseen["seen"] = 1.0, 0.0
    frames = [inside(draw(r, CONFIG, TASK), CAMERA) for r in (seen, unseen)]
    assert (frames[0] != frames[1]).any()


@pytest.mark.parametrize("number", [math.nan, math.inf, -math.inf, 1e300])
def test_the_last_record_of_a_diverged_lane_is_drawn_and_left_as_it_was(number):
    record = episode(steps=3)[-1:].copy()
    for name in set(TASK.lane.names or ()) - {"seed", "episode", "step", "agent", "plan", "track"}:
        parts = record[name].dtype.names
        for part in [record[name][key] for key in parts] if parts else [record[name]]:
            part[...] = number if part.dtype.kind == "f" else 0
    record["outcome"] = 6
    before = record.tobytes()
    assert draw(record[0], CONFIG, TASK).shape == SIZE
    assert record.tobytes() == before
