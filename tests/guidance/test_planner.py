"""Predicted cost against the textbook filter in generic matrices, gradient against differences."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import null_space

from visenvs.guidance.planner import (
    BLIND,
    GIMBAL,
    MEMORY,
    PLANE,
    SPACE,
    begin,
    cost,
    covariance,
    gradient,
    make_tape,
    prices,
    row_variance,
)

NAMES = ("dt", "s_x", "s_v", "camera", "min_range", "sigma_range", "sigma_angle")
SETTINGS = np.dtype([(name, "i8" if name == "camera" else "f8") for name in NAMES])
FIXED = 0
AXES = {2: PLANE, 3: SPACE}
SCENES = [
    (D, camera, sigma_angle)
    for D, camera in [(2, FIXED), (3, FIXED), (3, GIMBAL)]
    for sigma_angle in (0.0, 0.02)
]
STEPS = 6  # of the plans that also run without compilation


def settings(
    dt=0.1, s_x=100.0, s_v=10.0, camera=FIXED, min_range=1e-3, sigma_range=0.3, sigma_angle=0.0
):
    """The least range is so small that its fade (1e-12 at 1 m) is lost in rounding."""
    return np.array([(dt, s_x, s_v, camera, min_range, sigma_range, sigma_angle)], SETTINGS)


class Problem:
    """A belief, a plan for its last n steps, and the kernels as functions of that plan."""

    def __init__(self, seed, D, camera=FIXED, sigma_angle=0.0, n=STEPS, spare=0, **changes):
        rng = np.random.default_rng(seed)
        self.D, self.n = D, n
        self.cfg = settings(camera=camera, sigma_angle=sigma_angle, **changes)
        self.T = self.cfg["dt"][0] * (n + spare)
        self.X = rng.uniform(10, 40) * np.array([1.0, *rng.uniform(-1, 1, D - 1)])
        self.V = rng.uniform(-3, 3, D)
        self.L = np.linalg.qr(rng.normal(size=(D, D)) * rng.uniform(0.2, 5, D))[1].T
        self.plan = rng.uniform(-1, 1, (n, D))
        self.tape = make_tape(n, D)
        self.begin()

    def begin(self):
        factor = self.L[np.tril_indices(self.D)]
        begin(self.X, self.V, factor, self.T, self.cfg[0], self.n, self.tape)

    def cost(self, plan):
        return cost(AXES[self.D], np.ascontiguousarray(plan), self.cfg[0], self.tape)

    def gradient(self, plan):
        self.cost(plan)
        out = np.full((self.n, self.D), np.nan)
        gradient(AXES[self.D], plan, self.cfg[0], self.tape, out)
        return out


F, G = np.array([[0.0, 1.0], [0.0, 0.0]]), np.array([[0.0], [-1.0]])  # x = (r_TV, -v_V), an axis


def exponential(A):
    """e^A of a nilpotent matrix, whose series ends."""
    term = total = np.eye(len(A))
    for k in range(1, len(A)):
        term = term @ A / k
        total = total + term
    return total


def generic(T, cfg):
    """Gain (1, 2), calS (4.30) and calB (4.31) of an axis: Gramian and transition as matrices.

    The gain is that of a step which begins with time to go T, the prices of one that ends with it.
    """
    S_f = np.diag([cfg["s_x"][0], cfg["s_v"][0]])
    van_loan = exponential(T * np.block([[-F, G @ G.T], [np.zeros((2, 2)), F.T]]))
    Phi = van_loan[2:, 2:].T
    gramian = Phi @ van_loan[:2, 2:]
    inverse = np.linalg.inv(np.eye(2) + gramian @ S_f)
    Gamma = held(cfg)[1]
    calS = Phi.T @ S_f @ gramian @ S_f @ inverse @ Phi
    calB = Gamma.T @ Phi.T @ S_f @ inverse @ Phi @ Gamma + cfg["dt"][0]
    return -G.T @ Phi.T @ S_f @ inverse @ Phi, calS[0, 0], calB[0, 0]


def held(cfg):
    """Transition (2, 2) and input matrix (2, 1) of an axis for a step with the command held."""
    block = exponential(cfg["dt"][0] * np.block([[F, G], [np.zeros((1, 3))]]))
    return block[:2, :2], block[:2, 2:]


def image(x, cfg):
    """Jacobian (D - 1, D) and noise covariance of an image of x: (3.14), (4.37) and sigma_angle.

    A gimbal looks along x; how it is turned about that line must not matter, so the axes across it
    are any that SciPy gives.
    """
    D = len(x)
    C = np.eye(D)
    if cfg["camera"][0] == GIMBAL:
        C = np.vstack([x / np.linalg.norm(x), null_space(x[None, :]).T])
    depth, *across = C @ x
    H = np.column_stack([-np.array(across) / depth, np.eye(D - 1)]) @ C / depth
    variance = cfg["sigma_range"][0] ** 2 / depth**2 + cfg["sigma_angle"][0] ** 2
    return H, variance * np.eye(D - 1)


def textbook(p, plan):
    """Plan-dependent part of (4.59), and the last covariance, by the filter's recursion."""
    dt, (Phi, Gamma), total = p.cfg["dt"][0], held(p.cfg), 0.0
    x, P = np.vstack([p.X, -p.V]), p.L @ p.L.T
    for j, push in enumerate(plan):
        left = p.T - j * dt
        x = Phi @ x + Gamma @ (generic(left, p.cfg)[0] @ x + push)
        _, calS, calB = generic(left - dt, p.cfg)
        H, R = image(x[0], p.cfg)
        K = P @ H.T @ np.linalg.inv(H @ P @ H.T + R)
        total += 0.5 * calB * push @ push - 0.5 * calS * np.trace(K @ H @ P)
        P = P - K @ H @ P
    return total, P


