"""The thesis's sweeps, against (4.61) in plain NumPy and against the exact optimum."""

import numpy as np
import pytest

from visenvs.core.units import FOOT
from visenvs.guidance.descent import best_plan
from visenvs.guidance.gauss_seidel import (
    DIFFERENCE,
    SETTLED,
    SWEEPS,
    onward,
    sweep,
    swept_plan,
)
from visenvs.guidance.planner import PLANE, SPACE, begin, cost, make_tape

NAMES = ("dt", "s_x", "s_v", "camera", "min_range", "sigma_range", "sigma_angle")
SETTINGS = np.dtype([(name, "i8" if name == "camera" else "f8") for name in NAMES])
FIXED, GIMBAL = 0, 1
AXES = {2: PLANE, 3: SPACE}
SCENES = [(2, FIXED), (3, FIXED), (3, GIMBAL)]


class Problem:
    """A target off the axis whose range is known to a fifth, `spare` steps before the plan ends."""

    def __init__(self, D, camera, n, spare=10, s_x=1.0, deviation=5.0):
        self.D, self.n = D, n
        self.cfg = np.array([(0.1, s_x, 0.1, camera, 1e-3, FOOT, 0.01)], SETTINGS)
        sight = np.array([1.0, 0.2, -0.1][:D])
        self.X, self.V = 25.0 * sight, np.array([3.0, 0.5, 0.2][:D])
        root = np.column_stack([deviation * sight, 0.3 * np.eye(D)])
        self.factor = np.linalg.cholesky(root @ root.T)[np.tril_indices(D)]
        self.T = 0.1 * (n + spare)
        self.plan = np.random.default_rng(0).uniform(-0.3, 0.3, (n, D))
        self.tape = self.entered()

    def entered(self):
        """A fresh tape with the belief on it."""
        tape = make_tape(self.n, self.D)
        begin(self.X, self.V, self.factor, self.T, self.cfg[0], self.n, tape)
        return tape

    def cost(self, plan):
        return cost(AXES[self.D], plan, self.cfg[0], self.entered())

    def sweep(self, plan):
        return sweep(AXES[self.D], plan, self.cfg[0], self.tape)

    def swept(self):
        plan = np.full((self.n, self.D), np.nan)
        return plan, swept_plan(plan, self.cfg[0], self.tape)

    def exact(self):
        plan = np.zeros((self.n, self.D))
        return plan, best_plan(plan, self.cfg[0], self.entered())[0]

    def nudged(self, plan, j, i):
        """The plan with one push longer by the difference along one axis."""
        out = plan.copy()
        out[j, i] += DIFFERENCE
        return out


def one_sweep(p, plan):
    """(4.61) for one push after the other, each from the costs of whole plans.

    What the images gain is 1/2 calB |da|^2 less the cost; its slope over calB is the new push.
    """
    plan, price = plan.copy(), p.tape.table[:, 3]

    def gained(plan):
        return 0.5 * (price * (plan**2).sum(axis=1)).sum() - p.cost(plan)

    for j in range(p.n):
        slopes = [gained(p.nudged(plan, j, i)) - gained(plan) for i in range(p.D)]
        plan[j] = np.array(slopes) / DIFFERENCE / price[j]
    return plan


@pytest.mark.kernel
@pytest.mark.parametrize(("D", "camera"), SCENES)
def test_a_sweep_sets_each_push_to_the_slope_of_what_it_gains_over_its_price(D, camera):
    """Twice, so that the second sweep starts from what the first has left on the tape."""
    p = Problem(D, camera, n=5)
    plan = p.plan.copy()
    for _ in range(2):
        before, expected = plan.copy(), one_sweep(p, plan)
        changed = p.sweep(plan)
        assert np.abs(expected - before).max() > 1e-3
        assert np.allclose(plan, expected, rtol=0, atol=1e-7)
        assert changed == pytest.approx(np.linalg.norm(plan - before), rel=1e-12)


