"""The search for the best plan, against SciPy's, dense matrices and the thesis's sweeps."""

import numpy as np
import pytest
from scipy.optimize import minimize

from visenvs.core.units import FOOT
from visenvs.guidance.descent import best_plan, descent, remember
from visenvs.guidance.gauss_seidel import swept_plan
from visenvs.guidance.planner import MEMORY, PLANE, SPACE, begin, cost, gradient, make_tape

NAMES = ("dt", "s_x", "s_v", "camera", "min_range", "sigma_range", "sigma_angle")
SETTINGS = np.dtype([(name, "i8" if name == "camera" else "f8") for name in NAMES])
AXES = {2: PLANE, 3: SPACE}
CASES = [(seed, D) for seed in range(8) for D in (2, 3)]


def settings(
    dt=0.1, s_x=100.0, s_v=10.0, camera=0, min_range=1e-3, sigma_range=0.3, sigma_angle=0.0
):
    return np.array([(dt, s_x, s_v, camera, min_range, sigma_range, sigma_angle)], SETTINGS)


class Problem:
    """A random belief some time before the end, and the predicted cost of n steps from it."""

    def __init__(self, seed, D, n):
        rng = np.random.default_rng(seed)
        self.n, self.D = n, D
        self.cfg = settings(camera=seed % 2, sigma_angle=0.02 * (seed // 2 % 2))
        self.guess = rng.uniform(-2, 2, (n, D))
        self.X = rng.uniform(10, 40) * np.array([1.0, *rng.uniform(-1, 1, D - 1)])
        self.V = rng.uniform(-3, 3, D)
        self.L = np.linalg.qr(rng.normal(size=(D, D)) * rng.uniform(0.2, 5, D))[1].T
        self.begin(make_tape(n, D))

    def begin(self, tape):
        factor, T = self.L[np.tril_indices(self.D)], self.cfg["dt"][0] * (self.n + 20)
        begin(self.X, self.V, factor, T, self.cfg[0], self.n, tape)
        self.tape = tape

    def best(self, guess):
        """Best plan from a first guess, its predicted cost and the evaluations that it took."""
        plan = guess.copy()
        return plan, *best_plan(plan, self.cfg[0], self.tape)

    def cost(self, plan):
        return cost(AXES[self.D], plan, self.cfg[0], self.tape)

    def gradient(self, plan):
        self.cost(plan)
        out = np.empty(plan.shape)
        gradient(AXES[self.D], plan, self.cfg[0], self.tape, out)
        return out

    def flat(self, x):
        """Cost and gradient for SciPy."""
        plan = x.reshape(self.n, self.D)
        return self.cost(plan), self.gradient(plan).ravel()


@pytest.mark.parametrize(("seed", "D"), CASES)
@pytest.mark.parametrize("cold", [True, False])
def test_it_finds_the_minimum_that_scipy_finds(seed, D, cold):
    p = Problem(seed, D, n=40)
    guess = 0.0 * p.guess if cold else p.guess
    _, found, _ = p.best(guess)
    options = {"maxiter": 5000, "maxfun": 10000, "ftol": 1e-14, "gtol": 1e-9}
    expected = minimize(p.flat, guess.ravel(), jac=True, method="L-BFGS-B", options=options).fun
    assert found == pytest.approx(expected, rel=1e-5)
    assert found < p.cost(guess)


@pytest.mark.kernel
@pytest.mark.parametrize(("seed", "D"), CASES)
def test_at_the_end_no_push_promises_a_gain(seed, D):
    """1/2 g' calB^-1 g is what the gradient left could win at the pushes' own price."""
    p = Problem(seed, D, n=6)

    def promised(plan):
        return 0.5 * (p.gradient(plan) ** 2 / p.tape.table[:, 3:]).sum() / (1 + abs(found))

    plan, found, _ = p.best(p.guess)
    assert promised(plan) < 1e-6
    assert promised(p.guess) > 1e-4


@pytest.mark.kernel
@pytest.mark.parametrize(("seed", "D"), CASES)
def test_it_returns_the_cost_of_its_plan_which_is_below_that_of_the_guess(seed, D):
    p = Problem(seed, D, n=5)
    for guess in (0.0 * p.guess, p.guess, 100.0 * p.guess):
        plan, found, _ = p.best(guess)
        assert found == p.cost(plan)
        assert found <= p.cost(guess)


@pytest.mark.kernel
@pytest.mark.parametrize(("seed", "D"), CASES)
def test_a_best_plan_is_recognised(seed, D):
    p = Problem(seed, D, n=6)
    plan, found, _ = p.best(p.guess)
    _, again, evaluations = p.best(plan)
    assert evaluations <= 3
    assert found - 1e-5 * (1 + abs(found)) < again <= found


@pytest.mark.kernel
@pytest.mark.parametrize("D", [2, 3])
def test_pushes_that_win_nothing_are_dropped_at_once(D):
    """With nothing to learn the cost is 1/2 calB |da|^2, whose curvature the search knows.

    A guess, a first step that may be cut short, and the minimum.
    """
    p = Problem(0, D, n=5)
    p.tape.P[0, 0] = 0.0
    plan, found, evaluations = p.best(p.guess)
    assert evaluations <= 3
    assert np.abs(plan).max() < 1e-14
    assert found < 1e-28


@pytest.mark.kernel
def test_a_tape_holds_shorter_plans_too():
    """What a longer plan has left on the tape must not matter to a shorter one."""
    long, short = Problem(3, 3, n=9), Problem(4, 3, n=4)
    plan, found, evaluations = short.best(short.guess)
    long.best(long.guess)
    short.begin(long.tape)
    again = short.best(short.guess)
    assert np.array_equal(again[0], plan)
    assert again[1:] == (found, evaluations)


def inverse_hessian(pairs, price):
    """The dense BFGS matrix of the last pairs (s, y), from 1 / price to the scale of the latest."""
    s, y = pairs[-1]
    H = np.diag(1 / price) * (s @ y) / (y @ (y / price))
    for s, y in pairs[-MEMORY:]:
        keep = np.eye(len(s)) - np.outer(y, s) / (s @ y)
        H = keep.T @ H @ keep + np.outer(s, s) / (s @ y)
    return H


@pytest.mark.kernel
def test_the_direction_is_that_of_the_dense_bfgs_matrix():
    """Over more pairs than are kept, with steps among them along which the cost is concave."""
    p, rng, n, kept, pairs = Problem(0, 2, n=6), np.random.default_rng(0), 12, 0, []
    price, root = np.repeat(p.tape.table[:, 3], 2), rng.normal(size=(n, n))
    A, x, g, d = root @ root.T + np.eye(n), np.zeros(n), rng.normal(size=n), np.empty(n)
    assert descent(g, p.tape, 0, d, 2) == pytest.approx(-g @ (g / price), rel=1e-14)
    assert np.allclose(d, -g / price, rtol=1e-15)
    for k in range(3 * MEMORY):
        s = rng.normal(size=n)
        y = -s if k % 3 == 1 else A @ s
        tried, changed = x + s, g + y
        kept = remember(x, g, tried.copy(), changed.copy(), p.tape.pairs, p.tape.dots, kept)
        assert np.array_equal(x, tried)
        assert np.array_equal(g, changed)
        if k % 3 != 1:
            pairs.append((s, y))
        assert kept == len(pairs)
        expected = -inverse_hessian(pairs, price) @ g
        slope = descent(g, p.tape, kept, d, 2)
        assert np.allclose(d, expected, rtol=0, atol=1e-9 * np.abs(expected).max())
        assert slope == pytest.approx(g @ expected, rel=1e-9)
        assert slope < 0.0


class TestThesisProblem:
    """4.4 at t = 0 for 20 first measurements: 100 steps, 80 ft to go, no manoeuvre yet."""

    n = 100
    cfg = settings(s_x=1.0, s_v=0.0, sigma_range=FOOT)

    def tapes(self):
        for z in 0.01 * np.random.default_rng(3).normal(size=20):
            tape = make_tape(self.n, 2)
            X, V = 80 * FOOT * np.array([1.0, z]), np.array([10 * FOOT, 0.0])
            begin(X, V, 20 * FOOT * np.array([1.0, 0.0, abs(z)]), 10.0, self.cfg[0], self.n, tape)
            yield tape

    def test_the_exact_plan_saves_nearly_all_that_the_unknown_range_costs(self):
        """200.6 ft^2/s^3 are at stake without a plan; each search takes a few dozen evaluations."""
        change, evaluations = np.transpose(
            [best_plan(np.zeros((self.n, 2)), self.cfg[0], tape) for tape in self.tapes()]
        )
        assert np.median(change) / FOOT**2 == pytest.approx(-197.2, abs=0.5)
        assert evaluations.max() <= 40

    def test_the_published_sweeps_stop_far_from_it(self):
        """Ten sweeps leave a plan that is predicted to be worse than none at all."""
        left = []
        for tape in self.tapes():
            plan = np.zeros((self.n, 2))
            swept_plan(plan, self.cfg[0], tape)
            left.append(cost(PLANE, plan, self.cfg[0], tape) / FOOT**2)
        assert np.median(left) == pytest.approx(17422, rel=0.02)