def differences(f, plan, h=2e-3):
    """Gradient by sixth-order central differences."""
    out = np.empty(plan.shape)
    for at in np.ndindex(plan.shape):
        e = np.zeros(plan.shape)
        e[at] = h
        near, mid, far = (f(plan + k * e) - f(plan - k * e) for k in (1, 2, 3))
        out[at] = (45 * near - 9 * mid + far) / (60 * h)
    return out


@pytest.mark.kernel
@given(
    T=st.floats(0.0, 50.0), dt=st.floats(1e-2, 1.0), s_x=st.floats(1e-2, 1e4), s_v=st.floats(0, 1e3)
)
def test_prices_equal_the_matrix_formulas(T, dt, s_x, s_v):
    cfg = settings(dt=dt, s_x=s_x, s_v=s_v)
    _, calS, calB = generic(T, cfg)
    found = prices(T, dt, s_x, s_v)
    assert found[0] == pytest.approx(calS, rel=1e-9, abs=1e-12 * s_x)
    assert found[1] == pytest.approx(calB, rel=1e-9)


@pytest.mark.kernel
def test_at_the_terminal_time_an_image_is_worthless_and_a_push_costs_its_effort_and_its_miss():
    calS, calB = prices(0.0, 0.1, 100.0, 10.0)
    assert calS == 0.0
    assert calB == pytest.approx(0.1 + 100.0 * 0.005**2 + 10.0 * 0.1**2, rel=1e-14)


@pytest.mark.kernel
@pytest.mark.parametrize("D", [2, 3])
def test_covariance_from_the_row(D):
    root = np.tril(np.random.default_rng(0).normal(size=(D, D)))
    P = np.empty((D, D))
    covariance(root[np.tril_indices(D)], P)
    assert np.allclose(P, root @ root.T, rtol=1e-14)
    assert np.array_equal(P, P.T)


