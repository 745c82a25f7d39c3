from __future__ import annotations

import math

import numpy as np
import pytest

from agents.registry import load
from visenvs.core.lanes import Lanes
from visenvs.core.registry import load_task
from visenvs.render.mapping import CAMERA, ROUND, SPACE, draw, footprint, projected, window
from visenvs.render.style import BLUE, VERMILLION

TASK = load_task("visenvs/Mapping-v0")
SIZE = (540, 960, 3)


def episode(scenario="town", seed=7, steps=40, law="information-gain"):
    """Records of a flight, from the start on."""
    config = TASK.scenarios[scenario]
    lanes, state = Lanes(TASK, config, 1), None
    policy = load(law, TASK, config).policy
    lanes.reset([seed])
    records = [lanes.snapshot()]
    for _ in range(steps):
        action, state = policy.predict(lanes.rows, state)
        lanes.step(action)
        records.append(lanes.snapshot())
    return config, np.concatenate(records)


def inside(frame, box):
    left, top, width, height = box
    return frame[top : top + height, left : left + width]


@pytest.mark.parametrize("scenario", TASK.scenarios)
def test_every_scene_is_drawn_and_left_as_it_was(scenario):
    config, records = episode(scenario, law="circle")
    for k in (0, 1, 40):
        before = records[k].tobytes()
        frame = draw(records[k], config, TASK, records[:k])
        assert frame.shape == SIZE and frame.dtype == np.uint8
        assert records[k].tobytes() == before


@pytest.mark.parametrize("number", [math.nan, math.inf, 1e300])
def test_the_last_record_of_a_diverged_lane_is_drawn(number):
    config, records = episode(steps=3)
    record = records[-1]
    for name, (dtype, *_) in (TASK.lane.fields or {}).items():
        if dtype.base == np.dtype("f8"):
            record[name] = number
    for name in ("x", "P"):
        record["map"][name] = number
    record["outcome"] = 6
    assert draw(record, config, TASK).shape == SIZE


def test_the_trail_adds_the_path_and_nothing_else():
    config, records = episode()
    without, trail = draw(records[-1], config, TASK), draw(records[-1], config, TASK, records[:-1])
    assert (inside(without, SPACE) != inside(trail, SPACE)).any()
    assert (inside(without, CAMERA) == inside(trail, CAMERA)).all()


def test_up_is_up_and_east_is_right():
    assert ROUND[0, 1] > 0.0 and ROUND[1, 2] < 0.0 and ROUND[1, 0] > 0.0
    assert np.linalg.norm(ROUND, axis=1) == pytest.approx([1.0, 1.0])
    assert ROUND[0] @ ROUND[1] == pytest.approx(0.0)


def test_the_area_and_the_air_above_it_are_in_the_window():
    config, _ = episode(steps=0)
    panel = window(np.zeros(SIZE, np.uint8), config)
    for n in (-60.0, 60.0):
        for e in (-60.0, 60.0):
            for d in (0.0, -30.0):
                assert panel.shows(ROUND @ (n, e, d))


def test_truth_is_covered_by_its_lines_where_the_map_is_right():
    config, records = episode(steps=0)
    record = records[0]
    record["r_V_N"] = 1e4  # out of the way
    n = int(record["edges"])
    before = inside(draw(record, config, TASK), SPACE)
    m = record["map"]
    m["alive"][:n], m["x"][:n], m["used"] = 1.0, record["edge"][:n], n
    after = inside(draw(record, config, TASK), SPACE)
    changed = (before != after).any(axis=2)
    assert changed.sum() > 500
    red, blue = (np.abs(after[changed].astype(int) - c).sum(axis=1) for c in (VERMILLION, BLUE))
    assert np.mean(blue < red) > 0.5
    assert (before[changed] != (255, 255, 255)).any(axis=1).mean() > 0.95  # on the true edges


def test_the_camera_shows_segments_and_the_lines_before_it():
    config, records = episode(steps=30)
    record = records[-1]
    frame = inside(draw(record, config, TASK), CAMERA)
    assert record["seen"] > 5
    record["seen"] = 0.0
    changed = (frame != inside(draw(record, config, TASK), CAMERA)).any(axis=2)
    assert changed.sum() > 200
    assert frame[changed].astype(int).mean() < 150  # ink
    place, C = record["r_V_N"], record["C"]
    ahead = np.array([place + 10.0 * C[0] + C[1], place + 10.0 * C[0] - C[1]])
    assert projected(ahead, record) == pytest.approx(np.array([[0.1, 0.0], [-0.1, 0.0]]))
    through = np.array([place + 10.0 * C[0], place - 10.0 * C[0] + C[1]])
    ends = projected(through, record)
    assert np.isfinite(ends).all() and ends[1, 0] > 0.0
    assert not len(projected(ahead - 30.0 * C[0], record))


def test_the_footprint_is_what_the_corners_of_the_picture_see():
    config, records = episode(steps=10)
    record = records[-1]
    for corner in footprint(record, config):
        q = record["C"] @ (corner - record["r_V_N"])
        assert corner[2] == pytest.approx(0.0, abs=1e-9)
        assert np.abs(q[1:] / q[0]) == pytest.approx([config.half_width] * 2)
