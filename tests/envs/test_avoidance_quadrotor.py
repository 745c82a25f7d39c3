"""Avoidance by a quadrotor: it tilts for what is commanded, and the camera tilts with it."""

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tests.envs.test_avoidance import flown_by
from visenvs.core.config import override, to_record
from visenvs.core.lanes import Lanes
from visenvs.core.registry import load_task
from visenvs.core.units import GRAVITY
from visenvs.envs._avoidance_config import AvoidanceConfig
from visenvs.envs._avoidance_images import camera, look, picture

TASK = load_task("visenvs/Avoidance-v0")
BARE = {"p_detect": 1.0, "p_false": 0.0, "estimator": "truth"}
ONE = {
    "scene": "fixed",
    "obstacles": 1,
    "obstacle_x": (100.0, 0, 0, 0, 0, 0),
    "radius": (8.0, 0, 0, 0, 0, 0),
}


def started(seeds=(1,), scenario="quadrotor", **changes):
    lanes = Lanes(TASK, override(TASK.scenarios[scenario], changes), len(seeds))
    lanes.reset(list(seeds))
    return lanes


def command(lanes, a_N):
    """One step under an acceleration, m/s^2."""
    rows = np.tile(np.array(a_N) / lanes.config.a_max, (lanes.count, 1))
    lanes.step(rows.astype(np.float32))
    return lanes.records


def attitudes(record):
    """C_CN from the record's quaternion, by SciPy."""
    w, x, y, z = record["q_V"]
    return Rotation.from_quat([x, y, z, w]).as_matrix().T


# how it flies


def test_a_fast_attitude_loop_flies_as_a_point_mass():
    """Twice the bandwidth, half the distance between the two flights."""

    def path(**changes):
        lanes = started(**BARE, **ONE, lateral=0, **changes)
        a = ([3.0 * math.sin(0.1 * k), 5.0 * math.cos(0.07 * k), -2.0] for k in range(60))
        return np.array([command(lanes, each)["r_V_N"][0].copy() for each in a])

    mass, off = path(dynamics="point_mass"), []
    for bandwidth in (50.0, 100.0, 200.0):
        substeps = round(1.6 * bandwidth)
        fast = path(bandwidth=bandwidth, substeps=substeps, rate_max=10.0 * bandwidth)
        off.append(np.abs(fast - mass).max())
    assert off[0] < 0.6
    assert off[0] / off[1] == pytest.approx(2.0, rel=0.1)
    assert off[1] / off[2] == pytest.approx(2.0, rel=0.1)


@pytest.mark.kernel
def test_a_command_arrives_later_by_twice_the_damping_over_the_bandwidth():
    """The mean delay of the second-order loop: so much velocity is missing in the end."""
    lanes = started(**BARE, **ONE, substeps=50, bandwidth=10.0, damping=0.8)
    for _ in range(40):
        record = command(lanes, [0.0, 1.0, 0.0])[0]
    assert record["a_V_N"] == pytest.approx([0.0, 1.0, 0.0], abs=1e-4)
    assert record["v_V_N"][1] == pytest.approx(40 * 0.05 - 2 * 0.8 / 10.0, rel=0.005)


@pytest.mark.kernel
def test_it_starts_level_and_without_a_command_stays_so():
    lanes = started(**BARE)
    for _ in range(20):
        record = lanes.records[0]
        assert record["q_V"].tolist() == [1.0, 0.0, 0.0, 0.0]
        assert not record["omega_V"].any()
        command(lanes, [0.0, 0.0, 0.0])
    assert lanes.records["v_V_N"][0] == pytest.approx([10.0, 0.0, 0.0], abs=1e-12)


@pytest.mark.kernel
def test_a_vehicle_that_keeps_its_speed_rolls_and_does_not_pitch():
    lanes, rng, rolled = started(**BARE), np.random.default_rng(0), 0.0
    for _ in range(60):
        record = command(lanes, rng.uniform(-7.0, 7.0, 3))[0]
        C = attitudes(record)
        assert C[0] == pytest.approx([1.0, 0.0, 0.0], abs=1e-12)
        assert record["v_V_N"][0] == pytest.approx(10.0, abs=1e-12)
        rolled = max(rolled, abs(math.atan2(C[1, 2], C[2, 2])))
    assert rolled > 0.3


