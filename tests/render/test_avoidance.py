"""The picture of obstacle avoidance."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from visenvs.core.config import override
from visenvs.core.lanes import Lanes
from visenvs.core.registry import load_task
from visenvs.render import avoidance
from visenvs.render.avoidance import FROM_ABOVE, FROM_THE_SIDE, draw, image_points, windows
from visenvs.render.scene import first_record
from visenvs.render.style import BLUE, GREEN, VERMILLION

TASK = load_task("visenvs/Avoidance-v0")
CONFIG = TASK.scenarios["random"]
SIZE = (540, 960, 3)


def episode(seed=7, config=CONFIG, steps=100):
    """Records of a flight with random commands, from the start on."""
    lanes, rng = Lanes(TASK, config, 1), np.random.default_rng(seed)
    lanes.reset([seed])
    records = [lanes.snapshot()]
    for _ in range(steps):
        lanes.step(rng.uniform(-1.0, 1.0, (1, 3)).astype(np.float32))
        records.append(lanes.snapshot())
    return np.concatenate(records)


def mask(frame, colour, box):
    left, top, width, height = box
    part = frame[top : top + height, left : left + width].astype(int)
    return (np.abs(part - colour) < 48).all(axis=2)  # thin lines are blended with what is below


@pytest.mark.parametrize("scenario", TASK.scenarios)
@pytest.mark.parametrize("estimator", ["ekf", "inverse-ukf", "spherical", "ekf-moving", "truth"])
def test_every_step_of_an_episode_is_drawn(scenario, estimator):
    config = override(TASK.scenarios[scenario], {"estimator": estimator})
    records = episode(3, config)
    for k in range(0, len(records), 20):
        frame = draw(records[k], config, TASK, records[:k])
        assert frame.shape == SIZE and frame.dtype == np.uint8


@pytest.mark.parametrize("outcome", [1, 2, 3, 6, 7])
def test_every_ending_is_drawn(outcome):
    record = episode(steps=3)[-1]
    before = draw(record, CONFIG, TASK)
    record["outcome"] = outcome
    changed = (draw(record, CONFIG, TASK) != before).any(axis=2)
    left, top, width, height = avoidance.STATUS
    assert changed[top + height - 30 : top + height, left : left + width].mean() > 0.9
    assert changed.sum() == changed[top : top + height, left : left + width].sum()


@pytest.mark.parametrize("number", [math.nan, math.inf, -math.inf, 1e300])
def test_the_last_record_of_a_diverged_lane_is_drawn(number):
    record = episode(steps=3)[-1]
    kept = ("seed", "episode", "step", "outcome", "count", "tracks", "valid_O", "sighted")
    for name in TASK.lane.names or ():
        if name not in kept:
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


def test_both_windows_hold_start_waypoint_and_all_spheres_at_one_scale():
    lanes, image = Lanes(TASK, CONFIG, 100), np.zeros(SIZE, np.uint8)
    lanes.reset(np.arange(100))
    for record in lanes.records:
        top, side = windows(image, first_record(record, CONFIG, TASK), CONFIG)
        assert top.scale == side.scale
        n = int(record["count"])
        for panel, rows in ((top, FROM_ABOVE), (side, FROM_THE_SIDE)):
            ends = [np.zeros(2), rows @ np.array(CONFIG.waypoint)]
            for r, radius in zip(record["r_O_N"][:n], record["radius"][:n], strict=True):
                ends += [rows @ r + radius * d for d in np.vstack([np.eye(2), -np.eye(2)])]
            assert all(panel.shows(end) for end in ends)


def test_spheres_estimates_and_waypoint_stand_where_they_are():
    record, image = episode(steps=0)[0], np.zeros(SIZE, np.uint8)
    record["chol_OV"] = 0.0
    frame = draw(record, CONFIG, TASK)
    top, side = windows(image, first_record(record, CONFIG, TASK), CONFIG)
    for panel, rows, box in (
        (top, FROM_ABOVE, avoidance.TOP_VIEW),
        (side, FROM_THE_SIDE, avoidance.SIDE_VIEW),
    ):
        x, y = panel.pixels(rows @ np.array(CONFIG.waypoint))
        ring = np.argwhere(mask(frame, GREEN, box))
        assert np.hypot(*(ring - [y, x]).T).min() < 6.0
        found = np.argwhere(mask(frame, VERMILLION, box))
        x, y = panel.pixels(rows @ record["r_O_N"][0])
        assert np.hypot(*(found - [y, x]).T).min() < 5.0
        circle = np.argwhere(mask(frame, BLUE, box))
        x, y = panel.pixels(rows @ (record["r_V_N"] + record["rhat_OV_N"][0]))
        off = np.hypot(*(circle - [y, x]).T) - record["radius_O"][0] * panel.scale
        assert (np.abs(off) < 1.5).sum() > 20


def test_the_sphere_is_as_large_as_its_radius():
    record = episode(steps=0)[0]
    before, edges = draw(record, CONFIG, TASK), []
    top, _ = windows(before, first_record(record, CONFIG, TASK), CONFIG)
    left, upper, width, height = avoidance.TOP_VIEW
    x, y = top.pixels(FROM_ABOVE @ record["r_O_N"][0])
    for factor in (1.5, 2.0):
        other = record.copy()
        other["radius"][0] *= factor
        changed = (draw(other, CONFIG, TASK) != before).any(axis=2)
        found = np.argwhere(changed[upper : upper + height, left : left + width])
        edges.append(np.hypot(*(found - [y, x]).T).max() / (factor * record["radius"][0]))
    assert edges == pytest.approx([top.scale, top.scale], rel=0.1)


def test_angles_are_shown_as_image_points():
    record = episode(steps=0, config=TASK.scenarios["iisc-1"])[0]
    theta, phi = 0.3, -0.2
    record["sightings"][0], record["sighted"] = (theta, phi), 1.0
    X, Y, Z = math.cos(theta) * math.cos(phi), math.sin(theta) * math.cos(phi), math.sin(phi)
    points = image_points(record, TASK.scenarios["iisc-1"])
    # a mark to the right and up in the picture; the angle down is negative
    assert points == pytest.approx(np.array([[Y / X, -Z / X]]))


def test_an_empty_image_is_seen_at_the_border_of_the_camera_picture():
    record = episode(steps=5)[-1]
    left, top, width, _ = avoidance.CAMERA
    for sighted in (0.0, 1.0):
        record["sighted"] = sighted
        edge = draw(record, CONFIG, TASK)[top, left + 1 : left + width - 1]
        assert (edge == VERMILLION).all() == (sighted == 0.0)


def test_the_horizon_of_a_tilted_camera_is_where_far_things_at_its_height_are():
    config = override(TASK.scenarios["quadrotor"], {"p_detect": 0.0, "p_false": 0.0})
    record, (_, _, width, _) = episode(5, config, 1)[-1], avoidance.CAMERA
    record["count"] = 0
    body = Rotation.from_euler("ZYX", [0.0, -10.0, 30.0], degrees=True)  # nose down, rolled
    record["q_V"] = body.as_quat()[[3, 0, 1, 2]]
    line = np.argwhere(mask(draw(record, config, TASK), GREEN, avoidance.CAMERA))
    for bearing in (-0.4, 0.0, 0.4):
        X, Y, Z = body.inv().apply([math.cos(bearing), math.sin(bearing), 0.0])
        place = width / 2 * (1.0 + np.array([Z / X, Y / X]) / config.half_width)
        assert np.hypot(*(line - place).T).min() < 1.5
