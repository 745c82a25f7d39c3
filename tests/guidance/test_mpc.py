"""Receding-horizon control: its gradient, its limits, and flights past obstacles."""

import numpy as np
import pytest

from visenvs.guidance import pn
from visenvs.guidance.lq import cost_to_go
from visenvs.guidance.mpc import STEPS, cost, gradient, improve, potential

pytestmark = pytest.mark.kernel

WAYPOINT, V = np.array([80.0, 0.0, 0.0]), np.array([10.0, 0.5, -0.3])
OBSTACLES, RADII = [[20.0, -5.0, 5.0], [50.0, 5.0, -5.0]], [10.0, 10.0]
H, REST = 0.2, 3.0


def scratch():
    return np.zeros((STEPS + 1, 6)), np.zeros(6), np.zeros((5, STEPS, 3))


def test_the_gradient_is_that_of_the_cost(air):
    """Against fourth-order central differences, with obstacles that move."""
    path, adjoint, _ = scratch()
    cfg = air.settings()
    row = air.belief(WAYPOINT, V, OBSTACLES, RADII, velocities=[[1.0, 0.5, 0.0], [-2.0, 0.0, 1.0]])
    plan, out = np.random.default_rng(0).normal(size=(STEPS, 3)), np.empty((STEPS, 3))

    def value(x):
        return cost(x, row[0], cfg[0], H, REST, path)

    value(plan)
    gradient(plan, row[0], cfg[0], H, REST, path, adjoint, out)
    for k in (0, 7, STEPS - 1):
        for i in range(3):
            e = np.zeros((STEPS, 3))
            e[k, i] = 1e-3
            slope = 8 * (value(plan + e) - value(plan - e)) - value(plan + 2 * e)
            slope = (slope + value(plan - 2 * e)) / 12e-3
            assert slope == pytest.approx(out[k, i], rel=1e-6, abs=1e-6 * np.abs(out).max())


def test_the_potential_begins_on_the_sphere_and_falls_with_distance():
    q = np.linspace(0.0, 1.5, 200)
    values = np.array([potential(x)[0] for x in q])
    assert not values[q >= 1.0].any()
    assert (np.diff(values[q < 1.0]) < 0.0).all()
    for x in (0.1, 0.7, 0.99):
        slope = (potential(x + 1e-5)[0] - potential(x - 1e-5)[0]) / 2e-5
        assert potential(x)[1] == pytest.approx(slope, rel=1e-6)


def test_without_obstacles_the_best_plan_is_the_terminal_law(air):
    """Held commands are the only difference, and what the search leaves unfinished."""
    path, adjoint, work = scratch()
    goal = np.array([80.0, 20.0, -9.0])
    row, cfg = air.belief(goal, V, [], []), air.settings()
    plan, exact = np.zeros((STEPS, 3)), np.empty(3)
    improve(plan, row[0], cfg[0], H, REST, path, adjoint, work)
    found = cost(plan, row[0], cfg[0], H, REST, path)
    least = cost_to_go(goal, V, STEPS * H + REST, cfg["s_x"][0], 0.0)
    assert least < found < 1.01 * least
    pn.command(goal, V, 8.0, exact)
    assert np.abs(plan[0] - exact).max() < 0.1 * np.abs(exact).max()


def test_with_three_axes_it_only_turns(air):
    path, adjoint, work = scratch()
    row = air.belief(WAYPOINT, V, OBSTACLES, RADII)
    plan = np.ones((STEPS, 3))
    improve(plan, row[0], air.settings(lateral=0)[0], H, REST, path, adjoint, work)
    assert np.abs(plan @ V).max() < 1e-12
    assert np.abs(plan).max() > 0.1


def test_a_plan_keeps_the_limits(air):
    path, adjoint, work = scratch()
    row, cfg = air.belief([20.0, 9.0, 0.0], V, [[10.0, 1.0, 0.0]], [6.0]), air.settings(a_max=2.0)
    plan = np.zeros((STEPS, 3))
    improve(plan, row[0], cfg[0], 0.07, 0.25, path, adjoint, work)
    assert np.linalg.norm(plan, axis=1).max() == pytest.approx(2.0)
    assert not plan[:, 0].any()


@pytest.mark.parametrize("lateral", [0, 1])
def test_it_flies_around_what_is_in_the_way(air, lateral):
    cfg = air.settings(dt=0.05, lateral=lateral)
    flight = air.fly("mpc", OBSTACLES, RADII, WAYPOINT, [10.0, 0.0, 0.0], cfg)
    assert (flight.closest > 9.9).all()
    assert flight.effort < 60.0
    assert flight.miss < 0.2


def test_an_obstacle_that_crosses_is_avoided_where_it_will_be(air):
    cross = {"obstacles": [[40.0, 15.0, 1.0]], "velocities": [[0.0, -4.0, 0.0]], "radii": [8.0]}
    cross |= {"waypoint": WAYPOINT, "V": [10.0, 0.0, 0.0], "cfg": air.settings(dt=0.05)}
    assert air.fly("mpc", **cross).closest[0] > 7.9


def test_rows_do_not_see_each_other_and_all_commands_are_finite(air):
    rng, cfg = np.random.default_rng(1), air.settings(dt=0.05)
    for k in range(10):
        places = rng.normal(size=(6, 3)) * 20.0
        places[0] *= k % 3
        row = air.belief(WAYPOINT, 3.0 * V * (k % 4 > 0), places, rng.uniform(1, 20, 6), t_go=8.0)
        memory = air.fresh("mpc", cfg)
        assert np.isfinite(air.decided("mpc", row, cfg, memory)).all()
        assert np.isfinite(memory).all()
        row["t_go"] = 0.0
        assert np.isfinite(air.decided("mpc", row, cfg, memory)).all()