@pytest.mark.kernel
def test_what_was_reached_is_told_and_charged():
    lanes, rng, charged = started(**BARE, lateral=0), np.random.default_rng(1), 0.0
    v = lanes.records["v_V_N"][0].copy()
    for _ in range(30):
        record = command(lanes, rng.uniform(-5.0, 5.0, 3))[0]
        reached, v = (record["v_V_N"] - v) / 0.05, record["v_V_N"].copy()
        assert record["a_V_N"] == pytest.approx(reached, abs=1e-10)
        charged += 0.5 * 0.05 * reached @ reached
    assert record["control_cost"] == pytest.approx(charged)
    assert record["cost_control"] == pytest.approx(0.5 * 0.05 * reached @ reached)


@pytest.mark.kernel
def test_it_cannot_fall_faster_than_with_the_least_thrust():
    lanes = started(**BARE)
    for _ in range(20):
        record = command(lanes, [0.0, 0.0, 10.0])[0]
    assert record["a_V_N"][2] == pytest.approx(0.8 * GRAVITY)


# what its camera sees


@pytest.mark.kernel
@pytest.mark.parametrize(("sensor", "half_width"), [("image", 0.5), ("angles", 0.5)])
def test_sightings_are_of_the_tilted_camera(sensor, half_width):
    """At the edge some are lost by the tilt, and others come into the picture."""
    place = {
        "obstacles": 3,
        "obstacle_x": (100.0, 100.0, 90.0, 0, 0, 0),
        "obstacle_y": (30.0, -38.0, 2.0, 0, 0, 0),
        "obstacle_z": (-30.0, 2.0, 38.0, 0, 0, 0),
        "radius": (8.0, 8.0, 8.0, 0, 0, 0),
    }
    changes = {**BARE, **ONE, **place, "sensor": sensor, "half_width": half_width}
    lanes, lost, gained = started(**changes, lateral=0, sigma_angle=1e-3), 0, 0
    for k in range(100):
        a = [4.0 * math.sin(0.1 * k), 8.0 * math.cos(0.08 * k), 2.0 * math.sin(0.17 * k)]
        record = command(lanes, a)[0]
        C, seen = attitudes(record), []
        for r in record["r_O_N"][:3] - record["r_V_N"]:
            level, tilted = measured(r, sensor), measured(C @ r, sensor)
            inside = (C @ r)[0] > 0.5 and np.abs(tilted).max() < half_width
            lost += np.abs(level).max() < half_width and not inside
            gained += np.abs(level).max() > half_width and inside
            seen += [tilted] if inside else []
        assert record["sighted"] == len(seen)
        if seen:
            assert record["sightings"][: len(seen)] == pytest.approx(np.array(seen), abs=6e-3)
    assert lost > 10 and gained > 10


def measured(r, sensor):
    """Image point or angles of a position in axes of the camera."""
    X, Y, Z = r
    if sensor == "image":
        return np.array([Y / X, Z / X])
    return np.array([math.atan2(Y, X), math.atan2(Z, math.hypot(X, Y))])


@pytest.mark.parametrize(
    ("estimator", "sensor"),
    [
        ("ekf", "image"),
        ("inverse-ekf", "image"),
        ("inverse-ukf", "image"),
        ("inverse-ukf", "angles"),
        ("spherical", "angles"),
        ("ekf-moving", "image"),
    ],
)
def test_filters_hold_their_covariance_as_on_a_level_camera(estimator, sensor):
    changes = {"estimator": estimator, "sensor": sensor, "p_false": 0.0, "ztest_max": 0.0}
    scenario = "moving" if estimator == "ekf-moving" else "random"
    mass, tilting = (
        flown_by("dgg", started(range(300), scenario, dynamics=dynamics, **changes))["nees_mean"]
        for dynamics in ("point_mass", "quadrotor")
    )
    assert np.median(tilting) == pytest.approx(np.median(mass), rel=0.1)
    if estimator != "spherical":  # the published one is now and then sure of the wrong place
        assert tilting.mean() == pytest.approx(mass.mean(), rel=0.1)


