"""Sequential proportional navigation and minimum effort through an aiming point and a waypoint."""

import numpy as np
import pytest

from visenvs.guidance import meg, pn

pytestmark = pytest.mark.kernel

# thesis 3.5.1, in feet
OBSTACLES, RADII = [[20.0, -5.0, 5.0], [50.0, 5.0, -5.0]], [10.0, 10.0]
WAYPOINT, V = [80.0, 0.0, 0.0], [10.0, 0.0, 0.0]


def least_effort(points, times, V):
    """First command and 1/2 integral of a^2 of the control of least norm through points at times.

    x(T_i) = V T_i + int_0^T_i (T_i - t) a dt, so that a is a sum of the kernels (T_i - t)+.
    """
    S, T = np.minimum.outer(times, times), np.maximum.outer(times, times)
    gram = S * S * (3.0 * T - S) / 6.0
    wanted = np.array(points) - np.outer(times, V)
    weights = np.linalg.solve(gram, wanted)
    return times @ weights, 0.5 * np.sum(weights * wanted)


def scenes():
    rng = np.random.default_rng(3)
    for _ in range(50):
        T = rng.uniform(0.1, 10.0)
        X_ap, X_wp, V = rng.normal(size=(3, 3)) * [[20.0], [60.0], [8.0]]
        yield X_ap, X_wp, V, T, T + rng.uniform(0.1, 20.0)


def test_minimum_effort_is_the_control_of_least_norm():
    """(3.32)-(3.33), appendix A.3."""
    a = np.empty(3)
    for X_ap, X_wp, V, T, T_f in scenes():
        meg.command(X_ap, X_wp, V, T, T_f, a)
        expected, _ = least_effort([X_ap, X_wp], np.array([T, T_f]), V)
        assert np.allclose(a, expected, rtol=0, atol=1e-11 * np.abs(expected).max())


def test_it_is_proportional_navigation_where_that_passes_the_waypoint_anyway():
    a, b = np.empty(3), np.empty(3)
    for X_ap, _, V, T, T_f in scenes():
        pn.command(X_ap, V, T, a)
        end = 1.5 * X_ap / T - 0.5 * V  # velocity at the aiming point
        meg.command(X_ap, X_ap + (T_f - T) * end, V, T, T_f, b)
        assert np.allclose(a, b, rtol=0, atol=1e-10 * np.abs(a).max())


def test_its_flight_through_both_points_costs_the_least_effort():
    X_ap, X_wp, V = np.array([20.0, 6.0, -4.0]), np.array([80.0, -3.0, 5.0]), np.array([10.0, 1, 0])
    T, T_f, dt, x, effort = 2.0, 8.0, 1e-3, np.zeros(3), 0.0
    _, least = least_effort([X_ap, X_wp], np.array([T, T_f]), V)
    in_turn = least_effort([X_ap], np.array([T]), V)[1]
    in_turn += least_effort([X_wp - X_ap], np.array([T_f - T]), 1.5 * X_ap / T - 0.5 * V)[1]
    a = np.empty(3)
    for k in range(8000):
        t = k * dt
        if T - t > 0.05:
            meg.command(X_ap - x, X_wp - x, V, T - t, T_f - t, a)
        else:
            pn.command(X_wp - x, V, T_f - t, a)
        effort += 0.5 * dt * a @ a
        x, V = x + dt * (V + 0.5 * dt * a), V + dt * a
    assert effort == pytest.approx(least, rel=0.01)
    assert least < 0.9 * in_turn


@pytest.mark.parametrize(
    ("name", "effort", "closest"),
    [
        ("cone-pn", 47.6, 9.91),
        ("cone-meg", 40.8, 9.98),
        ("cone-pn-literal", 47.6, 9.91),
        ("cone-meg-literal", 61.1, 9.91),
    ],
)
def test_thesis_scenario_with_known_obstacles(air, name, effort, closest):
    """3.5.1 with truth for the estimates, J in ft^2/s^3.

    Figures of an independent implementation. By the letter of (3.20), without a latch, minimum
    effort costs more than proportional navigation.
    """
    flight = air.fly(name, OBSTACLES, RADII, WAYPOINT, V, air.settings())
    assert flight.effort == pytest.approx(effort, abs=0.05)
    assert flight.closest[1] == pytest.approx(closest, abs=0.01)
    assert flight.miss < 0.01
    assert not flight.commands[:, 0].any()


@pytest.mark.parametrize("name", ["cone-pn", "cone-meg"])
def test_without_obstacles_it_is_proportional_navigation_to_the_waypoint(air, name):
    cfg, expected = air.settings(lateral=0), np.empty(3)
    row = air.belief([40.0, 5.0, -3.0], [10.0, -2.0, 1.0], [], [])
    pn.command(row["rhat_WV_N"][0], row["v_V_N"][0], 4.0, expected)
    assert np.array_equal(air.decided(name, row, cfg), expected)
    assert air.decided(name, row, air.settings())[0] == 0.0


@pytest.mark.parametrize("name", ["cone-pn", "cone-meg", "cone-lq"])
def test_a_waypoint_less_than_a_step_ahead_costs_nothing_on_course(air, name):
    """Held for a step, a command would brake for a point that is passed before its end."""
    V, left = np.array([10.0, -2.0, 1.0]), 0.004
    row, cfg = air.belief(left * V, V, [], [], t_go=left), air.settings(lateral=0)
    assert np.allclose(air.decided(name, row, cfg), 0.0, atol=1e-9)


@pytest.mark.parametrize("name", ["cone-pn", "cone-meg"])
def test_with_three_axes_it_avoids_and_arrives_too(air, name):
    cfg = air.settings(lateral=0)
    flight = air.fly(name, OBSTACLES, RADII, WAYPOINT, V, cfg)
    assert (flight.closest > 9.8).all()
    assert flight.miss < 0.1


@pytest.mark.parametrize("name", ["cone-pn", "cone-meg"])
def test_an_obstacle_that_crosses_is_avoided_if_its_velocity_is_known(air, name):
    cross = {"obstacles": [[40.0, 15.0, 1.0]], "velocities": [[0.0, -4.0, 0.0]]}
    known = air.fly(name, radii=[8.0], waypoint=WAYPOINT, V=V, cfg=air.settings(), **cross)
    ignored = air.fly(
        name, radii=[8.0], waypoint=WAYPOINT, V=V, cfg=air.settings(), told=False, **cross
    )
    assert known.closest[0] > 7.8
    assert ignored.closest[0] < 7.0
