"""Herding with a quadrotor: how it flies, lands and rests, and what its tilting camera sees."""

import math

import numpy as np
import pytest

from agents.registry import load
from visenvs.core.config import override, to_record
from visenvs.core.frames import wrap_angle
from visenvs.core.lanes import Lanes
from visenvs.core.registry import load_task
from visenvs.dynamics.ground_robot import ROBOTS
from visenvs.dynamics.quadrotor import attitude, turn
from visenvs.envs._herding_images import camera, fleet, picture, take
from visenvs.estimation.robot_track import TRACKED
from visenvs.guidance.choices import CHOICES, FIRST_PLACE
from visenvs.render.herding import footprint

TASK = load_task("visenvs/Herding-v0")
QUADROTOR = {"dynamics": "quadrotor", "arena": "kinematic"}
TRUTH = {"estimator": "truth"}
ALONE = {"robots": 1, "obstacles": 0, "goal_count": 1, "noise_max": 0.0, "start_circle": 0.0}
FAR = f"go to place {8}"
CRUISE, DESCENT, GROUND, CLIMB = range(4)


def lanes_of(count=1, **changes):
    lanes = Lanes(TASK, override(TASK.scenarios["firmware"], QUADROTOR | changes), count)
    lanes.reset(range(count // lanes.team))
    return lanes


def alone(tick=0.05, **changes):
    """One robot in the middle that drives north, known and never swerving, and two aircraft.

    The second one hovers far away: while one is free a step lasts a tick.
    """
    pace = {"aircraft": 2, "tick": tick, "dt": tick}
    lanes = lanes_of(2, **(TRUTH | ALONE | pace | changes))
    start = lanes.snapshot()
    start["r_R_N"][0, 0], start["heading"][0, 0] = (0.0, 0.0), 0.0
    start["r_V_N"] = start["aim_N"] = (0.0, 0.0), (-9.0, -9.0)
    lanes.restore(start)
    ticks(lanes, "hover", 1)
    return lanes


def ticks(lanes, name, count):
    """Records of the first aircraft after every tick; it chooses the same whenever it is free."""
    out = []
    for _ in range(count):
        free = lanes.records["stage"][0] == CRUISE
        lanes.step(np.array([CHOICES.index(name) if free else 0, 0]))
        out.append(lanes.records[0].copy())
    return np.array(out)


def tilt_of(records):
    """Angle between the body's down axis and down, rad."""
    q = records["q_V"]
    return np.arccos(np.clip(1.0 - 2.0 * (q[:, 1] ** 2 + q[:, 2] ** 2), -1.0, 1.0))


# how it flies


def test_with_a_fast_attitude_loop_it_flies_as_the_point_mass():
    """The loop delays accelerations by 2 damping / bandwidth, so places part in proportion to it.

    Level flight only: no height enters the control of places.
    """
    paths = []
    for bandwidth in (0.0, 20.0, 40.0, 80.0):
        kind = {"bandwidth": bandwidth, "rate_max": 100.0} if bandwidth else {}
        kind |= {} if bandwidth else {"dynamics": "point_mass"}
        lanes = alone(tick=0.02, substeps=10, **kind)
        paths.append(ticks(lanes, FAR, 150)["r_V_N"])
    parted = [np.linalg.norm(path - paths[0], axis=1).max() for path in paths[1:]]
    assert parted[2] < 0.04 and parted[0] > 0.05
    assert parted[0] / parted[1] == pytest.approx(2.0, abs=0.5)
    assert parted[1] / parted[2] == pytest.approx(2.0, abs=0.5)


@pytest.mark.kernel
@pytest.mark.kernel
def test_it_tilts_to_fly_and_keeps_height_and_limits():
    flown = ticks(alone(), FAR, 140)
    assert math.degrees(tilt_of(flown).max()) == pytest.approx(
        math.degrees(math.atan2(3.05, 9.81)), abs=1.5
    )
    assert np.ptp(flown["height"]) < 0.02
    assert np.linalg.norm(flown["v_V_N"], axis=1).max() < 1.05 * 2.13
    assert np.linalg.norm(flown["felt"][:, :5, 0], axis=2).max() < 1.1 * 3.05
    assert flown["r_V_N"][-1] == pytest.approx([20 / 3, 20 / 3], abs=0.01)
    assert tilt_of(flown)[-1] < 0.01


def test_it_comes_down_at_the_wanted_rate_and_rests_on_the_floor():
    flown = ticks(alone(), "block 0", 260)
    stage, height = flown["stage"], flown["height"]
    sinking = (stage == DESCENT) & (height > 0.1) & (height < 2.5)
    assert flown["sink"][sinking] == pytest.approx(np.full(sinking.sum(), 1.0), abs=0.02)
    ground = stage == GROUND
    assert ground.any() and not height[ground].any()
    for name in ("v_V_N", "sink", "omega_V"):
        assert not flown[name][ground].any()
    assert tilt_of(flown)[ground] == pytest.approx(0.0, abs=1e-9)
    assert height.min() == 0.0
    climbing = (stage == CLIMB) & (height > 0.5) & (height < 2.5)
    assert flown["sink"][climbing] == pytest.approx(np.full(climbing.sum(), -1.0), abs=0.02)
    assert height[stage == CLIMB].max() == pytest.approx(2.9, abs=0.05)


@pytest.mark.kernel
@pytest.mark.kernel
@pytest.mark.parametrize("landing", ["pid", "ddp"])
@pytest.mark.parametrize("service, heading", [("block 0", math.pi), ("tap 0", math.pi / 4)])
def test_services_turn_a_robot(landing, service, heading):
    flown = ticks(alone(landing=landing), service, 200)
    last = flown[-1]
    assert (last["touches"], last["aborts"]) == (1, 0)
    assert last["heading"][0] == pytest.approx(heading, abs=1e-9)


def test_a_robots_top_carries_it():
    """It touches the top at full speed, and neither sinks into the robot nor pushes it."""
    flown = ticks(alone(), "tap 0", 160)
    assert flown["taps"][-1] == 1
    assert flown["height"].min() == pytest.approx(flown[0]["height"] - 3.0 + 0.15, abs=0.01)
    way = np.linalg.norm(np.diff(flown["r_R_N"][:, 0], axis=0), axis=1)
    assert way.max() < 0.33 * 0.05 + 1e-9


def test_what_it_feels_is_how_it_moves():
    """Accelerations and rates of all parts of all ticks, a landing and a touchdown included."""
    before = alone().snapshot()[0]
    flown, q, C = ticks(alone(), "block 0", 260), np.array([1.0, 0.0, 0.0, 0.0]), np.empty((3, 3))
    v, wanted = np.array([*before["v_V_N"], before["sink"]]), np.empty((3, 3))
    for record in flown:
        for a, rates in record["felt"][:5]:
            v += 0.01 * a
            turn(q, rates, 0.01)
        assert v == pytest.approx([*record["v_V_N"], record["sink"]], abs=1e-9)
        attitude(q, C)
        attitude(record["q_V"], wanted)
        assert C == pytest.approx(wanted, abs=1e-9)
    assert (flown["stage"] == GROUND).any()


@pytest.mark.kernel
def test_set_points_are_flown_and_land():
    lanes = lanes_of(action_mode="velocity", dt=0.2, **TRUTH)
    for action in ((1.0, 0.0, -1.0), (0.0, 0.0, 1.0), (0.0, 0.0, -1.0)):
        for _ in range(20):
            lanes.step(np.array([action], np.float32))
        record = lanes.records[0]
        if action[0]:
            assert record["v_V_N"] == pytest.approx([2.13, 0.0], abs=0.02)
        elif action[2] > 0.0:
            assert record["height"] == 0.0 and record["stage"] == GROUND
            assert not record["v_V_N"].any() and not record["omega_V"].any()
    assert record["height"] == pytest.approx(3.0, abs=0.01) and record["stage"] == CRUISE


def test_teams_fly_and_a_snapshot_goes_on_as_before():
    lanes = lanes_of(2, aircraft=2)
    policy = load("index", TASK, lanes.config).policy
    for _ in range(30):
        lanes.step(policy.predict(lanes.rows)[0])
    snapshot, after = lanes.snapshot(), []
    for _ in range(2):
        lanes.restore(snapshot)
        for _ in range(10):
            lanes.step(policy.predict(lanes.rows)[0])
        after.append(lanes.snapshot().tobytes())
    assert after[0] == after[1] != snapshot.tobytes()
    assert lanes.records["q_V"][:, 1:].any(axis=1).all()


def test_robots_are_herded():
    """Five minutes of one mission on a tilting camera; nobody is goaled so soon by himself."""
    lanes = lanes_of(t_f=300.0)
    policy = load("index-look", TASK, lanes.config).policy
    while not lanes.done.all():
        lanes.step(policy.predict(lanes.rows)[0])
    record = lanes.records[0]
    assert record["blocks"] >= 5 and record["taps"] >= 3
    assert record["herded"] >= 2


# what its camera sees


def shuttle(lanes, seconds):
    """Fly to and fro at full acceleration; yields the records after every half second."""
    for k in range(2 * seconds):
        place = FIRST_PLACE + (3 if k // 2 % 2 else 5)
        lanes.step(np.full((lanes.count, 1), place))
        yield lanes.records


def test_tracks_stay_consistent_while_the_camera_tilts():
    """Squared errors over the stated variances are 2 on average; the attitude is known."""
    nees, tilts = [], []
    for records in shuttle(lanes_of(12, noise_max=0.0), 9):
        tilts.append(tilt_of(records))
        for record in records:
            bank = record["bank"]
            for j in np.flatnonzero((bank["status"] == TRACKED) & (bank["age"] < 0.05)):
                if bank["p_spin"][j] < 0.5 and bank["filled"][j] > 5:
                    error = bank["r_N"][j] - record["r_R_N"][:ROBOTS]
                    error = error[np.argmin(np.hypot(*error.T))]
                    P = bank["P"][j, 0, :2, :2]
                    nees.append(error @ np.linalg.solve(P, error))
    assert np.percentile(tilts, 75) > math.radians(8.0)
    assert len(nees) > 300
    assert 0.5 < np.median(nees) < 2.2  # chi-square of 2: 1.4


def tilted(pitch, roll=0.0, **changes):
    """A lane whose aircraft is at a pitch and a roll, rad."""
    lanes = lanes_of(**changes)
    start = lanes.snapshot()
    turn(start["q_V"][0], np.array([roll, 0.0, 0.0]), 1.0)
    turn(start["q_V"][0], np.array([0.0, pitch, 0.0]), 1.0)
    lanes.restore(start)
    return lanes


def test_pictures_are_taken_by_the_tilted_camera():
    lanes = tilted(0.2, -0.15, perception="images")
    record, cfg = lanes.records[0], to_record(lanes.config)[0]
    view, frame = take(record, record, cfg), picture(record, record, camera(cfg)).astype(int)
    for robot in fleet(record)[:ROBOTS]:
        assert view.place(view.pixel(robot["place"])) == pytest.approx(robot["place"], abs=1e-9)
        back = 0.06 * np.array([math.cos(robot["heading"]), math.sin(robot["heading"])])
        u, v = np.rint(view.pixel(robot["place"] - back)).astype(int)
        if 2 < u < 317 and 2 < v < 237:
            first, other = (1, 0) if robot["plate"] == 0 else (0, 1)
            assert frame[v, u, first] > frame[v, u, other] + 25


@pytest.mark.parametrize("pitch", [0.0, 0.25])
def test_the_footprint_is_what_the_camera_sees(pitch):
    """The middle of its sides is where rays of the picture's edges meet the robots' tops."""
    lanes = tilted(pitch)
    corners = footprint(lanes.records[0], lanes.config)
    ahead, back = corners[2, 1], corners[0, 1]
    half = math.atan(0.75)
    assert ahead == pytest.approx(2.9 * math.tan(half + pitch))
    assert back == pytest.approx(2.9 * math.tan(-half + pitch))
    assert np.ptp(corners[2:, 0]) / np.ptp(corners[:2, 0]) == pytest.approx(
        math.cos(half - pitch) / math.cos(half + pitch)
    )


def test_robots_are_found_in_tilted_pictures():
    places, headings = [], []
    for records in shuttle(lanes_of(perception="images", noise_max=0.0), 6):
        record = records[0]
        fresh = (record["track_status"] == 1.0) & (record["track_age"] < 0.05)
        found = record["track_r_N"].reshape(ROBOTS, 2)[fresh]
        gaps = np.linalg.norm(found[:, None] - record["r_R_N"][:ROBOTS], axis=2)
        if len(found):
            nearest = gaps.argmin(axis=1)
            places += gaps.min(axis=1).tolist()
            sines, cosines = record["track_sin"][fresh], record["track_cos"][fresh]
            off = np.arctan2(sines, cosines) - record["heading"][nearest]
            headings += np.abs(wrap_angle(off)).tolist()
    assert len(places) > 40
    assert np.median(places) < 0.02 and np.percentile(places, 95) < 0.08
    assert math.degrees(np.median(headings)) < 2.0


def test_the_navigation_knows_the_tilt():
    lanes = lanes_of(perception="images", navigation="vio")
    C, most = np.empty((3, 3)), 0.0
    for records in shuttle(lanes, 8):
        attitude(records[0]["q_V"], C)
        off = C @ records[0]["nav"]["C"].T
        most = max(most, math.acos(min(0.5 * (np.trace(off) - 1.0), 1.0)))
        assert np.hypot(*records[0]["off_N"]) < 0.15
    assert tilt_of(records).max() >= 0.0 and math.degrees(most) < 1.0


def test_pixels_show_the_tilt():
    level, leaning = (
        tilted(pitch, observation="pixels", frame=48, **TRUTH).rows for pitch in (0, 0.2)
    )
    assert (level != leaning).mean() > 0.3


# bad input


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"dynamics": "quad"}, "dynamics"),
        ({"bandwidth": 120.0}, r"write `substeps=7` or more, or a smaller bandwidth"),
        ({"damping": 10.0}, r"damping=10 is unstable in parts of 0.01 s"),
        ({"bandwidth": -1.0}, "out of range: bandwidth=-1"),
        ({"damping": 0.0}, "out of range: damping=0"),
        ({"rate_max": 0.0}, "out of range: rate_max=0"),
        ({"substeps": 11}, "out of range: substeps=11"),
        ({"substeps": 0}, "out of range: substeps=0"),
    ],
)
def test_what_no_attitude_loop_can_do_is_refused(settings, words):
    with pytest.raises(ValueError, match=words):
        override(TASK.scenarios["firmware"], QUADROTOR | settings)
