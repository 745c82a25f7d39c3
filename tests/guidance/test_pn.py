"""Proportional navigation to a point."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from visenvs.core.registry import laws
from visenvs.dynamics.point_mass import move
from visenvs.guidance.lq import gains
from visenvs.guidance.pn import command

pytestmark = pytest.mark.kernel

BELIEF = np.dtype([("rhat_TV_N", "f8", (3,)), ("v_V_N", "f8", (3,)), ("t_go", "f8")])


def flown(X, V, T, steps):
    """Miss and commands of a flight under truth, each command held for a step."""
    X, V, dt, commands = X.copy(), V.copy(), T / steps, np.empty((steps, 3))
    for k in range(steps):
        command(X, V, T - k * dt, commands[k])
        moved = np.zeros(3)
        move(moved, V, commands[k], dt)
        X -= moved
    return np.linalg.norm(X), commands


@pytest.mark.parametrize("seed", range(5))
def test_it_hits_a_stationary_point_whatever_the_velocity(seed):
    rng = np.random.default_rng(seed)
    X, V, T = rng.uniform(-40, 40, 3), rng.uniform(-10, 10, 3), rng.uniform(5, 20)
    coarse, fine = flown(X, V, T, 100)[0], flown(X, V, T, 400)[0]
    reach = np.linalg.norm(X - V * T)  # the miss without any control
    assert coarse < 1e-3 * reach
    assert fine < coarse / 3  # held commands are the only error


@pytest.mark.parametrize("seed", range(5))
def test_its_command_falls_linearly_to_zero(seed):
    """The least effort that moves the miss: a(t) = 3 (X - V T) (T - t) / T^3."""
    rng = np.random.default_rng(seed)
    X, V, T = rng.uniform(-40, 40, 3), rng.uniform(-10, 10, 3), 10.0
    _, commands = flown(X, V, T, 400)
    t = np.arange(400) * T / 400
    expected = 3 * np.outer(T - t, X - V * T) / T**3
    assert np.abs(commands - expected).max() < 0.02 * np.abs(expected).max()


@given(st.floats(1e-2, 1e2))
def test_it_is_the_terminal_law_for_an_infinite_price_of_miss_and_free_velocity(T):
    """(4.12) tends to (3.26) for s_x -> infinity, s_v = 0."""
    K_X, K_V = gains(T, 1e15 / T**3, 0.0)
    a = np.empty(3)
    command(np.array([1.0, 0.0, 2.0]), np.array([0.0, 1.0, 3.0]), T, a)
    assert a == pytest.approx([K_X, -K_V, 2 * K_X - 3 * K_V], rel=1e-12)


def test_the_law_reads_the_belief_and_waits_at_least_one_step():
    beliefs, commands = np.zeros(2, BELIEF), np.zeros((2, 3))
    beliefs["rhat_TV_N"], beliefs["v_V_N"], beliefs["t_go"] = (
        [[1, 2, 3], [4, 5, 6]],
        [[1, 0, 0], [0, 1, 0]],
        [2.0, 0.0],
    )
    laws()["pn"].decide(beliefs, np.array([(0.5,)], [("dt", "f8")]), commands)
    assert commands[0] == pytest.approx([3 * (1 / 4 - 1 / 2), 1.5, 2.25], rel=1e-14)
    assert commands[1] == pytest.approx([48, 60 - 6, 72], rel=1e-14)
