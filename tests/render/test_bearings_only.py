from __future__ import annotations

import math

import numpy as np
import pytest

from visenvs.core.config import override
from visenvs.core.lanes import Lanes
from visenvs.core.registry import load_task
from visenvs.render.bearings_only import STATUS, TOP_VIEW, draw, sight, window
from visenvs.render.style import MIDDLE_BLUE, PALE_BLUE, VERMILLION, WHITE

TASK = load_task("visenvs/BearingsOnly-v0")
CONFIG = TASK.scenarios["random"]
SIZE = (540, 960, 3)


def episode(seed=7, config=CONFIG, steps=None):
    """Records of a flight with random commands, from the start on."""
    lanes, rng = Lanes(TASK, config, 1), np.random.default_rng(seed)
    lanes.reset([seed])
    records = [lanes.snapshot()]
    while not lanes.done[0] and (steps is None or len(records) <= steps):
        lanes.step(rng.uniform(-1.0, 1.0, (1, 1)).astype(np.float32))
        records.append(lanes.snapshot())
    return np.concatenate(records)


def inside(frame, box):
    left, top, width, height = box
    return frame[top : top + height, left : left + width]


@pytest.mark.parametrize("estimator", ["ukf", "ekf"])
def test_every_step_of_an_episode_is_drawn(estimator):
    config = override(CONFIG, {"estimator": estimator})
    records = episode(3, config)
    for k in range(0, len(records), 15):
        frame = draw(records[k], config, TASK, records[:k])
        assert frame.shape == SIZE and frame.dtype == np.uint8


def test_any_record_is_drawn_and_left_as_it_was():
    rng = np.random.default_rng(0)
    for record in episode(1)[rng.integers(0, 150, 60)]:
        root = rng.normal(size=(4, 4)) * 10.0 ** rng.uniform(-6.0, 9.0)
        record["P"] = root @ root.T
        record["rhat_TV_N"] = rng.normal(size=2) * 10.0 ** rng.uniform(-3.0, 6.0)
        record["vhat_T_N"] = rng.normal(size=2) * 10.0 ** rng.uniform(-3.0, 6.0)
        record["v_V_N"] = rng.normal(size=2) * 10.0 ** rng.uniform(-9.0, 4.0)
        record["r_V_N"] *= 10.0 ** rng.uniform(0.0, 4.0)
        before = record.tobytes()
        assert draw(record, CONFIG, TASK).shape == SIZE
        assert record.tobytes() == before


@pytest.mark.parametrize("number", [math.nan, math.inf, -math.inf, 1e300])
def test_the_last_record_of_a_diverged_lane_is_drawn(number):
    record = episode(steps=3)[-1]
    for name in TASK.lane.names or ():
        if name not in ("seed", "episode", "step", "outcome"):
            record[name] = number
    record["outcome"] = 6
    assert draw(record, CONFIG, TASK).shape == SIZE


def test_the_trail_adds_the_paths_flown_and_nothing_else():
    records = episode(7)
    without, trail = draw(records[90], CONFIG, TASK), draw(records[90], CONFIG, TASK, records[:90])
    assert (inside(without, TOP_VIEW) != inside(trail, TOP_VIEW)).any()
    np.testing.assert_array_equal(inside(without, STATUS), inside(trail, STATUS))


def test_the_window_holds_start_target_and_first_estimate_and_stays():
    image = np.zeros(SIZE, np.uint8)
    for seed in range(20):
        records = episode(seed)
        panels = [window(image, record, CONFIG, TASK) for record in records]
        assert len({(panel.centre, panel.scale) for panel in panels}) == 1
        assert panels[0].shows((0.0, 0.0))
        assert panels[0].shows(records[0]["rhat_TV_N"][::-1])
        for record in records:
            assert panels[0].shows((record["r_V_N"] + record["r_TV_N"])[::-1])


def test_north_is_up_and_east_is_right():
    panel = window(np.zeros(SIZE, np.uint8), episode(steps=0)[0], CONFIG, TASK)
    here, north, east = panel.pixels([(0.0, 0.0), (0.0, 100.0), (100.0, 0.0)])
    assert north[1] < here[1] and north[0] == here[0]
    assert east[0] > here[0] and east[1] == here[1]


def test_the_target_is_drawn_where_it_is():
    record = episode(steps=0)[0]
    panel = window(np.zeros(SIZE, np.uint8), record, CONFIG, TASK)
    record["seen"] = 0.0
    target = panel.pixels(record["r_TV_N"][::-1])
    record["rhat_TV_N"] = 1e6  # out of sight, with its ellipses
    record["P"] = 0.0
    mask = (inside(draw(record, CONFIG, TASK), TOP_VIEW) == VERMILLION).all(axis=2)
    rows, columns = np.nonzero(mask)
    np.testing.assert_allclose([columns.mean() + 0.5, rows.mean() + 0.5], target, atol=1.0)


def test_the_ellipses_are_those_of_one_and_three_sigma():
    record, image = episode(steps=0)[0], np.zeros(SIZE, np.uint8)
    panel = window(image, record, CONFIG, TASK)
    east, north = panel.centre
    record["P"][:2, :2] = [[6e4, 3e4], [3e4, 9e4]]  # north, east
    record["rhat_TV_N"] = north, east
    record["r_V_N"], record["v_V_N"], record["vhat_T_N"] = 0.0, 0.0, 0.0
    record["r_TV_N"] = 1e6  # out of sight
    record["seen"] = 0.0
    frame = inside(draw(record, CONFIG, TASK), TOP_VIEW)
    angle = np.linspace(0.0, 2.0 * math.pi, 48, endpoint=False)
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    root = np.linalg.cholesky(record["P"][:2, :2])
    for sigmas, colour in ((0.8, MIDDLE_BLUE), (1.2, PALE_BLUE), (2.8, PALE_BLUE), (3.2, WHITE)):
        points = (record["rhat_TV_N"] + sigmas * circle @ root.T)[:, ::-1]
        x, y = panel.pixels(points).astype(int).T
        assert np.mean((frame[y, x] == colour).all(axis=1)) > 0.7  # the rest lie on grid lines


def test_the_line_of_sight_starts_at_the_observer_and_passes_a_target_seen_without_noise():
    records = episode(5, override(CONFIG, {"sigma_bearing": 1e-9}), steps=10)
    record = records[-1]
    start, end = sight(record)
    assert start == pytest.approx(record["r_V_N"][::-1])
    target = record["r_TV_N"][::-1]
    assert (end - start) @ target > 0.0
    assert np.cross(np.append(end - start, 0), np.append(target, 0))[2] == pytest.approx(
        0.0, abs=1e-4 * float(target @ target)
    )
