"""What `cones` adds to the row: passages, their uncertainty, and aiming points."""

import numpy as np
import pytest

from visenvs.core.config import override
from visenvs.core.lanes import Lanes
from visenvs.core.registry import load_task

TASK = load_task("visenvs/Avoidance-v0")
ONE = {
    "scene": "fixed",
    "obstacles": 1,
    "waypoint": (100.0, 0.0, 0.0),
    "obstacle_x": (60.0, 0, 0, 0, 0, 0),
    "radius": (8.0, 0, 0, 0, 0, 0),
}
FIELDS = ("pass_O_N", "t_pass_O", "gap_O", "sigma_gap_O", "aim_O_N", "t_aim_O")


def told(scenario="random", seeds=(1,), **changes):
    """Lanes at their start, and what their rows tell in SI."""
    config = override(TASK.scenarios[scenario], {"observation": "cones"} | changes)
    lanes = Lanes(TASK, config, len(seeds))
    lanes.reset(list(seeds))
    return lanes, lanes.task.observation.unpack(lanes.rows)


@pytest.mark.kernel
def test_a_passage_by_hand():
    """At 10 m/s past a sphere 60 m ahead and 3 m to the right: in 6 s, 5 m inside."""
    _, row = told(**ONE, estimator="truth", obstacle_y=(3.0, 0, 0, 0, 0, 0))
    assert row["t_pass_O"][0, 0] == pytest.approx(6.0)
    assert row["pass_O_N"][0, :3] == pytest.approx([0.0, 3.0, 0.0], abs=1e-5)
    assert row["gap_O"][0, 0] == pytest.approx(-5.0)
    aim, centre = row["aim_O_N"][0, :3], np.array([60.0, 3.0, 0.0])
    assert np.linalg.norm(aim - centre) == pytest.approx(8.0, rel=1e-5)
    assert aim @ (aim - centre) == pytest.approx(0.0, abs=1e-3)
    assert aim[1] < 0.0  # on the side where the vehicle is
    assert row["t_aim_O"][0, 0] == pytest.approx(aim[0] / 10.0, rel=1e-5)
    assert row["sigma_gap_O"][0, 0] == 0.0
    for name in FIELDS:
        places = row[name].reshape(6, -1)
        assert not places[1:].any()


@pytest.mark.kernel
def test_behind_the_vehicle_nothing_is_to_come():
    lanes, _ = told(**ONE, estimator="truth", obstacle_y=(9.0, 0, 0, 0, 0, 0))
    for _ in range(130):
        lanes.step(np.zeros((1, 3), np.float32))
    row = lanes.task.observation.unpack(lanes.rows)
    assert row["pass_O_N"][0, :3] == pytest.approx([-5.0, 9.0, 0.0], abs=1e-4)
    assert row["gap_O"][0, 0] == pytest.approx(np.hypot(5.0, 9.0) - 8.0)
    assert not row["t_pass_O"].any() and not row["aim_O_N"].any() and not row["t_aim_O"].any()


@pytest.mark.parametrize("scenario", ["random", "moving"])
def test_a_straight_flight_passes_as_it_was_told(scenario):
    lanes, row = told(scenario, range(30), estimator="truth")
    gap, slot = row["gap_O"], row["slot_O"].round().astype(int)
    while not lanes.done.all():
        lanes.step(np.zeros((30, 3), np.float32))
    for record, told_gap, owner in zip(lanes.records, gap, slot, strict=True):
        n = record["count"]
        passed = record["closest"][owner[:n]] - record["radius"][owner[:n]]
        assert passed == pytest.approx(told_gap[:n], abs=0.1)  # a step is half a metre


@pytest.mark.parametrize("scenario", ["random", "moving"])
def test_its_deviation_is_that_of_states_drawn_from_the_filters(scenario):
    """To first order: the obstacle is far aside against its deviation."""
    changes = {"p_false": 0.0, "p_detect": 1.0, "range_error": 0.02, "sigma_angle": 0.001}
    seeds = range(5)
    lanes, row = told(scenario, seeds, **changes, offset=0.9, obstacles=1)
    rng = np.random.default_rng(0)
    for i in seeds:
        record, slot = lanes.records[i], int(row["slot_O"][i, 0].round())
        mean = np.concatenate([record["rhat_OV_N"][0], record["vhat_O_N"][0]])
        P = np.zeros((6, 6))
        P[:3, :3] = record["tracks"]["cov"][slot]
        if scenario == "moving":
            P = 0.01 * record["P_O"][slot]  # a tenth of the deviations
        draws = rng.multivariate_normal(mean, P, 20_000)
        X, W = draws[:, :3], record["v_V_N"] - draws[:, 3:]
        t = np.sum(X * W, axis=1) / np.sum(W * W, axis=1)
        gap = np.linalg.norm(X - t[:, None] * W, axis=1)
        scale = 0.1 if scenario == "moving" else 1.0
        assert gap.std() == pytest.approx(scale * row["sigma_gap_O"][i, 0], rel=0.05)


@pytest.mark.kernel
def test_without_being_asked_for_they_are_neither_told_nor_worked_out():
    lanes = Lanes(TASK, TASK.scenarios["random"], 1)
    lanes.reset([1])
    assert not set(FIELDS) & set(lanes.task.observation.names)
    assert not any(lanes.records[name].any() for name in FIELDS)
