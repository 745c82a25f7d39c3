"""Linear-quadratic and one-step-ahead guidance to aiming points."""

import numpy as np
import pytest

from visenvs.guidance import lq
from visenvs.guidance.collision_cone import coordinates, tangents
from visenvs.guidance.planner import prices

pytestmark = pytest.mark.kernel

WAYPOINT, V = np.array([100.0, 20.0, 20.0]), np.array([10.0, 2.0, 2.0])
X, D = np.array([40.0, 6.0, 10.0]), 10.0
CHOL = np.array([[8.0, 0.0, 0.0], [1.0, 2.0, 0.0], [1.5, 0.3, 1.0]])


def critical():
    """The tangent to the obstacle, and its time to go."""
    p, other = np.empty(3), np.empty(3)
    tangents(X, V, D, coordinates(X, V, D)[0], p, other)
    return p, p[0] / V[0]


def row_of(air, **changes):
    row = air.belief(WAYPOINT, V, [X], [D], **changes)
    row["chol_OV"][0, :6] = CHOL[np.tril_indices(3)]
    return row


def test_the_terminal_law_flies_to_the_waypoint_with_the_lateral_velocity_zero(air):
    """(4.40)-(4.41): the weights count lateral miss and lateral velocity."""
    row, expected = air.belief(WAYPOINT, V, [], []), np.empty(2)
    lq.command(WAYPOINT[1:], V[1:], 10.0, 100.0, 10.0, expected)
    for name in ("cone-lq", "cone-osa"):
        a = air.decided(name, row, air.settings())
        assert a[1:] == pytest.approx(expected, rel=1e-12)
        assert a[0] == 0.0


def test_the_terminal_law_flies_to_the_aiming_point(air):
    """(4.42)-(4.43)."""
    (p, T), expected = critical(), np.empty(2)
    lq.command(p[1:], V[1:], T, 100.0, 10.0, expected)
    a = air.decided("cone-lq", row_of(air), air.settings())
    assert a[1:] == pytest.approx(expected, rel=1e-12)


def test_with_three_axes_it_avoids_and_arrives_too(air):
    """The velocity that it wants is the one straight there: nothing is commanded on course."""
    cfg = air.settings(lateral=0)
    assert np.allclose(air.decided("cone-lq", air.belief(WAYPOINT, V, [], []), cfg), 0, atol=1e-13)
    flight = air.fly("cone-lq", [[50.0, 8.0, 9.0]], [8.0], WAYPOINT, V, cfg)
    assert flight.closest[0] > 7.7
    assert flight.miss < 0.1


@pytest.mark.parametrize("velocity", [[0.0, 0.0, 0.0], [-1.0, 2.0, 0.5]])
def test_the_push_is_the_thesis_formula_for_the_image_of_the_obstacle(air, velocity):
    """(4.35) differentiated numerically, where the command to the aiming point leads."""
    cfg = air.settings(dt=0.1, sigma_angle=0.02, t_critical=1e9)
    row = row_of(air, velocities=[velocity])
    terminal = air.decided("cone-lq", row, cfg)
    added = air.decided("cone-osa", row, cfg) - terminal
    W = V - velocity
    p, other = np.empty(3), np.empty(3)
    tangents(X, W, D, coordinates(X, W, D)[0], p, other)
    calS, calB = prices(p[0] / W[0] - 0.1, 0.1, 100.0, 10.0)

    def told(da):
        x = X - 0.1 * W - 0.005 * (terminal + da)
        H = np.array([[-x[1] / x[0], 1, 0], [-x[2] / x[0], 0, 1]]) / x[0]
        P, R = CHOL @ CHOL.T, (1.0 / x[0] ** 2 + 0.02**2) * np.eye(2)
        return calS * np.trace(P @ H.T @ np.linalg.solve(H @ P @ H.T + R, H @ P))

    slope = [(told(e) - told(-e)) / 0.2 for e in 0.1 * np.eye(3)]
    assert added[0] == 0.0
    assert added[1:] == pytest.approx(0.5 * np.array(slope)[1:] / calB, rel=1e-4)
    assert np.linalg.norm(added) > 1e-3 * np.linalg.norm(terminal)


def test_certainty_needs_no_push(air):
    row, cfg = row_of(air), air.settings()
    row["chol_OV"] = 0.0
    assert np.array_equal(air.decided("cone-osa", row, cfg), air.decided("cone-lq", row, cfg))


def test_inside_the_sphere_it_can_aim_abeam(air):
    """Where there are no tangents, to the side that the velocity leads to."""
    row, cfg = air.belief(WAYPOINT, V, [[8.0, 1.0, 0.0]], [D]), air.settings()
    alone = air.decided("cone-lq", air.belief(WAYPOINT, V, [], []), cfg)
    assert np.array_equal(air.decided("cone-lq", row, cfg), alone)
    assert (air.decided("cone-lq-abeam", row, cfg)[1:] > alone[1:] + 10.0).all()


def estimated(air, name, seed):
    """Least distances and effort of thesis 4.2.4 in feet: extended Kalman filters, 50 % too far."""
    rng, cfg, dt = np.random.default_rng(seed), air.settings(dt=0.1), 0.1
    obstacles = np.array([[30.0, 6.0, 6.0], [60.0, 20.0, 15.0]])
    x, v, memory, effort = np.zeros(3), V.copy(), air.fresh(name, cfg), 0.0
    guess, P, closest = 1.5 * obstacles, np.array([400.0 * np.eye(3)] * 2), np.full(2, np.inf)
    for _ in range(100):
        for i in range(2):
            r, e = obstacles[i] - x, guess[i] - x
            noise = rng.standard_normal(2)
            if r[0] < 1.0 or e[0] < 1.0:
                continue
            z, h = (r[1:] + noise) / r[0], e[1:] / e[0]
            H = np.array([[-h[0], 1, 0], [-h[1], 0, 1]]) / e[0]
            G = P[i] @ H.T @ np.linalg.inv(H @ P[i] @ H.T + np.eye(2) / e[0] ** 2)
            guess[i], P[i] = guess[i] + G @ (z - h), P[i] - G @ H @ P[i]
        row = air.belief(WAYPOINT - x, v, guess - x, [10.0, 10.0])
        factors = [np.linalg.cholesky(p + 1e-12 * np.eye(3))[np.tril_indices(3)] for p in P]
        row["chol_OV"][0, :12] = np.ravel(factors)
        a = air.decided(name, row, cfg, memory)
        effort += 0.5 * dt * a @ a
        x, v = x + dt * (v + 0.5 * dt * a), v + dt * a
        closest = np.minimum(closest, np.linalg.norm(obstacles - x, axis=1))
    return *closest, effort


def test_the_push_keeps_out_of_the_sphere_that_the_estimate_leads_into(air):
    """Thesis 4.2.4, figures 44 and 45: violation with the one law, none with the other.

    By the letter of (3.20), and from inside the estimated sphere abeam.
    """
    without, pushed = (
        np.array([estimated(air, name, seed) for seed in range(12)])
        for name in ("cone-lq-abeam", "cone-osa-abeam")
    )
    assert (without[:, 0] < 10.0).all()
    assert (pushed[:, 0] > 10.0).all()
    assert 1.2 < pushed[:, 2].mean() / without[:, 2].mean() < 2.5
