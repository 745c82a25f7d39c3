"""The potential that shapes rewards: minus the least cost to go, from the truth."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from agents.registry import load
from eval.rollout import rollout
from tests.toys import toys
from train.shaping import potential_of
from visenvs.core.config import override
from visenvs.core.lanes import Lanes
from visenvs.core.registry import load_task

with toys():
    CART = load_task("visenvs/Cart-v0")
TASKS = ["visenvs/Rendezvous-v0", "visenvs/Tracking2D-v0"]


def flying(env, steps=7, scenario="random", **changes):
    """Task, configuration, and lanes some steps into their episodes."""
    task = load_task(env)
    config = override(task.scenarios[scenario], changes)
    lanes = Lanes(task, config, 5)
    lanes.reset(range(5))
    rng = np.random.default_rng(2)
    for _ in range(steps):
        lanes.step(rng.uniform(-0.5, 0.5, (5, task.action.size)).astype(np.float32))
    return task, config, lanes


def riccati(T, s_x, s_v):
    """Least cost matrix of x = (X, V_target - V), F = (0 1; 0 0), G = (0, -1)', from -P' = ..."""
    F, G = np.array([[0.0, 1.0], [0.0, 0.0]]), np.array([[0.0], [-1.0]])

    def back(_, flat):
        P = flat.reshape(2, 2)
        return (F.T @ P + P @ F - P @ G @ G.T @ P).ravel()

    ends = np.diag([s_x, s_v]).ravel().astype(float)
    return solve_ivp(back, (0.0, T), ends, "LSODA", rtol=1e-10, atol=1e-12).y[:, -1].reshape(2, 2)


@pytest.mark.parametrize("env", TASKS)
def test_it_is_minus_the_cost_that_the_riccati_equation_gives(env):
    task, config, lanes = flying(env)
    for lane, found in zip(lanes.records, potential_of(task, config)(lanes.records), strict=True):
        P = riccati(lane["t_go"], config.s_x, config.s_v)
        x = np.stack([lane["r_TV_N"], -lane["v_V_N"]])
        assert found == pytest.approx(-0.5 * np.einsum("id,ij,jd->", x, P, x), rel=1e-6)


@pytest.mark.parametrize("env", TASKS)
def test_the_lq_law_on_the_truth_pays_just_that(env):
    changes = {"estimator": "truth", "dt": 0.01, "t_f": 5.0, "a_max": 1e4}
    task, config, lanes = flying(env, steps=0, **changes)
    flown = rollout(load("lq", task, config).policy, task, config, range(5))
    promised = potential_of(task, config)(lanes.records)
    assert flown.returns == pytest.approx(promised, rel=0.02)  # in steps of dt
    assert (flown.returns < promised).all()


@pytest.mark.parametrize("env", TASKS)
def test_at_the_end_it_is_the_terminal_cost(env):
    task, config, lanes = flying(env)
    lanes.records["t_go"] = 0.0
    r, v = (np.square(lanes.records[name]).sum(axis=1) for name in ("r_TV_N", "v_V_N"))
    expected = -0.5 * (config.s_x * r + config.s_v * v)
    assert potential_of(task, config)(lanes.records) == pytest.approx(expected)


def test_it_reads_the_truth_and_not_the_estimate():
    task, config, lanes = flying(TASKS[0])
    potential = potential_of(task, config)
    before = potential(lanes.records)
    lanes.records["rhat_TV_N"] += 5.0
    lanes.records["P"] *= 2.0
    assert np.array_equal(potential(lanes.records), before)
    lanes.records["r_TV_N"] += 5.0
    assert (potential(lanes.records) != before).all()


def test_tasks_with_other_costs_have_none():
    bearings = load_task("visenvs/BearingsOnly-v0")
    for task in (CART, bearings):
        assert potential_of(task, next(iter(task.scenarios.values()))) is None


def test_a_map_that_stays_as_it_is_has_no_shaped_cost():
    """What the potential gives back in a step is what the map's terms cost in it."""
    task, config, lanes = flying("visenvs/Mapping-v0", scenario="town", p_detect=0.0, p_false=0.0)
    potential = potential_of(task, config)
    lanes.records["covered"] = 1.0
    lanes.step(np.zeros((5, 4), np.float32))
    before = potential(lanes.records)
    lanes.step(np.zeros((5, 4), np.float32))
    shaped = lanes.rewards + potential(lanes.records) - before
    assert shaped == pytest.approx(np.zeros(5), abs=1e-12)
    assert (before < 0.0).all()
    lanes.records["map_error"] *= 0.5
    assert (potential(lanes.records) > before).all()


# spheres to pass


def coasting(steps, **changes):
    """Task, configuration, and lanes that have flown straight on for so many steps."""
    task = load_task("visenvs/Avoidance-v0")
    config = override(task.scenarios["random"], changes)
    lanes = Lanes(task, config, 20)
    lanes.reset(range(20))
    for _ in range(steps):
        lanes.step(np.zeros((20, 3), np.float32))
    return task, config, lanes


def test_behind_the_spheres_it_is_what_the_last_step_will_charge():
    task, config, lanes = coasting(398)
    lanes.records["closest"] *= 2.0  # as if they had been passed wide
    promised = potential_of(task, config)(lanes.records)
    lanes.step(np.zeros((20, 3), np.float32))
    lanes.step(np.zeros((20, 3), np.float32))
    assert lanes.done.all()
    assert lanes.rewards == pytest.approx(promised, rel=1e-6)
    assert lanes.records["cost_divergence"].max() > 1.0


def test_a_straight_flight_keeps_its_passages_in_mind():
    """Every sphere alone costs what LQ pays to move the closest approach to its surface."""
    task, config, lanes = coasting(20, obstacles=1)
    shaped = potential_of(task, config)(lanes.records)
    for lane, found in zip(lanes.records, shaped, strict=True):
        X = lane["r_O_N"][0] - lane["r_V_N"]
        depth = lane["radius"][0] - np.hypot(X[1], X[2])
        weight = riccati(X[0] / 10.0, config.s_violation, 0.0)[0, 0]
        assert found == pytest.approx(-0.5 * weight * depth**2, rel=1e-6)


def test_what_a_violation_has_cost_is_not_asked_for_again():
    task, config, lanes = coasting(0, obstacles=1)
    shape, paid = potential_of(task, config), np.zeros(20)
    before = shape(lanes.records)
    while not lanes.done.all():
        lanes.step(np.zeros((20, 3), np.float32))
        paid += lanes.rewards
    lanes.records["outcome"] = 0
    assert (paid < before).all()  # to dodge in time would have been cheaper
    assert shape(lanes.records) == pytest.approx(np.zeros(20), abs=1e-9)
