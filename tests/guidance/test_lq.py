"""The terminal law: closed-form gains against the thesis's matrices, and what optimal means."""

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from visenvs.core.registry import laws
from visenvs.dynamics.point_mass import move
from visenvs.guidance.lq import command, cost_to_go, gains, terminal_weight

pytestmark = pytest.mark.kernel

CASES = {
    "T": st.floats(1e-2, 1e2),
    "s_x": st.floats(1e-3, 1e6),
    "s_v": st.one_of(st.just(0.0), st.floats(1e-3, 1e6)),
}
BELIEF = np.dtype([("rhat_TV_N", "f8", (3,)), ("v_V_N", "f8", (3,)), ("t_go", "f8")])
SETTINGS = np.dtype([("dt", "f8"), ("s_x", "f8"), ("s_v", "f8")])


def product(A, B):
    return [
        [sum(a * b for a, b in zip(row, column, strict=True)) for column in zip(*B, strict=True)]
        for row in A
    ]


def generic_weight(T, s_x, s_v):
    """M = S_f (I + G S_f)^-1 of one axis in exact arithmetic; G = int e^(Fs) G G' e^(F's)."""
    T, s_x, s_v = Fraction(T), Fraction(s_x), Fraction(s_v)
    gramian = [[T**3 / 3, T**2 / 2], [T**2 / 2, T]]
    S_f = [[s_x, 0], [0, s_v]]
    (a, b), (c, d) = product(gramian, S_f)
    a, d = a + 1, d + 1
    inverse = [
        [d / (a * d - b * c), -b / (a * d - b * c)],
        [-c / (a * d - b * c), a / (a * d - b * c)],
    ]
    return product(S_f, inverse)


def generic_gains(T, s_x, s_v):
    """Row -G' e^(F'T) M e^(FT) of (4.12), G = (0, -1)': gains on relative position and velocity."""
    M = generic_weight(T, s_x, s_v)
    K = product(product([[Fraction(T), 1]], M), [[1, Fraction(T)], [0, 1]])[0]
    return float(K[0]), float(K[1])


@given(**CASES)
def test_gains_equal_the_matrix_formula(T, s_x, s_v):
    assert gains(T, s_x, s_v) == pytest.approx(generic_gains(T, s_x, s_v), rel=1e-12, abs=0)


@given(**CASES)
def test_terminal_weight_equals_the_matrix_formula(T, s_x, s_v):
    (m11, m12), (m21, m22) = generic_weight(T, s_x, s_v)
    assert m12 == m21
    assert terminal_weight(T, s_x, s_v) == pytest.approx(
        (float(m11), float(m12), float(m22)), rel=1e-12, abs=0
    )


@pytest.mark.parametrize(
    ("T", "s_x", "s_v"), [(20.0, 100.0, 10.0), (3.0, 1.0, 1.0), (0.4, 50.0, 7.0)]
)
def test_the_printed_gain_is_not_the_matrix_formula(T, s_x, s_v):
    """(4.38) prints K_X with T where T squared belongs."""
    Lam = 1 + s_x * T**3 / 3 + s_x * s_v * T**4 / 12 + s_v * T
    printed = (s_x * T + s_x * s_v / 2 * T) / Lam
    corrected = (s_x * T + s_x * s_v / 2 * T**2) / Lam
    exact = generic_gains(T, s_x, s_v)[0]
    assert corrected == pytest.approx(exact, rel=1e-12)
    assert abs(printed / exact - 1) > 0.1


@given(T=st.floats(0.1, 30.0), s_x=st.floats(0.1, 1e4), s_v=st.floats(0.0, 1e3))
def test_the_cost_matrix_solves_the_riccati_equation(T, s_x, s_v):
    """S = e^(F'T) M e^(FT) obeys (4.6) with A = 0, and S = S_f at the end."""

    def S(t):
        m11, m12, m22 = terminal_weight(t, s_x, s_v)
        Phi = np.array([[1.0, t], [0.0, 1.0]])
        return Phi.T @ np.array([[m11, m12], [m12, m22]]) @ Phi

    F, G = np.array([[0.0, 1.0], [0.0, 0.0]]), np.array([[0.0], [-1.0]])
    now, h = S(T), 1e-4 * T
    terms = now @ F, F.T @ now, -now @ G @ G.T @ now
    rate = -(-S(T + 2 * h) + 8 * S(T + h) - 8 * S(T - h) + S(T - 2 * h)) / (12 * h)  # d/dt = -d/dT
    assert np.allclose(
        rate + sum(terms), 0.0, atol=1e-7 * max(np.abs(term).max() for term in terms)
    )
    assert np.array_equal(S(0.0), np.diag([s_x, s_v]))


