"""The picture of herding shows the arena and what is believed of it."""

import numpy as np
import pytest

from agents.registry import load
from visenvs.core.config import override
from visenvs.core.lanes import Lanes
from visenvs.core.registry import load_task
from visenvs.render.herding import draw, footprint

TASK = load_task("visenvs/Herding-v0")
CONFIG = override(TASK.scenarios["firmware"], {"arena": "kinematic"})


@pytest.fixture(scope="module")
def flown():
    lanes, policy = Lanes(TASK, CONFIG, 1), load("index-look", TASK, CONFIG).policy
    lanes.reset([5])
    records = [lanes.snapshot()[0]]
    for _ in range(80):
        lanes.step(policy.predict(lanes.rows)[0])
        records.append(lanes.snapshot()[0])
    return np.array(records)


def test_pictures_differ_with_robots_tracks_and_path(flown):
    last = flown[-1]
    picture = draw(last, CONFIG, TASK)
    assert picture.shape == (540, 960, 3) and picture.dtype == np.uint8
    assert (picture != draw(flown[0], CONFIG, TASK)).any()
    assert (picture != draw(last, CONFIG, TASK, flown[:-1])).any()
    blind = last.copy()
    blind["track_status"] = 0.0
    assert (picture != draw(blind, CONFIG, TASK)).any()


def test_the_camera_sees_six_metres_across_at_ninety_degrees(flown):
    record = flown[0].copy()
    record["height"] = 3.1  # three metres above the robots' tops
    corners = footprint(record, CONFIG)
    assert np.ptp(corners, axis=0) == pytest.approx([6.0, 4.5])


def test_a_broken_record_is_drawn(flown):
    broken = flown[-1].copy()
    for name in TASK.observation.names:
        broken[name] = np.nan
    broken["outcome"] = 6
    assert draw(broken, CONFIG, TASK).shape == (540, 960, 3)
