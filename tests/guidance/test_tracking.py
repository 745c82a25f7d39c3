"""Path tracking against Bellman's equation, least squares, the flown cost and closed forms."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from visenvs.guidance import lq
from visenvs.guidance.tracking import Tracking, solve

EYE, O = np.eye(3), np.zeros((3, 3))
POINT_MASS = np.block([[O, EYE], [O, O]]), np.vstack([O, -EYE])  # (4.1)


def weave(t):
    return np.array([2.0 * np.sin(0.7 * t), 1.0 - 0.3 * t, np.cos(t)])


def waypoints(t):
    return np.array([1.0, 0.0, -2.0]) if t < 2.3 else np.array([-30.0, 5.0, 0.0])


def random_problem(seed=0):
    """Three states, two controls, full weights, and a path that the system cannot follow."""
    rng = np.random.default_rng(seed)
    root, control, terminal = (
        rng.normal(size=(3, 3)),
        rng.normal(size=(2, 2)),
        rng.normal(size=(3, 2)),
    )
    return {
        "F": rng.normal(size=(3, 3)) * 0.5,
        "G": rng.normal(size=(3, 2)),
        "A": root @ root.T,
        "B": control @ control.T + 0.5 * np.eye(2),
        "S_f": 3.0 * terminal @ terminal.T,
        "x_f": rng.normal(size=3),
        "path": weave,
        "t_0": 1.0,
        "t_f": 4.0,
    }


SEEDS = range(3)


def running_cost(p, t, x, a):
    off = x - p["path"](t)
    return 0.5 * off @ p["A"] @ off + 0.5 * a @ p["B"] @ a


def flown_cost(p, x_0, law):
    """Cost (4.2) of a law in continuous time."""

    def slope(t, state):
        a = law(t, state[:-1])
        return np.append(p["F"] @ state[:-1] + p["G"] @ a, running_cost(p, t, state[:-1], a))

    span = p["t_0"], p["t_f"]
    end = solve_ivp(slope, span, np.append(x_0, 0.0), method="DOP853", rtol=1e-11, atol=1e-12).y[
        :, -1
    ]
    off = end[:-1] - p["x_f"]
    return end[-1] + 0.5 * off @ p["S_f"] @ off


@pytest.mark.parametrize(
    ("s_x", "s_v", "t_f"), [(100.0, 10.0, 20.0), (1000.0, 0.0, 10.0), (0.01, 3.0, 5.0)]
)
def test_without_a_path_it_is_the_terminal_law(s_x, s_v, t_f):
    """A = 0, x_f = 0: command and cost equal the closed form (4.9)-(4.12) of `guidance.lq`."""
    S_f = np.diag([s_x] * 3 + [s_v] * 3)
    law = solve(
        *POINT_MASS, np.zeros((6, 6)), EYE, S_f, np.zeros(6), lambda t: np.zeros(6), 0.0, t_f
    )
    rng = np.random.default_rng(1)
    for t in np.linspace(0.0, t_f - 0.05, 15):
        X, V, a = rng.normal(size=3) * 30, rng.normal(size=3) * 5, np.empty(3)
        lq.command(X, V, t_f - t, s_x, s_v, a)
        state = np.concatenate([X, -V])
        assert np.allclose(law.command(t, state), a, rtol=0, atol=1e-9 * np.abs(a).max())
        assert law.cost(t, state) == pytest.approx(lq.cost_to_go(X, V, t_f - t, s_x, s_v), rel=1e-9)


@pytest.mark.parametrize("seed", SEEDS)
def test_without_a_path_any_linear_system_follows_the_closed_form(seed):
    """(4.9), (4.10) with e^(FT) and the Gramian from `expm`, and a terminal state that is not 0."""
    p = random_problem(seed) | {"A": np.zeros((3, 3))}
    law = solve(**p)
    x = np.random.default_rng(seed).normal(size=3)
    for t in (1.0, 2.2, 3.9):
        T = p["t_f"] - t
        Phi = expm(p["F"] * T)
        price = p["G"] @ np.linalg.solve(p["B"], p["G"].T)
        gramian = Phi @ expm(T * np.block([[-p["F"], price], [np.zeros((3, 3)), p["F"].T]]))[:3, 3:]
        M = p["S_f"] @ np.linalg.inv(np.eye(3) + gramian @ p["S_f"])
        miss = Phi @ x - p["x_f"]
        assert np.allclose(
            law.command(t, x), -np.linalg.solve(p["B"], p["G"].T) @ Phi.T @ M @ miss, rtol=1e-9
        )
        assert law.cost(t, x) == pytest.approx(0.5 * miss @ M @ miss, rel=1e-9)


@pytest.mark.parametrize("seed", SEEDS)
def test_the_cost_satisfies_bellmans_equation(seed):
    """min over a of dJ/dt + grad J (F x + G a) + running cost is 0 (B.3), at the command."""
    p = random_problem(seed)
    law, rng, h = solve(**p), np.random.default_rng(seed), 1e-4
    for t in rng.uniform(1.1, 3.9, 10):
        x = rng.normal(size=3)
        a = law.command(t, x)
        rate = (law.cost(t + h, x) - law.cost(t - h, x)) / (2 * h)
        gradient = np.array(
            [(law.cost(t, x + e) - law.cost(t, x - e)) / (2 * h) for e in h * np.eye(3)]
        )

        def bellman(a, t=t, x=x, rate=rate, gradient=gradient):
            return rate + gradient @ (p["F"] @ x + p["G"] @ a) + running_cost(p, t, x, a)

        assert abs(bellman(a)) < 1e-6 * (1 + abs(rate))
        for other in a + rng.normal(size=(5, 2)):
            off = other - a
            assert bellman(other) - bellman(a) == pytest.approx(
                0.5 * off @ p["B"] @ off, abs=1e-6 * (1 + abs(rate))
            )


@pytest.mark.parametrize("path", [weave, waypoints])
@pytest.mark.parametrize("seed", SEEDS)
def test_the_flown_cost_is_the_predicted_cost_and_the_least(seed, path):
    p = random_problem(seed) | {"path": path}
    law, x_0 = solve(**p), np.array([1.0, -2.0, 0.5])
    best = law.cost(p["t_0"], x_0)
    assert flown_cost(p, x_0, law.command) == pytest.approx(best, rel=1e-8)
    for change in (
        lambda t, a: 1.1 * a,
        lambda t, a: a + 0.1,
        lambda t, a: a + 0.2 * np.sin(4 * t),
    ):
        assert flown_cost(
            p, x_0, lambda t, x, change=change: change(t, law.command(t, x))
        ) > best * (1 + 1e-5)


def least_squares_cost(p, x_0, steps):
    """Least cost over commands held for a step, as least squares; Simpson's rule inside steps."""
    n, m = p["G"].shape
    half = (p["t_f"] - p["t_0"]) / steps / 2
    hold = expm(half * np.block([[p["F"], p["G"]], [np.zeros((m, n + m))]]))
    A_root, B_root = np.linalg.cholesky(p["A"]).T, np.linalg.cholesky(p["B"]).T
    values, vectors = np.linalg.eigh(p["S_f"])
    S_root = (vectors * np.sqrt(np.maximum(values, 0.0))).T
    free, forced = x_0.copy(), np.zeros((n, m * steps))  # x = free + forced @ commands
    rows, aims = [], []

    def charge(root, matrix, aim):
        rows.append(root @ matrix)
        aims.append(root @ aim)

    for k in range(2 * steps + 1):
        weight = np.sqrt(half / 3 * (1 if k in (0, 2 * steps) else 4 if k % 2 else 2))
        charge(weight * A_root, forced, p["path"](p["t_0"] + k * half) - free)
        if k < 2 * steps:
            held = np.zeros((m, m * steps))
            held[:, (k // 2) * m : (k // 2 + 1) * m] = np.eye(m)
            free, forced = hold[:n, :n] @ free, hold[:n, :n] @ forced + hold[:n, n:] @ held
            charge(np.sqrt(half) * B_root, held, np.zeros(m))
    charge(S_root, forced, p["x_f"] - free)
    matrix, aim = np.concatenate(rows), np.concatenate(aims)
    commands = np.linalg.lstsq(matrix, aim, rcond=None)[0]
    return 0.5 * np.sum((matrix @ commands - aim) ** 2), commands.reshape(steps, m)


@pytest.mark.parametrize("seed", SEEDS)
def test_it_is_the_limit_of_discrete_least_squares(seed):
    """Held commands cost more, by an amount that falls to a quarter when the step is halved."""
    p = random_problem(seed)
    law, x_0 = solve(**p), np.array([1.0, -2.0, 0.5])
    best = law.cost(p["t_0"], x_0)
    coarse, fine = least_squares_cost(p, x_0, 40), least_squares_cost(p, x_0, 80)
    assert 0 < fine[0] - best < 1e-2 * best
    assert (coarse[0] - best) / (fine[0] - best) == pytest.approx(4.0, rel=0.1)
    scale = np.abs(fine[1]).max()
    extrapolated = 1.5 * fine[1][0] - 0.5 * fine[1][1]  # held commands are those of mid-step
    assert np.allclose(extrapolated, law.command(p["t_0"], x_0), atol=0.02 * scale)


def test_a_path_that_flies_itself_costs_nothing():
    """x_c' = F x_c with x_f at its end: on the path there is nothing to command or to pay."""
    p = random_problem(0)
    start = np.array([1.0, 0.5, -0.5])

    def path(t):
        return expm(p["F"] * (t - 1.0)) @ start

    law = solve(**{**p, "path": path, "x_f": path(4.0)})
    for t in (1.0, 2.5, 4.0):
        S, v, _ = law.coefficients(t)
        assert np.allclose(v, -S @ path(t), atol=1e-9)
        assert np.allclose(law.command(t, path(t)), 0.0, atol=1e-9)
        assert law.cost(t, path(t)) == pytest.approx(0.0, abs=1e-9)


def test_terminal_conditions():
    p = random_problem(1)
    law = solve(**p)
    S, v, w = law.coefficients(p["t_f"])
    assert np.allclose(S, p["S_f"], rtol=1e-15)
    assert np.allclose(v, -p["S_f"] @ p["x_f"], rtol=1e-12)
    assert w == pytest.approx(0.5 * p["x_f"] @ p["S_f"] @ p["x_f"], rel=1e-12)


def test_many_states_at_once():
    law = solve(**random_problem(2))
    states = np.random.default_rng(0).normal(size=(4, 5, 3))
    commands, costs = law.command(2.0, states), law.cost(2.0, states)
    assert commands.shape == (4, 5, 2)
    assert costs.shape == (4, 5)
    assert np.allclose(commands[1, 2], law.command(2.0, states[1, 2]), rtol=1e-12)
    assert costs[1, 2] == pytest.approx(law.cost(2.0, states[1, 2]), rel=1e-12)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        (
            {"F": np.zeros((3, 2))},
            r"F must be a finite matrix of shape \(3, 3\), got shape \(3, 2\)",
        ),
        ({"F": np.zeros(3)}, "F must be a finite matrix"),
        ({"F": np.full((3, 3), np.nan)}, "F must be a finite matrix"),
        (
            {"G": np.zeros((2, 2))},
            r"G must be a finite matrix of shape \(3, m\), got shape \(2, 2\)",
        ),
        ({"A": np.eye(2)}, r"A must be a finite matrix of shape \(3, 3\)"),
        (
            {"A": np.diag([1.0, 1.0, -1.0])},
            "A must be positive semidefinite, its least eigenvalue is -1",
        ),
        ({"A": np.triu(np.ones((3, 3)))}, "A must be symmetric"),
        ({"B": np.eye(3)}, r"B must be a finite matrix of shape \(2, 2\)"),
        ({"B": np.diag([1.0, 0.0])}, "B must be positive definite, its least eigenvalue is 0"),
        ({"S_f": -np.eye(3)}, "S_f must be positive semidefinite"),
        ({"x_f": np.zeros(2)}, "x_f must be 3 finite numbers"),
        ({"path": lambda t: np.zeros(2)}, r"path\(t\) must be 3 finite numbers"),
        ({"path": lambda t: np.full(3, np.inf)}, r"path\(t\) must be 3 finite numbers"),
        ({"t_0": 4.0}, "finite t_0 < t_f, got t_0=4.0, t_f=4.0"),
        ({"t_f": np.inf}, "finite t_0 < t_f"),
    ],
)
def test_bad_problems_are_refused_by_name(wrong, message):
    with pytest.raises(ValueError, match=message):
        solve(**{**random_problem(), **wrong})


def test_bad_questions_are_refused():
    law = solve(**random_problem())
    assert isinstance(law, Tracking)
    with pytest.raises(ValueError, match=r"solved for 1.0 <= t <= 4.0, got t=4.5"):
        law.command(4.5, np.zeros(3))
    with pytest.raises(ValueError, match=r"3 numbers, got shape \(2,\)"):
        law.cost(2.0, np.zeros(2))
