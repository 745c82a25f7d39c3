from __future__ import annotations

import numpy as np
import pytest

from visenvs.core.config import override
from visenvs.core.lanes import Lanes
from visenvs.core.outcome import LOST
from visenvs.core.registry import load_task
from visenvs.render.convoy import TOP_VIEW, course_axes, draw, extent
from visenvs.render.formation import draw as draw_any
from visenvs.render.style import INK, VERMILLION

TASK = load_task("visenvs/Formation-v0")
SIZE = (540, 960, 3)


def team(followers=3, formation="v", steps=0):
    config = override(
        TASK.scenarios["team"], {"followers": followers, "formation": formation, "t_f": 20.0}
    )
    lanes = Lanes(TASK, config, followers)
    lanes.reset([4])
    records = [lanes.snapshot()]
    for _ in range(steps):
        lanes.step(np.zeros((followers, 3), np.float32))
        records.append(lanes.snapshot())
    return np.array(records), config


def count(frame, colour):
    left, top, width, height = TOP_VIEW
    return (frame[top : top + height, left : left + width] == colour).all(axis=2).sum()


@pytest.mark.parametrize("formation", ["chain", "v"])
@pytest.mark.parametrize("followers", [2, 9])
def test_a_team_is_drawn_to_its_end(followers, formation):
    records, config = team(followers, formation, 200)
    for k in range(0, 201, 40):
        frame = draw(records[k], config, records[:k])
        assert frame.shape == SIZE and frame.dtype == np.uint8
        assert np.array_equal(frame, draw_any(records[k], config, TASK, records[:k]))
    deep, wide = extent(config)
    assert deep > 30.0 * (followers if formation == "chain" else followers // 2)
    assert wide > 10.0


def test_the_leader_flies_up_the_page_and_who_is_lost_is_pale():
    records, config = team()
    v = records[0][0]["leader"]["v_N"]
    assert course_axes(records[0][0]) @ v == pytest.approx([np.linalg.norm(v), 0.0, 0.0])
    whole = draw(records[0], config)
    records[0]["outcome"][1:] = LOST
    pale = draw(records[0], config)
    assert count(pale, INK) < 0.6 * count(whole, INK)
    assert count(pale, VERMILLION) == count(whole, VERMILLION)


def test_numbers_that_are_none_are_drawn():
    records, config = team()
    for name in ("rhat_LV_F", "tracking_error", "total_cost"):
        records[0][name] = np.nan
    records[0]["belief"]["C"] = np.inf
    assert draw(records[0], config).shape == SIZE