@pytest.mark.kernel
@pytest.mark.parametrize("D", [2, 3])
@pytest.mark.parametrize("n", [0, 1, 7])
def test_a_tape_has_room_for_n_steps_along_D_axes(n, D):
    expected = {
        "table": (n, 4),
        "states": (n + 1, 2 * D + 1),
        "P": (n + 1, D - 1, D, D),
        "G": (n, D - 1, D),
        "K": (n, D - 1, D),
        "axis": (n, D),
        "C": (D, D),
        "M": (D, D),
        "L": (3 * D,),
        "pairs": (2 * MEMORY, n * D),
        "work": (4, n * D),
        "dots": (2, MEMORY),
    }
    assert {name: array.shape for name, array in make_tape(n, D)._asdict().items()} == expected


@pytest.mark.kernel
@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(("D", "camera", "sigma_angle"), SCENES)
def test_cost_is_that_of_the_textbook_filter(D, camera, sigma_angle, seed):
    p = Problem(seed, D, camera, sigma_angle, spare=3 * seed)
    for plan in (p.plan, 0.0 * p.plan):
        expected, P = textbook(p, plan)
        assert p.cost(plan) == pytest.approx(expected, rel=1e-9)
        assert np.allclose(p.tape.P[p.n, 0], P, rtol=0, atol=1e-9 * np.abs(P).max())


@pytest.mark.parametrize(("D", "camera", "sigma_angle"), SCENES)
def test_cost_of_a_long_plan_is_that_of_the_textbook_filter(D, camera, sigma_angle):
    p = Problem(7, D, camera, sigma_angle, n=100, spare=50)
    assert p.cost(p.plan) == pytest.approx(textbook(p, p.plan)[0], rel=1e-8)


@pytest.mark.kernel
@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(("D", "camera", "sigma_angle"), SCENES)
def test_gradient_equals_central_differences(D, camera, sigma_angle, seed):
    """For a gimbal the cost turns the camera with every plan, while the adjoint holds it."""
    p = Problem(seed, D, camera, sigma_angle, n=4, spare=10 * seed)
    numeric = differences(p.cost, p.plan)
    assert np.allclose(p.gradient(p.plan), numeric, rtol=0, atol=1e-7 * np.abs(numeric).max())


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(("D", "camera", "sigma_angle"), SCENES)
def test_gradient_of_a_long_plan_equals_central_differences(D, camera, sigma_angle, seed):
    p = Problem(seed, D, camera, sigma_angle, n=100)
    numeric = differences(p.cost, p.plan)
    assert np.allclose(p.gradient(p.plan), numeric, rtol=0, atol=1e-7 * np.abs(numeric).max())


@pytest.mark.kernel
@pytest.mark.parametrize("D", [2, 3])
def test_gradient_inside_the_least_range_equals_central_differences(D):
    p = Problem(1, D, min_range=15.0, sigma_angle=0.02, n=4)
    p.X[0] = 9.0
    p.begin()
    numeric = differences(p.cost, p.plan)
    assert np.allclose(p.gradient(p.plan), numeric, rtol=0, atol=1e-7 * np.abs(numeric).max())
    plain = Problem(1, D, sigma_angle=0.02, n=4)
    plain.X[0] = 9.0
    plain.begin()
    assert p.cost(0.0 * p.plan) > plain.cost(0.0 * p.plan)  # images there tell less


@pytest.mark.kernel
@pytest.mark.parametrize("depth", [0.05, 0.3, 1.0, 40.0])
@pytest.mark.parametrize("sigma_angle", [0.0, 0.02])
def test_noise_grows_inside_the_least_range(depth, sigma_angle):
    cfg, h = settings(min_range=0.3, sigma_angle=sigma_angle), 1e-3 * depth
    found, slope = row_variance(depth, cfg[0])
    plain = 0.3**2 + (sigma_angle * depth) ** 2
    assert found == pytest.approx(plain * (1 + (0.3 / depth) ** 4), rel=1e-14)
    near, mid, far = (
        row_variance(depth + k * h, cfg[0])[0] - row_variance(depth - k * h, cfg[0])[0]
        for k in (1, 2, 3)
    )
    scale = max(abs(slope), found / depth)  # of what the differences can resolve
    assert (45 * near - 9 * mid + far) / (60 * h) == pytest.approx(slope, abs=1e-9 * scale)


