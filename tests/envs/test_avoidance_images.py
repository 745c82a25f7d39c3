"""Avoidance on rendered pictures: the same whatever flies beside, drawn anew from any record."""

import math

import gymnasium
import numpy as np
import pytest

import visenvs  # noqa: F401
from visenvs.core.config import override, to_record
from visenvs.core.lanes import Lanes
from visenvs.core.registry import load_task
from visenvs.envs._avoidance_images import SIGHTED, _tell, camera, look, picture
from visenvs.sensors.images.spheres import Ball

ID = "visenvs/Avoidance-v0"
TASK = load_task(ID)


def lanes_of(count, scenario="random", **settings):
    lanes = Lanes(TASK, override(TASK.scenarios[scenario], settings), count)
    lanes.reset(range(count))
    return lanes


def fly(lanes, steps):
    for k in range(steps):
        action = np.zeros((lanes.count, 3), np.float32)
        action[:, 1:] = 0.5 * np.sin(0.7 * k)
        lanes.step(action)
    return lanes


def test_lanes_do_not_depend_on_their_neighbours():
    together = fly(lanes_of(3, perception="images"), 6)
    alone = Lanes(TASK, together.config, 1)
    alone.reset([2])
    fly(alone, 6)
    assert np.array_equal(together.rows[2], alone.rows[0])
    assert together.records["tracks"]["made"].min() >= 1


def test_the_detector_sees_what_the_points_are_drawn_about():
    """On the thesis's first image the sighting is the obstacle's image point, to half a pixel."""
    lanes = lanes_of(1, "thesis-3.5.2", perception="images")
    lane, config = lanes.records[0], to_record(lanes.config)
    (sighted,) = look(lanes.records, config)
    optics = camera(config[0], int(config[0]["picture"]))
    r = lane["r_O_N"][0] - lane["r_V_N"]
    assert sighted["count"] == 1
    assert sighted["labels"][0] == 0
    assert sighted["seen"][0] == pytest.approx(r[1:] / r[0], abs=0.5 / optics.focal)
    assert sighted["distance"][0] == pytest.approx(r[0], rel=0.05)
    assert lane["sighted"] == 1


def test_a_ball_before_another_one_is_told_by_its_size():
    """A circle drawn about both is nearer to the far one's centre, but too large for it."""
    lanes = lanes_of(1, perception="images")
    lane, config = lanes.records[0], to_record(lanes.config)[0]
    lane["count"], lane["radius"][:2] = 2, 10.0
    ball = Ball((0.02, 0.0), math.asin(5.0 / 30.0), True)
    for far, near in ((0, 1), (1, 0)):
        lane["r_O_N"][far] = lane["r_V_N"] + np.array([150.0, 0.02 * 150.0, 0.0])
        lane["r_O_N"][near] = lane["r_V_N"] + np.array([30.0, 0.0, 0.0])
        told = np.zeros(1, SIGHTED)[0]
        _tell(lane, [ball], config, camera(config, 256), told)
        assert told["labels"][0] == near
        assert told["distance"][0] == pytest.approx(30.0, rel=1e-3)


def test_no_picture_is_taken_between_the_images_and_none_for_the_truth():
    lanes = fly(lanes_of(1, "thesis-3.5.2", perception="images"), 1)
    assert lanes.records["sighted"][0] == 0
    told = lanes_of(1, perception="images", estimator="truth")
    assert look(told.records, to_record(told.config))["count"][0] == 0
    assert told.records["valid_O"].sum() == told.records["count"][0]


def test_pictures_are_observations():
    env = gymnasium.make(ID, observation="pixels", frame=40)
    observation, _ = env.reset(seed=3)
    assert env.observation_space.shape == (40, 40, 6)
    assert env.observation_space.dtype == observation.dtype == np.uint8
    assert observation in env.observation_space
    after, *_ = env.step(np.zeros(3, np.float32))
    assert not np.array_equal(observation, after)
    assert np.array_equal(env.reset(seed=3)[0], observation)
    env.close()


def test_a_snapshot_brings_its_picture_back():
    lanes = fly(lanes_of(2, observation="pixels"), 3)
    snapshot, rows = lanes.snapshot(), lanes.rows.copy()
    fly(lanes, 2)
    assert not np.array_equal(lanes.rows, rows)
    lanes.restore(snapshot)
    assert np.array_equal(lanes.rows, rows)
    drawn = picture(lanes.records[1], to_record(lanes.config)[0], lanes.rows.shape[1])
    assert np.array_equal(rows[1, ..., :3], drawn)


def test_the_other_picture_is_the_one_of_before():
    lanes = lanes_of(2, "moving", observation="pixels", frame_before=0.15)
    seen = [lanes.rows.copy()]
    for _ in range(4):
        seen.append(fly(lanes, 1).rows.copy())
    assert np.array_equal(seen[4][..., 3:], seen[1][..., :3])
    assert np.array_equal(seen[2][..., 3:], seen[0][..., :3])  # the flight is no older
    with pytest.raises(ValueError, match=r"write `frame_before=1\.55`"):
        lanes_of(1, observation="pixels", frame_before=2.0)


def test_many_lanes_give_many_pictures():
    envs = gymnasium.make_vec(ID, num_envs=2, observation="pixels")
    rows, _ = envs.reset(seed=0)
    assert rows.shape == (2, 48, 48, 6)
    assert rows in envs.observation_space
    envs.close()


def test_the_beacon_marks_the_waypoint():
    lanes = lanes_of(1, "balloon", observation="pixels")
    lane, config = lanes.records[0].copy(), to_record(lanes.config)[0]
    lane["r_V_N"] = lanes.config.waypoint - np.array([30.0, 0.0, 0.0])
    frame = picture(lane, config, 64).astype(int)
    green = frame[..., 1] - frame[..., [0, 2]].max(axis=2) > 40
    rows, columns = np.nonzero(green)
    assert rows.mean() == pytest.approx(31.5, abs=1.0)
    assert columns.mean() == pytest.approx(31.5, abs=1.0)


@pytest.mark.parametrize(
    ("scenario", "settings"),
    [
        ("thesis-3.5.1", {"perception": "images"}),
        ("iisc-1", {"perception": "images"}),
        ("iisc-1", {"observation": "pixels"}),
    ],
)
def test_what_no_picture_can_show_is_refused(scenario, settings):
    with pytest.raises(ValueError, match=r"write `half_width=1.0, sensor='image', goal='known'`"):
        override(TASK.scenarios[scenario], settings)
