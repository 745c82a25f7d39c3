"""The mission: its start, services, rules and score, what the camera tells, and bad input."""

import math

import gymnasium as gym
import numpy as np
import pytest

from agents.registry import load
from eval.rollout import rollout
from visenvs.core.config import override, to_record
from visenvs.core.lanes import Lanes
from visenvs.core.outcome import Outcome
from visenvs.core.registry import load_task
from visenvs.dynamics.ground_robot import ACTIVE, GOALED, REMOVED, ROBOTS
from visenvs.dynamics.lander import DAMPING, STIFFNESS
from visenvs.envs._herding_config import SCENARIOS
from visenvs.envs._herding_landing import begin_landing, land_by_plan
from visenvs.envs._herding_layout import WORK
from visenvs.guidance.choices import CHOICES
from visenvs.guidance.interception import LEAD
from visenvs.guidance.landing import AHEAD

TASK = load_task("visenvs/Herding-v0")
TRUTH = {"estimator": "truth", "arena": "kinematic"}
SCORE = 20.0  # thousand points, all robots goaled at once


def lanes_of(count=1, scenario="firmware", **changes):
    lanes = Lanes(TASK, override(SCENARIOS[scenario], TRUTH | changes), count)
    lanes.reset(range(count // lanes.team))
    return lanes


def choose(lanes, *names):
    lanes.step(np.array([CHOICES.index(name) for name in names]))
    return lanes.records


def alone(**changes):
    """One robot in the middle of the arena that drives north and never swerves."""
    lanes = lanes_of(robots=1, obstacles=0, goal_count=1, noise_max=0.0, **changes)
    start = lanes.snapshot()
    start["r_R_N"][0, 0], start["heading"][0, 0] = (0.0, 0.0), 0.0
    lanes.restore(start)
    choose(lanes, "hover")
    return lanes


def serve(lanes, service):
    """Choose a service until an aircraft has felt something or a minute is over."""
    for _ in range(120):
        record = choose(lanes, service)[0]
        if record["touches"] or record["aborts"]:
            return record
    raise AssertionError(f"no {service}")


def fly(law, seeds, **changes):
    config = override(SCENARIOS["firmware"], TRUTH | changes)
    return rollout(load(law, TASK, config).policy, TASK, config, seeds).records


# the start


def test_robots_start_on_a_circle_heading_outward_and_obstacles_on_theirs():
    records = lanes_of(20).records
    r, heading = records["r_R_N"], records["heading"]
    radius = np.hypot(r[..., 0], r[..., 1])
    assert radius[:, :ROBOTS] == pytest.approx(np.full((20, ROBOTS), 1.0), abs=1e-12)
    assert radius[:, ROBOTS:] == pytest.approx(np.full((20, 4), 5.0), abs=1e-12)
    outward = np.stack([np.cos(heading), np.sin(heading)], axis=-1)
    along = np.einsum("nki,nki->nk", r, outward)
    assert along[:, :ROBOTS] == pytest.approx(radius[:, :ROBOTS])
    assert along[:, ROBOTS:] == pytest.approx(0.0, abs=1e-12)
    assert len(np.unique(r[:, 0, 0])) == 20


def test_obstacles_keep_their_circle():
    lanes = lanes_of(robots=1, goal_count=1)
    for _ in range(100):
        choose(lanes, "hover")
    assert np.hypot(*lanes.records["r_R_N"][0, ROBOTS:].T) == pytest.approx(np.full(4, 5.0))


# services


@pytest.mark.parametrize("landing", ["pid", "ddp"])
def test_landing_in_front_turns_a_robot_about(landing):
    lanes = alone(landing=landing)
    record = serve(lanes, "block 0")
    assert (record["blocks"], record["touched"][0], record["aborts"]) == (1, 1, 0)
    assert record["heading"][0] == pytest.approx(math.pi, abs=1e-9)
    assert record["height"] == lanes.config.cruise


def test_a_planned_landing_ends_slowly_in_the_robots_path_and_within_limits():
    lane, cfg, work = alone().records[0], to_record(SCENARIOS["firmware"])[0], np.zeros(1, WORK)[0]
    ahead, pose, plan, flight = lane["track_r_N"], work["pose"], work["plan"], work["flight"]
    lane["r_V_N"] = np.add(ahead[:2], (0.9, 0.4))
    begin_landing(lane, 0, cfg, pose, plan)
    most, fastest = 0.0, 0.0
    while lane["height"] > 0.0:
        land_by_plan(lane, 0, cfg, pose, plan, flight)
        ahead[0] += cfg["speed"] * cfg["tick"]
        lane["track_phase"][0] += cfg["tick"]
        most = max(most, math.hypot(*lane["u"][0]))
        fastest = max(fastest, math.hypot(*lane["v_V_N"], lane["sink"]))
    gap = lane["r_V_N"] - ahead[:2] - [AHEAD, 0.0]
    assert -0.02 < gap[0] < 0.1  # the aim lies under the floor: it is there a little early
    assert abs(gap[1]) < 0.02
    assert 0.0 < lane["sink"] < 0.5 * cfg["v_descent"]  # unplanned, it comes down at v_descent
    assert math.hypot(*lane["v_V_N"]) < 0.3
    assert most <= cfg["a_max"] and fastest <= cfg["v_max"]


def test_touching_the_top_turns_a_robot_by_45_degrees():
    record = serve(alone(), "tap 0")
    assert (record["taps"], record["touched"][0], record["aborts"]) == (1, 1, 0)
    assert record["heading"][0] == pytest.approx(math.pi / 4, abs=1e-9)


def test_a_delay_keeps_the_aircraft_up():
    lanes = alone()
    for _ in range(16):
        record = choose(lanes, "block 0 in 4 s")[0]
    assert record["height"] == lanes.config.cruise and record["touches"] == 0
    gap = record["r_V_N"][0] - record["r_R_N"][0, 0]
    speed, reach = lanes.config.speed, lanes.config.robot_radius + lanes.config.aircraft_radius
    lag = reach + speed * (4.0 + 3.0 + LEAD) - gap  # behind an aim that moves with the robot
    assert 0.0 <= lag < speed * DAMPING / STIFFNESS


def test_a_landing_far_beside_is_given_up():
    record = serve(alone(landing_sigma=1.5), "tap 0")
    assert record["touches"] + record["aborts"] == 1


def test_a_look_flies_over_a_track_and_a_place_is_flown_to():
    lanes = alone()
    for _ in range(20):
        record = choose(lanes, "look at 0")[0]
    assert np.hypot(*(record["r_V_N"] - record["r_R_N"][0])) < 1.5
    for _ in range(20):
        record = choose(lanes, "go to place 0")[0]
    assert record["r_V_N"] == pytest.approx([-20 / 3, -20 / 3], abs=0.05)


def test_the_aircraft_keeps_its_limits():
    lanes = alone()
    fastest = 0.0
    for k in range(200):
        before = lanes.records["v_V_N"][0].copy()
        v = choose(lanes, f"go to place {8 * (k // 20 % 2)}")["v_V_N"][0]
        fastest = max(fastest, float(np.hypot(*v)))
        assert np.hypot(*(v - before)) <= lanes.config.a_max * lanes.config.dt + 1e-9
    assert 0.95 * lanes.config.v_max < fastest <= lanes.config.v_max * 1.02


# rules and score


@pytest.mark.parametrize("crossing, out", [("centre", 10.01), ("whole", 10.19), ("margin", 10.51)])
def test_when_a_line_is_crossed(crossing, out):
    for north, fate in ((out - 0.02, ACTIVE), (out, GOALED)):
        lanes = alone(crossing=crossing, tick=0.01, dt=0.01, camera_every=0.01)
        moved = lanes.snapshot()
        moved["r_R_N"][0, 0] = north - lanes.config.speed * 0.01, 0.0
        lanes.restore(moved)
        assert choose(lanes, "hover")["fate"][0, 0] == fate


@pytest.mark.parametrize("only, fate", [("no", GOALED), ("yes", REMOVED)])
def test_an_accidental_crossing_may_not_count(only, fate):
    lanes = alone(count_only_touched=only)
    moved = lanes.snapshot()
    moved["r_R_N"][0, 0] = 9.99, 0.0
    lanes.restore(moved)
    record = choose(lanes, "hover")[0]
    assert record["fate"][0] == fate
    assert record["outcome"] == (Outcome.SUCCESS if fate == GOALED else Outcome.MISS)


def test_the_cost_is_what_lacks_to_the_best_score():
    records = fly("paper-rule", range(100_000, 100_020))
    points = 2.0 * records["goaled"] - records["removed"] - 0.1 * records["t"] / 60.0
    assert records["total_cost"] == pytest.approx(SCORE - points, abs=1e-9)
    assert records["goaled"] + records["removed"] + records["remained"] == pytest.approx(
        np.full(20, 10.0)
    )


def test_doing_nothing_herds_nobody():
    records = fly("zero", range(100_000, 100_060))
    assert not (records["goaled"] >= 7).any()
    assert 0.1 < records["goaled"].mean() < 0.8 and 0.5 < records["removed"].mean() < 1.6


def test_the_index_policy_herds_all_that_success_needs():
    records = fly("index", range(100_000, 100_020))
    assert (records["outcome"] == Outcome.SUCCESS).all()
    assert records["goaled"].mean() > 9.0 and (records["t_success"] < 600.0).all()


@pytest.mark.parametrize("limit, outcome", [(0, Outcome.RUNNING), (1, Outcome.COLLISION)])
def test_poles_may_end_the_run(limit, outcome):
    lanes = lanes_of(pole_limit=limit)
    low = lanes.snapshot()
    low["height"], low["stage"] = 1.0, 3.0
    low["r_V_N"][0] = low["aim_N"][0] = low["r_R_N"][0, ROBOTS + 3]
    lanes.restore(low)
    record = choose(lanes, "hover")[0]
    assert record["pole_contacts"] == 1 and record["outcome"] == outcome


# what the camera tells


def test_fresh_tracks_are_where_the_robots_are():
    config = override(SCENARIOS["firmware"], {"arena": "kinematic"})
    lanes = Lanes(TASK, config, 30)
    lanes.reset(range(30))
    error = []
    for _ in range(6):
        lanes.step(np.zeros(30, np.int64))
    for record in lanes.records:
        fresh = (record["track_status"] == 1) & (record["track_age"] < 0.2)
        for place in record["track_r_N"].reshape(-1, 2)[fresh]:
            error.append(np.hypot(*(record["r_R_N"][:ROBOTS] - place).T).min())
    assert len(error) > 30
    assert np.sqrt(np.mean(np.square(error))) < 0.06


def test_without_a_camera_nobody_is_tracked():
    lanes = lanes_of(estimator="camera", p_detect=0.0, false_detections=0.0)
    for _ in range(10):
        record = choose(lanes, "hover")[0]
    assert not record["track_status"].any()
    assert np.flatnonzero(record["allowed"]).tolist() == [0, *range(71, 80)]


# velocity set-points


def test_set_points_are_flown_and_land():
    lanes = lanes_of(action_mode="velocity", dt=0.2)
    for _ in range(20):
        lanes.step(np.array([[1.0, 0.0, -1.0]], np.float32))
    assert lanes.records["v_V_N"][0] == pytest.approx([2.13, 0.0])
    for _ in range(20):
        lanes.step(np.array([[0.0, 0.0, 1.0]], np.float32))
    assert lanes.records["height"][0] == 0.0 and not lanes.records["v_V_N"].any()
    for _ in range(20):
        lanes.step(np.array([[0.0, 0.0, -1.0]], np.float32))
    assert lanes.records["height"][0] == lanes.config.cruise


# teams


def test_aircraft_of_a_team_keep_apart_and_split_the_robots():
    config = override(SCENARIOS["firmware"], TRUTH | {"aircraft": 3})
    lanes = Lanes(TASK, config, 3)
    lanes.reset([3])
    policy, closest, served = load("index", TASK, config).policy, math.inf, []
    for _ in range(250):
        lanes.step(policy.predict(lanes.rows)[0])
        r, high = lanes.records["r_V_N"], lanes.records["height"] > 1.0
        for i, j in ((0, 1), (0, 2), (1, 2)):
            if high[i] and high[j]:
                closest = min(closest, float(np.hypot(*(r[i] - r[j]))))
        down = lanes.records["stage"] == 1.0
        served.append(len(set(lanes.records["target"][down])) == down.sum())
    assert closest > 0.4
    assert np.mean(served) > 0.95
    assert (lanes.records["touches"] > 0).all()
    assert len(set(lanes.records["total_cost"])) == 1


def test_a_busy_aircraft_may_only_go_on():
    lanes = lanes_of(2, aircraft=2)
    names = ("tap 0", "hover")
    for _ in range(100):
        choose(lanes, *names)
        if lanes.records["stage"][0] != 0.0:
            break
        names = tuple(
            n if lanes.records["allowed"][0, CHOICES.index(n)] else "hover" for n in names
        )
    assert np.flatnonzero(lanes.records["allowed"][0]).tolist() == [0]
    assert lanes.records["allowed"][1].sum() > 1


# bad input


@pytest.mark.parametrize(
    "settings, message",
    [
        ({"robots": 11}, "out of range: robots=11"),
        ({"obstacles": 5}, "out of range: obstacles=5"),
        ({"start_circle": 0.3}, r"need a circle from 0.566 to .* write start_circle=1"),
        ({"start_circle": 4.9}, "to start apart from each other"),
        ({"t_f": -1.0}, "out of range: t_f=-1"),
        ({"dwell": -0.1}, "out of range: dwell=-0.1"),
        ({"patience": -1.0}, "out of range: patience=-1"),
        ({"noise_time": -1.0}, "out of range: noise_time=-1"),
        ({"dt": 0.07}, "out of range: dt=0.07"),
        ({"aircraft": 5}, "out of range: aircraft=5"),
        ({"goal_count": 8, "robots": 7}, "out of range: goal_count=8"),
    ],
)
def test_what_no_arena_holds_is_refused(settings, message):
    with pytest.raises(ValueError, match=message):
        gym.make("visenvs/Herding-v0", **settings)


def test_a_forbidden_choice_is_refused_and_nothing_moves():
    lanes = lanes_of(scenario="paper")
    before = lanes.snapshot().tobytes()
    with pytest.raises(ValueError, match="a choice that may be taken"):
        choose(lanes, "tap 0")
    assert lanes.snapshot().tobytes() == before


def test_a_velocity_that_is_no_number_is_refused():
    lanes = lanes_of(action_mode="velocity", dt=0.2)
    with pytest.raises(ValueError, match="must be finite and within"):
        lanes.step(np.array([[np.nan, 0.0, 0.0]], np.float32))


@pytest.mark.parametrize("arena", ["pymunk", "kinematic"])
@pytest.mark.parametrize("value", [1e12, np.nan, np.inf])
def test_an_arena_that_blows_up_has_diverged(arena, value):
    lanes = lanes_of(estimator="camera", arena=arena)
    bad = lanes.snapshot()
    bad["r_R_N"][0, 3, 0] = value
    if value == 1e12:
        bad["heading"][0, :] = np.inf
    lanes.restore(bad)
    record = choose(lanes, "hover")[0]
    assert record["outcome"] == Outcome.DIVERGED