@pytest.mark.kernel
@pytest.mark.parametrize("D", [2, 3])
@pytest.mark.parametrize("depth", [-20.0, 0.0, 0.9 * BLIND * 0.3])
def test_without_an_image_only_the_pushes_cost(depth, D):
    """Behind the camera, beside it, and nearer than an image counts; the vehicle stays there."""
    p = Problem(0, D, min_range=0.3, s_x=1e-9, s_v=0.0, n=3, spare=50)
    p.X[0], p.V = depth, np.zeros(D)
    p.plan[:, 0] = 0.0
    p.begin()
    price = p.tape.table[:, 3:]
    assert p.cost(p.plan) == pytest.approx(0.5 * (price * p.plan**2).sum(), rel=1e-14)
    assert np.array_equal(p.gradient(p.plan), price * p.plan)
    assert np.array_equal(p.tape.P[3, 0], p.tape.P[0, 0])


@pytest.mark.kernel
@pytest.mark.parametrize(("D", "camera", "sigma_angle"), SCENES)
def test_with_perfect_information_only_the_pushes_cost(D, camera, sigma_angle):
    p = Problem(2, D, camera, sigma_angle)
    p.L = np.zeros((D, D))
    p.begin()
    price = p.tape.table[:, 3:]
    assert p.cost(p.plan) == pytest.approx(0.5 * (price * p.plan**2).sum(), rel=1e-14)
    assert np.allclose(p.gradient(p.plan), price * p.plan, rtol=1e-14)


@pytest.mark.kernel
def test_a_plane_is_a_slice_of_space():
    """What lies in a level plane with the optical axis costs the same in 2-D and in 3-D."""
    plane, space = Problem(4, 2), Problem(4, 3)
    space.X, space.V = np.array([*plane.X, 0.0]), np.array([*plane.V, 0.0])
    space.L = np.zeros((3, 3))
    space.L[:2, :2] = plane.L
    space.begin()
    plan = np.column_stack([plane.plan, np.zeros(plane.n)])
    assert space.cost(plan) == pytest.approx(plane.cost(plane.plan), rel=1e-13)
    slope, flat = space.gradient(plan), plane.gradient(plane.plan)
    assert np.allclose(slope[:, :2], flat, rtol=0, atol=1e-12 * np.abs(flat).max())
    assert np.array_equal(slope[:, 2], np.zeros(plane.n))


@pytest.mark.kernel
def test_no_heading_is_special_to_a_gimbal():
    """Turning belief, covariance and plan about the vertical turns the gradient with them."""
    p, turned = Problem(5, 3, GIMBAL), Problem(5, 3, GIMBAL)
    c, s = np.cos(2.0), np.sin(2.0)
    Q = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    turned.X, turned.V = Q @ p.X, Q @ p.V
    turned.L = np.linalg.cholesky(Q @ p.L @ p.L.T @ Q.T)
    turned.begin()
    plan = np.ascontiguousarray(p.plan @ Q.T)
    assert turned.cost(plan) == pytest.approx(p.cost(p.plan), rel=1e-12)
    expected = p.gradient(p.plan) @ Q.T
    assert np.allclose(turned.gradient(plan), expected, rtol=0, atol=1e-12 * np.abs(expected).max())


@pytest.mark.kernel
def test_nothing_is_left_on_the_tape_by_another_plan():
    p = Problem(6, 3, GIMBAL)
    first, slope = p.cost(p.plan), p.gradient(p.plan)
    p.gradient(np.full_like(p.plan, 2.0))
    assert p.cost(p.plan) == first
    assert np.array_equal(p.gradient(p.plan), slope)
