"""Formation on rendered pictures: drawn anew from any record, measured as well as points are."""

import gymnasium
import numpy as np
import pytest

from agents.registry import load
from visenvs.core.config import override, to_record
from visenvs.core.lanes import Lanes
from visenvs.core.registry import load_task
from visenvs.envs._formation_images import camera, expected, picture
from visenvs.sensors.images.leader import detect
from visenvs.sensors.images.scenes import attitude

ID = "visenvs/Formation-v0"
TASK = load_task(ID)
CALM = {"p_lose": 0.0, "blackout": (0.0, 0.0)}


def started(seeds=(3,), scenario="random", **settings):
    config = override(TASK.scenarios[scenario], {"perception": "images"} | settings)
    lanes = Lanes(TASK, config, len(seeds) * TASK.team(config))
    lanes.reset(list(seeds))
    return lanes


def fly(lanes, steps):
    policy, state = load("follow-ff", TASK, lanes.config).policy, None
    for _ in range(steps):
        actions, state = policy.predict(lanes.rows, state)
        lanes.step(np.asarray(actions, np.float32))
    return lanes


def true_ray(lane):
    r = lane["leader"]["r_N"] - lane["r_V_N"]
    return r / np.linalg.norm(r)


def test_lanes_do_not_depend_on_their_neighbours():
    together, alone = fly(started((1, 2, 3)), 4), fly(started((2,)), 4)
    assert np.array_equal(together.rows[1], alone.rows[0])


def test_a_snapshot_brings_its_picture_and_what_follows_back():
    lanes = fly(started(), 3)
    snapshot, config = lanes.snapshot(), to_record(lanes.config)[0]
    frame = picture(snapshot, 0, config)
    later = fly(lanes, 2).rows.copy()
    assert not np.array_equal(picture(lanes.records, 0, config), frame)
    lanes.restore(snapshot)
    assert np.array_equal(picture(lanes.records, 0, config), frame)
    assert np.array_equal(fly(lanes, 2).rows, later)


def test_the_filter_gets_what_the_picture_shows():
    lanes = fly(started((1, 2, 3)), 5)
    assert (lanes.records["seen"] == 1.0).all()
    for lane in lanes.records:
        off = np.arccos(min(true_ray(lane) @ lane["sight"]["u_N"], 1.0))
        far = np.linalg.norm(lane["leader"]["r_N"] - lane["r_V_N"])
        assert off < 0.006
        assert lane["sight"]["alpha"] == pytest.approx(lane["leader"]["wingspan"] / far, rel=0.08)


def test_the_picture_shows_just_the_view():
    config = to_record(started().config)[0]
    optics = camera(config)
    assert (0.5 * optics.width / optics.focal, 0.5 * optics.height / optics.focal) == pytest.approx(
        np.tan(config["view"]), rel=0.01
    )


def test_a_larger_wing_is_drawn_larger():
    """The thesis's leader of 15.7 ft, 31 m ahead, subtends what its own wingspan does."""
    lane = started(scenario="straight").records[0]
    far = np.linalg.norm(lane["leader"]["r_N"] - lane["r_V_N"])
    assert lane["sight"]["alpha"] == pytest.approx(lane["leader"]["wingspan"] / far, rel=0.04)


def test_no_wing_tips_are_given_where_the_filter_has_bearings_alone():
    assert started(scenario="bearing-only").records["sight"]["alpha"][0] == 0.0


def test_a_leader_in_the_dark_is_not_seen():
    lanes = fly(started(), 2)
    darkness = lanes.snapshot()
    darkness["blackout"] = (0.0, 10.0)
    lanes.restore(darkness)
    assert fly(lanes, 2).records["seen"][0] == 0.0
    assert lanes.records["age"][0] > 0.15


def test_a_track_that_is_lost_is_searched_for_everywhere():
    """A filter that believes its leader to be elsewhere, and surely so, finds it after a second."""
    lanes = fly(started(), 3)
    lane = lanes.records[0]
    lane["track"]["polar"]["x"][:3] = (0.0, 0.0, -1.0)
    lane["track"]["polar"]["P"][:3, :3] = 1e-6 * np.eye(3)
    seen = []
    for _ in range(14):
        fly(lanes, 1)
        seen.append(lanes.records["seen"][0])
    assert not any(seen[:10])
    assert any(seen[10:])
    prior = expected(lanes.records[0], attitude(float(lane["heading"]), 0.0, 0.0))
    assert prior is not None


def test_pictures_of_a_team_show_all_of_it():
    """The last of a V sees the one that it follows; without the others it sees nothing."""
    lanes = started((4,), "team")
    config, optics = to_record(lanes.config)[0], camera(to_record(lanes.config)[0])
    full = picture(lanes.records, 4, config)
    others = lanes.records.copy()
    others["outcome"][:4] = 1
    others["leader"]["r_N"] -= 1e3 * others["leader"]["v_N"]
    empty = picture(others, 4, config)
    assert detect(full, optics) is not None
    assert detect(empty, optics) is None
    assert (np.abs(full.astype(int) - empty).max(axis=2) > 40).any()


def test_tracking_is_as_close_as_on_points():
    """Three flights of 8 s on the same seeds; the drop-outs that points draw are left out."""
    seeds, rms = range(3), {}
    for perception in ("points", "images"):
        lanes = fly(started(seeds, perception=perception, t_f=8.0, **CALM), 80)
        assert (lanes.outcome == 1).all()
        rms[perception] = lanes.records["tracking_rms"].copy()
        assert lanes.records["nees_mean"].mean() < 12.0
    assert rms["images"] == pytest.approx(rms["points"], rel=0.2)


def test_a_white_leader_is_often_not_registered():
    shares = [fly(started(range(4), paint=paint), 8).records for paint in ("red", "white")]
    red, white = (float(records["seen_share"].mean()) for records in shares)
    assert white < red
    assert red == 1.0


def test_a_frame_holds_the_picture():
    env = gymnasium.make(ID, perception="images", render_mode="rgb_array")
    env.reset(seed=3)
    shown = env.render()
    assert shown is not None
    blue = (shown[..., 2].astype(int) - shown[..., 0]) > 60  # the sky
    assert blue[320:420, 535:745].mean() > 0.05
    env.close()


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"perception": "pictures"}, "perception: unknown choice 'pictures'"),
        ({"perception": "images", "view": (1.2, 0.4)}, r"write `view=\(0.52, 0.39\)`"),
        ({"picture": 10}, "out of range: picture"),
        ({"paint": "blue"}, "Choices: red, white"),
    ],
)
def test_what_no_picture_can_be_is_refused(settings, message):
    with pytest.raises(ValueError, match=message):
        override(TASK.scenarios["random"], settings)
