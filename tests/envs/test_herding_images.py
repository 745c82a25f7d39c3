"""Herding on rendered pictures: tracks, own place, pictures observed, and what is refused."""

import math

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import visenvs  # noqa: F401
from visenvs.core.config import override, to_record
from visenvs.core.frames import wrap_angle
from visenvs.core.lanes import Lanes
from visenvs.core.registry import load_task
from visenvs.dynamics.ground_robot import ACTIVE, ROBOTS
from visenvs.envs._herding_images import NADIR, camera, fleet, picture, searches, square, take
from visenvs.guidance.choices import CHOICES, FIRST_PLACE

ID = "visenvs/Herding-v0"
TASK = load_task(ID)
IMAGES = {"perception": "images", "arena": "kinematic"}
VIO = IMAGES | {"navigation": "vio"}


def lanes_of(count=1, scenario="firmware", **changes):
    lanes = Lanes(TASK, override(TASK.scenarios[scenario], IMAGES | changes), count)
    lanes.reset(range(count // lanes.team))
    return lanes


def choose(lanes, steps, name="hover"):
    for _ in range(steps):
        lanes.step(np.full((lanes.count, 1), CHOICES.index(name)))
    return lanes.records


def errors(record):
    """Errors of place (m) and heading (rad) of the tracks that have just been seen."""
    seen = (record["track_status"] == 1.0) & (record["track_age"] < 0.05)
    places = record["track_r_N"].reshape(ROBOTS, 2)[seen] - record["off_N"]
    headings = np.arctan2(record["track_sin"], record["track_cos"])[seen]
    gaps = np.linalg.norm(places[:, None] - record["r_R_N"][:ROBOTS], axis=2)
    nearest = gaps.argmin(axis=1)
    assert len(set(nearest)) == len(nearest)
    return gaps.min(axis=1), np.abs(wrap_angle(headings - record["heading"][nearest]))


def test_all_robots_are_tracked_with_their_headings():
    record = choose(lanes_of(), 6)[0]
    places, headings = errors(record)
    assert len(places) >= 9
    assert np.median(places) < 0.02 and places.max() < 0.06
    assert np.degrees(np.median(headings)) < 2.0


def test_a_spin_is_seen_in_the_pictures():
    lanes = lanes_of(robots=1, obstacles=0, goal_count=1, noise_max=0.0, start_circle=0.0)
    start = lanes.snapshot()
    start["reversal_t"][0] = -17.0  # due at 3 s
    lanes.restore(start)
    before, after = choose(lanes, 6)["track_p_spin"][0, 0], choose(lanes, 1)["track_p_spin"][0, 0]
    assert (before, after) == (pytest.approx(0.01, abs=0.02), pytest.approx(0.99, abs=0.02))
    assert errors(lanes.records[0])[1] == pytest.approx([0.0], abs=math.radians(4.0))


def test_the_camera_sees_what_points_are_drawn_about():
    """The middle of a robot's top is where its pixel says."""
    lanes = lanes_of()
    cfg, record = to_record(lanes.config)[0], lanes.records[0]
    view = take(record, record, cfg)
    for robot in fleet(record)[:ROBOTS]:
        pixel = view.pixel(robot["place"])
        assert view.place(pixel) == pytest.approx(robot["place"], abs=1e-9)
    ahead = view.pixel(record["r_V_N"] + (1.0, 0.0))
    assert ahead == pytest.approx([159.5, 119.5 - view.optics.focal / view.depth])
    assert NADIR @ NADIR.T == pytest.approx(np.eye(3))


def test_a_robot_is_bright_and_an_obstacle_has_no_plate():
    lanes = lanes_of()
    record, cfg = lanes.records[0], to_record(lanes.config)[0]
    frame, robots = picture(record, record, camera(cfg)).astype(int), fleet(record)
    assert len(robots) == ROBOTS + 4
    view = take(record, record, cfg)
    for robot in robots[:ROBOTS]:
        back = robot["place"] - 0.06 * np.array(
            [np.cos(robot["heading"]), np.sin(robot["heading"])]
        )
        u, v = np.rint(view.pixel(back)).astype(int)
        first, other = (1, 0) if robot["plate"] == 0 else (0, 1)
        assert frame[v, u, first] > frame[v, u, other] + 25
    gone = record.copy()
    gone["fate"][:ROBOTS] = ACTIVE + 1
    assert len(fleet(gone)) == 4


def test_the_whole_picture_is_searched_where_a_robot_may_be():
    lanes = lanes_of()
    cfg = to_record(lanes.config)[0]
    bank = lanes.records[0]["bank"]
    view = take(lanes.records[0], lanes.records[0], cfg)
    bank["picture"] = 1.0
    assert searches(view, bank)  # nobody is known yet
    bank["status"] = 1.0
    assert not searches(view, bank)
    bank["picture"] = 5.0
    assert searches(view, bank)
    bank["picture"], bank["away"][3], bank["guesses"][3, :, 0] = 1.0, 1.0, 8.0
    assert not searches(view, bank)
    bank["guesses"][3, 7, 0] = 1.0
    assert searches(view, bank)


def test_no_picture_is_taken_for_the_truth_nor_near_the_ground():
    told = choose(lanes_of(estimator="truth"), 2)
    assert (told["track_status"] == 1.0).all() and not told["track_sd_r"].any()
    low = lanes_of()
    start = low.snapshot()
    start["height"] = 0.2
    low.restore(start)
    cfg = to_record(low.config)[0]
    assert picture(low.records[0], low.records[0], camera(cfg)).shape == (240, 320, 3)


def test_absurd_records_give_a_black_picture():
    lanes = lanes_of(observation="pixels")
    absurd = lanes.snapshot()
    absurd["height"] = np.nan
    lanes.restore(absurd)
    assert not lanes.rows.any()


def test_lanes_do_not_depend_on_their_neighbours():
    together, alone = lanes_of(2, **VIO), Lanes(TASK, lanes_of(**VIO).config, 1)
    alone.reset([1])
    assert choose(together, 3)[1].tobytes() == choose(alone, 3)[0].tobytes()


def test_a_snapshot_goes_on_as_before():
    lanes = lanes_of(**VIO)
    choose(lanes, 2)
    snapshot = lanes.snapshot()
    after = choose(lanes, 2).tobytes()
    lanes.restore(snapshot)
    assert choose(lanes, 2).tobytes() == after


def test_every_aircraft_of_a_team_takes_its_own_pictures():
    lanes = lanes_of(2, aircraft=2)
    records = choose(lanes, 4)
    assert (records["track_status"] == 1.0).sum(axis=1).min() >= 5
    frames = [
        picture(record, records[0], square(to_record(lanes.config)[0], 64)) for record in records
    ]
    assert (frames[0] != frames[1]).any()


# own place


def test_an_aircraft_that_navigates_is_off_by_some_centimetres_and_its_tracks_with_it():
    lanes = lanes_of(2, **VIO)
    off = [np.hypot(*choose(lanes, 1, CHOICES[FIRST_PLACE])["off_N"].T) for _ in range(16)]
    assert 0.0 < np.max(off[-1]) and np.max(off) < 0.15
    for record in lanes.records:
        assert record["nav"]["alive"].sum() >= 10
        truth = record["r_V_N"] - record["off_N"]
        assert record["nav"]["p"][:2] - truth == pytest.approx(record["off_N"], abs=0.02)


def test_knowing_where_it_is_leaves_no_error():
    assert not choose(lanes_of(), 3)["off_N"].any()


def test_landings_succeed_on_own_navigation():
    lanes = lanes_of(robots=1, obstacles=0, goal_count=1, noise_max=0.0, start_circle=0.0, **VIO)
    choose(lanes, 3)
    for _ in range(40):
        record = choose(lanes, 1, "block 0")[0]
        if record["blocks"]:
            break
    assert record["blocks"] == 1 and np.hypot(*record["off_N"]) < 0.2


# pictures observed


def test_pictures_are_observations():
    env = gym.make(ID, observation="pixels", frame=48, arena="kinematic")
    observation, _ = env.reset(seed=3)
    assert env.observation_space.shape == (48, 48, 3)
    assert env.observation_space.dtype == observation.dtype == np.uint8
    assert observation in env.observation_space
    after, *_, info = env.step(0)
    assert not np.array_equal(observation, after)
    assert info["action_mask"].any()
    assert np.array_equal(env.reset(seed=3)[0], observation)
    env.close()


@pytest.mark.parametrize("mode", ["options", "velocity"])
def test_the_checker_finds_nothing(mode):
    env = gym.make(ID, observation="pixels", frame=36, action_mode=mode, estimator="truth")
    check_env(env.unwrapped, skip_render_check=True)


def test_the_native_vector_is_the_loop_of_single_environments():
    kwargs = {"observation": "pixels", "frame": 32, "action_mode": "velocity", "estimator": "truth"}
    native = gym.make_vec(ID, num_envs=2, **kwargs)
    alone = [gym.make(ID, **kwargs) for _ in range(2)]
    rows, _ = native.reset(seed=7)
    assert all((env.reset(seed=7 + i)[0] == rows[i]).all() for i, env in enumerate(alone))
    for action in np.random.default_rng(1).uniform(-1, 1, (5, 2, 3)).astype(np.float32):
        rows, rewards, *_ = native.step(action)
        for i, env in enumerate(alone):
            row, reward, *_ = env.step(action[i])
            assert (row == rows[i]).all() and reward == rewards[i]


def test_a_snapshot_brings_its_picture_back():
    lanes = lanes_of(2, perception="points", observation="pixels")
    choose(lanes, 2)
    snapshot, rows = lanes.snapshot(), lanes.rows.copy()
    choose(lanes, 2)
    assert not np.array_equal(lanes.rows, rows)
    lanes.restore(snapshot)
    assert np.array_equal(lanes.rows, rows)


# bad input


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"perception": "images", "side": 24.0}, r"of an arena of 20 m; write `side=20.0`"),
        ({"observation": "pixels", "side": 24.0}, r"of an arena of 20 m; write `side=20.0`"),
        ({"perception": "images", "fov": 2.3}, r"write `fov=1.9\d?` or fly lower"),
        (
            {"navigation": "vio"},
            r"write `navigation='vio', perception='images', estimator='camera'`",
        ),
        (
            {"navigation": "vio", "perception": "images", "estimator": "truth"},
            "corners of rendered",
        ),
        ({"observation": "pixels", "frame": 8}, "out of range: frame=8"),
    ],
)
def test_what_no_picture_can_show_is_refused(settings, words):
    with pytest.raises(ValueError, match=words):
        override(TASK.scenarios["firmware"], settings)