@pytest.mark.kernel
@pytest.mark.parametrize(("D", "camera"), SCENES)
def test_where_the_sweeps_come_to_rest_the_difference_quotient_of_the_cost_vanishes(D, camera):
    """But for half a difference: it is taken of the gain alone, and the price is exact."""
    p = Problem(D, camera, n=4)
    plan = 0.0 * p.plan
    for _ in range(40):
        changed = p.sweep(plan)
    assert changed < 1e-6
    here = p.cost(plan)
    for j in range(p.n):
        for i in range(D):
            quotient = (p.cost(p.nudged(plan, j, i)) - here) / DIFFERENCE
            price = p.tape.table[j, 3]
            assert quotient / price == pytest.approx(0.5 * DIFFERENCE, abs=1e-6)


@pytest.mark.parametrize(("D", "camera"), SCENES)
def test_sweeps_never_end_below_the_exact_optimum_and_reach_it_after_many(D, camera):
    p = Problem(D, camera, n=30)
    best, least = p.exact()
    plan, found = 0.0 * best, []
    for _ in range(60):
        p.sweep(plan)
        found.append(p.cost(plan))
    assert min(found) >= least - 1e-6 * abs(least)
    assert found[0] > least + 1e-2 * abs(least)
    assert found[-1] == pytest.approx(least, rel=1e-5)


@pytest.mark.kernel
@pytest.mark.parametrize(("D", "camera"), SCENES)
def test_a_plan_is_swept_from_no_push_until_it_settles(D, camera):
    p = Problem(D, camera, n=5)
    plan, sweeps = p.swept()
    expected, changes = 0.0 * p.plan, []
    for _ in range(sweeps):
        changes.append(p.sweep(expected))
    assert np.array_equal(plan, expected)
    assert 1 < sweeps < SWEEPS
    assert changes[-1] <= SETTLED < min(changes[:-1])


def test_a_plan_that_does_not_settle_is_given_up():
    """As in (4.4) at the start of the flight; the same plan is still swept on by further sweeps."""
    p = Problem(2, FIXED, n=100, spare=0)
    plan, sweeps = p.swept()
    assert sweeps == SWEEPS
    assert p.sweep(plan) > SETTLED
    assert p.cost(plan) > p.exact()[1]


@pytest.mark.kernel
@pytest.mark.parametrize(("D", "camera"), SCENES)
def test_pushes_that_win_nothing_are_left_out_in_one_sweep(D, camera):
    """With nothing to learn the cost is 1/2 calB |da|^2."""
    p = Problem(D, camera, n=4)
    p.factor = 0.0 * p.factor
    p.tape = p.entered()
    plan = p.plan.copy()
    assert p.sweep(plan) == pytest.approx(np.linalg.norm(p.plan), rel=1e-6)
    assert np.abs(plan).max() < 1e-9
    assert p.swept()[1] == 1


@pytest.mark.kernel
@pytest.mark.parametrize("D", [2, 3])
def test_a_tape_from_a_later_step_on_is_the_same_memory(D):
    tape = make_tape(6, D)
    rest = onward(tape, 2)
    stepwise = ("table", "states", "P", "G", "K", "axis")
    for name, whole in tape._asdict().items():
        first = 2 if name in stepwise else 0
        later = getattr(rest, name)
        assert later.shape == whole[first:].shape
        later[...] = 7.0
        assert (whole[first:] == 7.0).all()
        assert not whole[:first].any()


@pytest.mark.kernel
@pytest.mark.parametrize(("D", "camera"), SCENES)
def test_the_rest_of_a_plan_costs_as_much_from_a_later_step_on(D, camera):
    """What is before that step is flown: pushes, and what the images until then have gained."""
    p, j = Problem(D, camera, n=6), 2
    whole, tape = p.cost(p.plan), p.tape
    flown = cost(AXES[D], p.plan[:j], p.cfg[0], tape)
    later = cost(AXES[D], p.plan[j:], p.cfg[0], onward(tape, j))
    assert flown + later == pytest.approx(whole, rel=1e-13)