def fly(X, V, T, s_x, s_v, law):
    """Cost of flying a law in continuous time: terminal part and effort (4.2) with (4.36)."""

    def slope(t, state):
        a = law(t, state[:3], state[3:6])
        return np.concatenate([-state[3:6], a, [0.5 * a @ a]])

    end = solve_ivp(slope, (0.0, T), np.concatenate([X, V, [0.0]]), rtol=1e-10, atol=1e-10).y[:, -1]
    return 0.5 * s_x * end[:3] @ end[:3] + 0.5 * s_v * end[3:6] @ end[3:6] + end[6]


START = np.array([30.0, 6.0, -5.0]), np.array([3.0, -1.0, 0.5])
T, S_X, S_V = 8.0, 10.0, 2.0


def optimal(t, X, V):
    a = np.empty(3)
    command(X, V, T - t, S_X, S_V, a)
    return a


def test_the_flown_cost_is_the_cost_to_go():
    assert fly(*START, T, S_X, S_V, optimal) == pytest.approx(
        cost_to_go(*START, T, S_X, S_V), rel=1e-7
    )


PERTURBATIONS = {
    "more gain": lambda t, a: 1.1 * a,
    "less gain": lambda t, a: 0.9 * a,
    "constant push": lambda t, a: a + np.array([0.0, 0.1, 0.0]),
    "opposite push": lambda t, a: a - np.array([0.0, 0.1, 0.0]),
    "weave": lambda t, a: a + 0.2 * np.sin(3 * t),
    "late": lambda t, a: a * (t > 1.0),
}


@pytest.mark.parametrize("change", PERTURBATIONS.values(), ids=PERTURBATIONS)
def test_every_other_control_costs_more(change):
    best = cost_to_go(*START, T, S_X, S_V)
    assert fly(*START, T, S_X, S_V, lambda t, X, V: change(t, optimal(t, X, V))) > best * (1 + 1e-4)


def test_it_hits_under_truth():
    """Commands held for 0.1 s, like the environment's: the miss of every start stays below 2 cm."""
    rng = np.random.default_rng(0)
    settings = np.array([(0.1, 100.0, 10.0)], SETTINGS)
    beliefs = np.zeros(20, BELIEF)
    beliefs["rhat_TV_N"] = rng.uniform(-40, 40, (20, 3))
    beliefs["v_V_N"] = rng.uniform(-5, 5, (20, 3))
    optimum = [
        cost_to_go(b["rhat_TV_N"].copy(), b["v_V_N"].copy(), 20.0, 100.0, 10.0) for b in beliefs
    ]
    cost, commands = np.zeros(20), np.zeros((20, 3))
    for k in range(200):
        beliefs["t_go"] = 20.0 - 0.1 * k
        laws()["lq"].decide(beliefs, settings, commands)
        cost += 0.05 * (commands**2).sum(axis=1)
        for belief, a in zip(beliefs, commands, strict=True):
            moved, v = np.zeros(3), belief["v_V_N"].copy()
            move(moved, v, a, 0.1)
            belief["rhat_TV_N"] -= moved
            belief["v_V_N"] = v
    miss, speed = (np.linalg.norm(beliefs[name], axis=1) for name in ("rhat_TV_N", "v_V_N"))
    assert miss.max() < 0.02
    cost += 50.0 * miss**2 + 5.0 * speed**2
    assert (cost > optimum).all()  # a held command is a constraint
    assert (cost < 1.02 * np.array(optimum)).all()


def test_time_to_go_is_at_least_one_step():
    belief, settings, commands = (
        np.zeros(2, BELIEF),
        np.array([(0.1, 100.0, 10.0)], SETTINGS),
        np.zeros((2, 3)),
    )
    belief["rhat_TV_N"], belief["t_go"] = [1.0, 2.0, 3.0], [0.0, 0.1]
    laws()["lq"].decide(belief, settings, commands)
    assert np.array_equal(commands[0], commands[1])
    assert np.allclose(
        commands[0], gains(0.1, 100.0, 10.0)[0] * np.array([1.0, 2.0, 3.0]), rtol=1e-15
    )
