"""The point mass against the matrix exponential and an ODE solver."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from visenvs.dynamics.point_mass import move, saturate

pytestmark = pytest.mark.kernel

component = st.floats(-100.0, 100.0)
vector = st.tuples(component, component, component)
duration = st.floats(1e-3, 10.0)


def moved(r, v, a, dt):
    r, v = np.array(r, float), np.array(v, float)
    move(r, v, np.array(a, float), dt)
    return r, v


@given(vector, vector, vector, duration)
def test_move_is_the_exact_zero_order_hold(r, v, a, dt):
    """exp([[F, G], [0, 0]] dt) holds the input (Van Loan 1978)."""
    O, eye = np.zeros((3, 3)), np.eye(3)
    step = expm(dt * np.block([[O, eye, O], [O, O, eye], [O, O, O]]))
    expected = step @ np.concatenate([r, v, a])
    assert np.allclose(np.concatenate(moved(r, v, a, dt)), expected[:6], rtol=1e-12, atol=1e-10)


def test_move_agrees_with_an_ode_solver_over_changing_commands():
    rng = np.random.default_rng(0)
    r, v, dt = rng.normal(size=3), rng.normal(size=3), 0.1
    state = np.concatenate([r, v])
    for a in rng.normal(0.0, 5.0, (40, 3)):
        move(r, v, a, dt)
        state = solve_ivp(
            lambda _t, x, a=a: np.concatenate([x[3:], a]), (0, dt), state, rtol=1e-11, atol=1e-12
        ).y[:, -1]
    assert np.allclose(np.concatenate([r, v]), state, rtol=1e-9)


@given(vector, vector, vector, duration, st.floats(0.0, 1.0))
def test_two_parts_of_a_step_are_the_step(r, v, a, dt, fraction):
    between = moved(r, v, a, fraction * dt)
    assert np.allclose(
        moved(*between, a, (1.0 - fraction) * dt), moved(r, v, a, dt), rtol=1e-12, atol=1e-10
    )


@given(vector, st.floats(1e-3, 1e3))
def test_saturate_shortens_and_keeps_the_direction(a, limit):
    a = np.array(a)
    out = np.empty(3)
    saturate(a, limit, out)
    length = np.linalg.norm(a)
    assert np.linalg.norm(out) == pytest.approx(min(length, limit), rel=1e-12)
    assert np.allclose(out * length, a * np.linalg.norm(out), rtol=1e-12, atol=1e-12)
    if length <= limit:
        assert np.array_equal(out, a)


def test_saturate_works_in_place():
    a = np.array([3.0, 4.0, 12.0])
    saturate(a, 6.5, a)
    assert a == pytest.approx([1.5, 2.0, 6.0], rel=1e-15)
