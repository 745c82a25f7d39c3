"""Least time and effort: the trade-off found by search, its limit, and slowing down."""

import math

import numpy as np
import pytest

from agents.registry import load, names
from visenvs.core.lanes import Lanes
from visenvs.core.outcome import Outcome
from visenvs.core.registry import load_task
from visenvs.guidance.minimum_time import time_to_go
from visenvs.guidance.policy import NotApplicable

TASK = load_task("visenvs/Avoidance-v0")
NO_LIMIT, ALL = 1e9, 1e9  # of the acceleration; a weight of time beside which effort is nothing


def points():
    rng = np.random.default_rng(5)
    return [rng.normal(size=(2, 3)) * [[40.0], [12.0]] for _ in range(40)]


@pytest.mark.kernel
@pytest.mark.parametrize("s_time", [0.5, 20.0])
def test_the_time_is_the_first_minimum_of_what_passing_costs(s_time):
    for X, V in points():
        T = time_to_go(X, V, s_time, NO_LIMIT)
        grid = T * np.linspace(0.02, 1.05, 4000)
        effort = 1.5 * np.sum((X - np.outer(grid, V)) ** 2, axis=1) / grid**3
        falling = np.diff(s_time * grid + effort) < 0.0
        assert falling[grid[1:] < T].all() and not falling[grid[:-1] > T].any()


@pytest.mark.kernel
def test_nothing_within_the_limit_is_there_earlier():
    """Constant thrust of full length reaches |X - V T| = a T^2 / 2, and nothing reaches further."""
    for X, V in points():
        T = time_to_go(X, V, ALL, 10.0)
        short = np.linalg.norm(X - T * V)
        assert short == pytest.approx(0.5 * 10.0 * T * T, rel=1e-9)
        for t in np.linspace(0.0, T, 300)[1:-1]:
            assert np.linalg.norm(X - t * V) > 0.5 * 10.0 * t * t


def flight(air, cfg, waypoint=(80.0, 20.0, 0.0), dt=0.01):
    """Time, effort, least and largest command of a flight without obstacles."""
    waypoint, x, V, lengths = np.array(waypoint), np.zeros(3), np.array([10.0, 0.0, 0.0]), []
    while waypoint[0] - x[0] > 0.01 * dt * V[0]:
        row = air.belief(waypoint - x, V, [], [], t_go=(waypoint[0] - x[0]) / V[0])
        a = air.decided("cone-time", row, cfg)
        a *= min(1.0, cfg["a_max"][0] / np.linalg.norm(a))
        x, V = x + dt * (V + 0.5 * dt * a), V + dt * a
        lengths.append(np.linalg.norm(a))
    assert np.linalg.norm((waypoint - x)[1:]) < 0.2
    return dt * len(lengths), 0.5 * dt * np.square(lengths).sum(), min(lengths), max(lengths)


@pytest.mark.kernel
def test_a_flight_costs_what_the_plan_says(air):
    """Replanned at every step, time and effort come to the least cost of the first plan."""
    X, V = np.array([80.0, 20.0, 0.0]), np.array([10.0, 0.0, 0.0])
    T = time_to_go(X, V, 20.0, NO_LIMIT)
    time, effort, _, most = flight(air, air.settings(lateral=0, s_time=20.0, a_max=100.0))
    assert time == pytest.approx(T, abs=0.02)
    assert effort == pytest.approx(1.5 * np.sum((X - T * V) ** 2) / T**3, rel=0.02)
    assert most == pytest.approx(3.0 * np.linalg.norm(X - T * V) / T**2, rel=1e-3)


@pytest.mark.kernel
def test_where_only_time_counts_the_thrust_is_full_all_the_way(air):
    X, V = np.array([80.0, 20.0, 0.0]), np.array([10.0, 0.0, 0.0])
    time, _, least, _ = flight(air, air.settings(lateral=0, s_time=ALL, a_max=10.0))
    assert time == pytest.approx(time_to_go(X, V, ALL, 10.0), abs=0.02)
    assert least == pytest.approx(10.0, rel=1e-6)


@pytest.mark.kernel
@pytest.mark.parametrize(("ahead", "slower"), [(20.0, True), (60.0, False)])
def test_an_obstacle_that_is_seen_late_slows_the_vehicle_down(air, ahead, slower):
    cfg = air.settings(lateral=0, s_time=20.0, a_max=10.0, t_critical=10.0)
    row = air.belief([100.0, 0.0, 0.0], [15.0, 0.0, 0.0], [[ahead, 1.0, 0.0]], [9.0])
    a = air.decided("cone-time", row, cfg)
    assert (a[0] < 0.0) == slower
    assert a[1] < 0.0


@pytest.mark.kernel
def test_a_moving_obstacle_is_passed_as_one_at_rest_in_its_own_frame(air):
    cfg = air.settings(lateral=0, s_time=20.0, a_max=10.0)
    X, V, wind = [30.0, 2.0, 0.0], np.array([10.0, 0.0, 0.0]), np.array([2.0, -1.0, 0.5])
    still = air.decided("cone-time", air.belief([90.0, 0, 0], V, [X], [5.0]), cfg)
    row = air.belief([90.0, 0, 0], V + wind, [X], [5.0], velocities=[wind], t_go=9.0)
    assert air.decided("cone-time", row, cfg) == pytest.approx(still, rel=1e-9)


def test_it_flies_where_time_costs_and_nowhere_else():
    with pytest.raises(NotApplicable, match=r"cone-time needs s_time > 0"):
        load("cone-time", TASK, TASK.scenarios["random"])
    assert "cone-time" not in names(TASK)
    assert "cone-time" in names(TASK, TASK.scenarios["minimum-time"])


def test_it_pays_to_hurry():
    """Against a law that keeps its speed, on the same scenes."""
    config, seeds = TASK.scenarios["minimum-time"], 200
    flown = {}
    for law in ("cone-time", "dgg"):
        policy, lanes, state = load(law, TASK, config).policy, Lanes(TASK, config, seeds), None
        lanes.reset(list(range(seeds)))
        while not lanes.done.all():
            actions, state = policy.predict(lanes.rows, state)
            lanes.step(np.asarray(actions, np.float32))
        flown[law] = lanes.records
    ours, theirs = flown["cone-time"], flown["dgg"]
    assert np.median(ours["total_cost"]) < 0.7 * np.median(theirs["total_cost"])
    assert ours["total_cost"].mean() < 0.8 * theirs["total_cost"].mean()
    assert (ours["outcome"] == Outcome.SUCCESS).mean() > 0.95
    assert theirs["flight_time"].mean() > 1.5 * ours["flight_time"].mean()
    assert math.isclose(ours["peak_acceleration"].max(), config.a_max, rel_tol=1e-5)
