"""Differential dynamic programming against a dense quadratic program, and its derivatives."""

import numpy as np
import pytest

from visenvs.core.config import to_record
from visenvs.guidance import ddp
from visenvs.guidance.ddp import DDPConfig

pytestmark = pytest.mark.kernel

X0 = np.array([3.0, -2.0, -2.0, 0.5, 0.3, 0.0])
AIM = np.array([0.0, 0.0, 0.06, 0.0, 0.0, 0.25])


def dense(x0, aim, n, config):
    """All accelerations at once."""
    dt = config.dt
    A, B = np.eye(6) + dt * np.eye(6, k=3), np.vstack([dt**2 / 2 * np.eye(3), dt * np.eye(3)])
    free, driven = x0, np.zeros((6, 3 * n))
    H, f, cost = dt * config.r_a * np.eye(3 * n), np.zeros(3 * n), 0.0
    for k in range(n + 1):
        q = (config.s_r, config.s_v) if k == n else (dt * config.q_r, dt * config.q_v)
        W, off = np.diag(np.repeat(q, 3)), free - aim
        H, f, cost = H + driven.T @ W @ driven, f + driven.T @ W @ off, cost + 0.5 * off @ W @ off
        free, driven = A @ free, A @ driven
        if k < n:
            driven[:, 3 * k : 3 * k + 3] += B
    plan = np.linalg.solve(H, -f)
    return cost + 0.5 * f @ plan, plan.reshape(n, 3)


@pytest.mark.parametrize("n", [1, 7, 30])
@pytest.mark.parametrize("q", [0.0, 2.0])
def test_without_limits_it_is_the_quadratic_program(n, q):
    config = DDPConfig(rho=0.0, q_r=q, q_v=0.5 * q, tolerance=0.0)
    tape = ddp.make_tape(30)
    cost = ddp.improve(X0, AIM, n, to_record(config)[0], tape)
    expected, plan = dense(X0, AIM, n, config)
    assert cost == pytest.approx(expected, rel=1e-9)
    assert tape.u[:n] == pytest.approx(plan, rel=1e-5, abs=1e-5)


def test_at_full_rate_one_sweep_is_enough():
    config = DDPConfig(rho=0.0, rate=1.0, iterations=2, tolerance=0.0)
    cost = ddp.improve(X0, AIM, 20, to_record(config)[0], ddp.make_tape(20))
    assert cost == pytest.approx(dense(X0, AIM, 20, config)[0], rel=1e-10)


def derivative(f, x, h=1e-6):
    """Central differences of f at x, (m, n)."""
    steps = h * np.eye(len(x))
    return np.array([(np.asarray(f(x + s)) - np.asarray(f(x - s))) / (2 * h) for s in steps]).T


def total(u, n, cfg):
    tape = ddp.make_tape(n)
    tape.u[:], tape.x[0] = u, X0
    return ddp.forward(AIM, n, 0.0, cfg, tape)


def test_with_limits_the_plan_is_stationary():
    """Central differences of the whole cost, penalty included, vanish at the plan."""
    n, cfg = 25, to_record(DDPConfig(tolerance=0.0, iterations=60))[0]
    tape = ddp.make_tape(n)
    ddp.improve(X0, AIM, n, cfg, tape)
    u, scale = tape.u.copy(), abs(total(np.zeros((n, 3)), n, cfg))
    for k, i in ((0, 0), (7, 1), (24, 2)):
        step = np.zeros((n, 3))
        step[k, i] = 1e-5
        slope = (total(u + step, n, cfg) - total(u - step, n, cfg)) / 2e-5
        assert abs(slope) < 1e-6 * scale
    length = np.linalg.norm(u, axis=1)
    assert length.max() > cfg["a_max"] - 0.05  # the limit is felt, or this tests nothing


@pytest.mark.parametrize("which", ["speed", "depth"])
def test_the_penalty_has_its_exact_derivatives(which):
    cfg = to_record(DDPConfig())[0]
    x = np.array([0.1, 0.2, 0.3 if which == "depth" else -1.0, 1.5, -2.0, 0.8])
    if which == "depth":
        x[3:] = 0.0

    def gradient(y):
        V_x, V = np.zeros(6), np.zeros((6, 6))
        ddp.add_state_cost(y, AIM, 2.0, 3.0, cfg["rho"], cfg, V_x, V)
        return V_x

    def value(y):
        return [ddp.quadratic(y, AIM, 2.0, 3.0) + ddp.penalty(y, np.zeros(3), cfg)]

    V_x, V = np.zeros(6), np.zeros((6, 6))
    ddp.add_state_cost(x, AIM, 2.0, 3.0, cfg["rho"], cfg, V_x, V)
    assert ddp.penalty(x, np.zeros(3), cfg) > 0.0
    assert pytest.approx(derivative(value, x)[0], rel=1e-5, abs=1e-4) == V_x
    assert pytest.approx(derivative(gradient, x), rel=1e-5, abs=1e-4) == V


@pytest.mark.parametrize("rho", [10.0, 200.0])
def test_the_plan_lands_within_its_limits(rho):
    cfg, tape = to_record(DDPConfig(rho=rho))[0], ddp.make_tape(60)
    ddp.improve(X0, AIM, 60, cfg, tape)
    assert np.linalg.norm(tape.u, axis=1).max() < 3.05
    assert np.linalg.norm(tape.x[:, 3:], axis=1).max() < 2.13
    assert tape.x[-1] == pytest.approx(AIM, abs=0.03)


def test_the_shifted_plan_is_nearly_the_next_one():
    cfg, tape = to_record(DDPConfig())[0], ddp.make_tape(40)
    ddp.improve(X0, AIM, 40, cfg, tape)
    x1 = tape.x[1].copy()
    ddp.shift(40, tape)
    warm = to_record(DDPConfig(iterations=1))[0]
    guess = ddp.improve(x1, AIM, 39, warm, tape)
    assert guess == pytest.approx(ddp.improve(x1, AIM, 39, cfg, ddp.make_tape(39)), rel=0.01)


def test_a_worse_trajectory_is_never_kept():
    cfg = to_record(DDPConfig(tolerance=0.0, rho=1000.0))[0]
    costs = [
        ddp.improve(X0, AIM, 20, to_record(DDPConfig(tolerance=0.0, rho=1e3, iterations=k))[0],
                    ddp.make_tape(20))
        for k in (1, 2, 4, 8)
    ]  # fmt: skip
    assert costs == sorted(costs, reverse=True)
    assert costs[-1] >= ddp.improve(X0, AIM, 20, cfg, ddp.make_tape(20))


@pytest.mark.parametrize(
    "wrong", [{"dt": 0.0}, {"rate": 1.5}, {"iterations": 0}, {"r_a": 0.0}, {"rho": -1.0}]
)
def test_settings_out_of_range_are_named(wrong):
    with pytest.raises(ValueError, match=next(iter(wrong))):
        DDPConfig(**wrong)


def test_a_plan_has_a_step():
    with pytest.raises(ValueError, match=r"n=0.*make_tape\(60\)"):
        ddp.make_tape(0)
