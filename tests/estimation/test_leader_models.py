"""Models of a leader's relative motion against closed forms and finite differences."""

import math

import numpy as np
import pytest

from visenvs.estimation import cartesian, polar

pytestmark = pytest.mark.kernel

V_OWN = np.array([20.0, 3.0, -1.0])
B = 2.7


def polar_state(r, v, a_lat, b=B):
    """The polar state of a relative position and velocity."""
    x, far = np.zeros(polar.SIZE), np.linalg.norm(r)
    u = r / far
    x[:3], x[6], x[7], x[8], x[9] = u, 1 / far, u @ v / far, b, a_lat
    x[3:6] = (v - u * (u @ v)) / far
    return x


def drawn(seed):
    rng = np.random.default_rng(seed)
    r = np.array([30.0, 0.0, 0.0]) + 8 * rng.normal(size=3)
    return r, 3 * rng.normal(size=3), 2 * rng.normal(), rng.normal(size=3)


def test_the_polar_flow_is_the_exact_motion_of_a_constant_velocity_leader():
    """Fine steps of (2.22) against Cartesian kinematics, whose closed form is a parabola."""
    r, v, _, a = drawn(1)
    x, dt, f, g = polar_state(r, v, 0.0), 1e-3, np.zeros(10), np.zeros(10)
    steps = 500
    for _ in range(steps):
        polar.flow(x, a, V_OWN, f)
        polar.flow(x + 0.5 * dt * f, a, V_OWN, g)
        x = x + dt * g
    t = steps * dt
    expected = r + v * t - 0.5 * a * t * t
    assert x[:3] / x[6] == pytest.approx(expected, abs=1e-5)
    rate = (x[3:6] + x[:3] * x[7]) / x[6]
    assert rate == pytest.approx(v - a * t, abs=1e-5)


def test_the_lateral_acceleration_pulls_to_the_right_of_the_leaders_course():
    r, v, a_lat, a = drawn(2)
    x, f = polar_state(r, v, a_lat), np.zeros(10)
    polar.flow(x, a, V_OWN, f)
    course = (v + V_OWN)[:2]
    pull = a_lat * np.array([-course[1], course[0], 0.0]) / np.hypot(*course) - a
    # second derivative of u / rho from the first derivatives of the state
    far, turn = 1 / x[6], x[:3] * x[7] + x[3:6]
    second = far * (f[3:6] + x[3:6] * x[7] + x[:3] * f[7] + x[7] * turn)
    assert second == pytest.approx(pull, abs=1e-10)


def differences(function, size):
    columns = []
    for j in range(size):
        e = np.zeros(size)
        e[j] = 1e-6
        columns.append((function(e) - function(-e)) / 2e-6)
    return np.array(columns).T


@pytest.mark.parametrize("natural", [True, False])
def test_the_polar_slope_is_the_derivative_of_the_flow(natural):
    for seed in range(5):
        r, v, a_lat, a = drawn(seed)
        x, F = polar_state(r, v, a_lat), np.zeros((10, 10))
        polar.slope(x, a, V_OWN, natural, F, np.zeros(10))

        def flow(e, x=x, a=a):
            y, f = x + e, np.zeros(10)
            if not natural:
                y[6], y[8] = x[6] * math.exp(e[6]), x[8] * math.exp(e[8])
            polar.flow(y, a, V_OWN, f)
            if not natural:
                f[6] /= y[6]
            return f

        assert pytest.approx(differences(flow, 10), abs=1e-7) == F


def test_the_cartesian_slope_is_the_derivative_of_the_flow():
    for seed in range(5):
        r, v, a_lat, a = drawn(seed)
        x, F = np.array([*r, *v, B, a_lat, -0.7 * a_lat]), np.zeros((9, 9))
        cartesian.slope(x, V_OWN, F)

        def flow(e, x=x, a=a):
            f = np.zeros(9)
            cartesian.flow(x + e, a, V_OWN, f)
            return f

        assert pytest.approx(differences(flow, 9), abs=1e-7) == F


def test_the_two_accelerations_are_across_the_velocity_and_a_up_is_up():
    x = np.array([30.0, 0, 0, 1.0, 2.0, 4.0, B, 0.0, 1.5])
    v = x[3:6] + V_OWN
    pull = np.array(cartesian.pull(x, V_OWN))
    assert pull @ v == pytest.approx(0.0, abs=1e-12)
    assert np.linalg.norm(pull) == pytest.approx(1.5, rel=1e-12)
    assert pull[2] < 0.0  # z is down
    x[7], x[8] = 1.5, 0.0
    pull = np.array(cartesian.pull(x, V_OWN))
    assert pull @ v == pytest.approx(0.0, abs=1e-12)
    assert pull == pytest.approx(1.5 * np.array([-v[1], v[0], 0.0]) / np.hypot(*v[:2]), rel=1e-12)