@pytest.mark.parametrize("law", ["dgg", "cone-pn"])
def test_laws_that_know_nothing_of_the_tilt_reach_the_waypoint(law):
    records = flown_by(law, started(range(200)))
    assert (records["outcome"] == 1).mean() >= 0.97
    assert records["miss_distance"].max() < 0.1


# on pictures


def test_the_detector_reads_the_tilted_picture():
    place = {"obstacle_y": (10.0, 0, 0, 0, 0, 0), "obstacle_z": (20.0, 0, 0, 0, 0, 0)}
    lanes = started(**ONE, **place, perception="images")
    for _ in range(8):
        record = command(lanes, [0.0, 8.0, -3.0])[0]
    config, C = to_record(lanes.config), attitudes(record)
    (sighted,) = look(lanes.records, config)
    X, Y, Z = C @ (record["r_O_N"][0] - record["r_V_N"])
    level = (record["r_O_N"][0] - record["r_V_N"])[1:] / X
    focal = camera(config[0], int(config[0]["picture"])).focal
    assert np.hypot(*(level - [Y / X, Z / X])) * focal > 5.0  # without the tilt it is elsewhere
    assert sighted["count"] == 1 and sighted["labels"][0] == 0
    assert sighted["seen"][0] == pytest.approx([Y / X, Z / X], abs=0.5 / focal)
    assert sighted["distance"][0] == pytest.approx(X, rel=0.05)


def test_the_beacon_rises_in_the_picture_as_the_camera_looks_down():
    lanes = started(**ONE, observation="pixels", obstacle_y=(90.0, 0, 0, 0, 0, 0))
    lane, config, nose = lanes.records[0].copy(), to_record(lanes.config)[0], -math.radians(20.0)
    lane["r_V_N"] = np.array(lanes.config.waypoint) - [30.0, 0.0, 0.0]
    lane["q_V"] = [math.cos(nose / 2), 0.0, math.sin(nose / 2), 0.0]
    frame = picture(lane, config, 64).astype(int)
    green = frame[..., 1] - frame[..., [0, 2]].max(axis=2) > 40
    rows, columns = np.nonzero(green)
    assert rows.mean() == pytest.approx(31.5 - 32.0 * math.tan(-nose), abs=1.0)
    assert columns.mean() == pytest.approx(31.5, abs=1.0)


def test_the_other_picture_is_the_one_of_before_as_it_was_tilted():
    lanes = started(range(2), observation="pixels", frame_before=0.15, lateral=0)
    seen = [lanes.rows.copy()]
    for k in range(8):
        command(lanes, [4.0, 6.0 * (-1) ** (k // 3), 0.0])
        seen.append(lanes.rows.copy())
    for k in range(3, 9):
        assert np.array_equal(seen[k][..., 3:], seen[k - 3][..., :3])


# what is refused


@pytest.mark.kernel
@pytest.mark.parametrize(
    "changes", [{"bandwidth": 0.0}, {"damping": 0.0}, {"rate_max": 0.0}, {"substeps": 0}]
)
def test_a_loop_without_its_numbers_is_refused(changes):
    (name,) = changes
    with pytest.raises(ValueError, match=f"out of range: {name}"):
        override(AvoidanceConfig(), changes)


@pytest.mark.kernel
@pytest.mark.parametrize("damping", [0.3, 1.0, 2.0])
def test_a_loop_that_its_integration_makes_unstable_is_refused(damping):
    """The number of parts to write is the least with which an offset dies away."""
    loop = {"dynamics": "quadrotor", "bandwidth": 200.0, "damping": damping}
    with pytest.raises(ValueError, match=r"write `substeps=\d+` or more") as caught:
        override(AvoidanceConfig(), loop)
    least = int(str(caught.value).split("substeps=")[-1].split("`")[0])
    for substeps, holds in ((least, True), (least - 1, False)):
        x = 200.0 * 0.05 / substeps
        flow = np.array([[1.0 - 2.0 * damping * x, x * x], [2.0 * damping * x - 1.0, 1.0 - x * x]])
        assert (np.abs(np.linalg.eigvals(flow)).max() < 1.0) == holds
    assert override(AvoidanceConfig(), loop | {"substeps": least}).substeps == least
    with pytest.raises(ValueError, match="unstable"):
        override(AvoidanceConfig(), loop | {"substeps": least - 1})
