"""Velocity obstacles: what is chosen, and flights past obstacles."""

import numpy as np
import pytest

from visenvs.guidance.velocity_obstacle import AROUND, allowed, tangent

pytestmark = pytest.mark.kernel

WAYPOINT, V = np.array([80.0, 0.0, 0.0]), np.array([10.0, 0.0, 0.0])
OBSTACLES, RADII = [[20.0, -5.0, 5.0], [50.0, 5.0, -5.0]], [10.0, 10.0]


def test_the_candidates_touch_the_sphere_all_around():
    X, d, C, p = np.array([20.0, -5.0, 8.0]), 7.0, np.empty((3, 3)), np.empty(3)
    around = np.zeros(3)
    for k in range(AROUND):
        tangent(X, d, k, C, p)
        assert np.linalg.norm(p) == pytest.approx(1.0)
        assert np.linalg.norm(np.cross(X, p)) == pytest.approx(d)
        assert X @ p > 0.0
        around += p / AROUND
    assert np.linalg.norm(np.cross(around, X)) < 1e-12 * np.linalg.norm(X)
    tangent(X, 2.0 * np.linalg.norm(X), 5, C, p)
    assert abs(p @ X) < 1e-12 * np.linalg.norm(X)


def test_a_velocity_is_allowed_if_nothing_is_hit_in_time(air):
    """Straight flight against the distance that it keeps, sampled."""
    rng, W, t = np.random.default_rng(2), np.empty(3), np.linspace(0.0, 5.0, 2001)
    found = np.zeros(2, int)
    for _ in range(200):
        places = rng.uniform([10.0, -18.0, -18.0], [45.0, 18.0, 18.0], (3, 3))
        speeds, radii = rng.normal(size=(3, 3)) * 3.0, rng.uniform(2.0, 9.0, 3)
        row = air.belief(WAYPOINT, V, places, radii, velocities=speeds)
        flown = [x - np.outer(t, V - v) for x, v in zip(places, speeds, strict=True)]
        room = [np.linalg.norm(x, axis=1) - d for x, d in zip(flown, radii, strict=True)]
        when = [t[r.argmin()] for r in room]
        if max(when) > 4.9 or min(when) < 0.1 or np.abs(np.min(room, axis=1)).min() < 0.05:
            continue  # too close to call by sampling
        free = bool(allowed(row[0], V, W))
        assert free == (np.min(room) > 0.0)
        found[int(free)] += 1
    assert found.min() > 20


def test_the_wanted_velocity_is_flown_where_it_is_allowed(air):
    row = air.belief([80.0, 8.0, 0.0], V, [[30.0, 20.0, 0.0]], [8.0])
    a = air.decided("vo", row, air.settings())
    assert a == pytest.approx([0.0, 4.0 / (0.6 * 8.0), 0.0])


@pytest.mark.parametrize("lateral", [0, 1])
@pytest.mark.parametrize("where", ["before", "aside", "behind"])
def test_inside_a_sphere_it_leaves(air, lateral, where):
    X = {"before": [6.0, 3.0, 0.0], "aside": [0.0, 6.0, 0.0], "behind": [-6.0, 3.0, 0.0]}[where]
    a = air.decided("vo", air.belief(WAYPOINT, V, [X], [9.0]), air.settings(lateral=lateral))
    assert a[1] < 0.0
    assert lateral == 0 or a[0] == 0.0


@pytest.mark.parametrize("lateral", [0, 1])
def test_it_flies_around_what_is_in_the_way(air, lateral):
    cfg = air.settings(lateral=lateral)
    flight, other = (air.fly(n, OBSTACLES, RADII, WAYPOINT, V, cfg) for n in ("vo", "dgg"))
    assert (flight.closest > 9.99).all()
    assert flight.effort < 0.5 * other.effort
    assert flight.miss < 0.2


@pytest.mark.parametrize("lateral", [0, 1])
def test_of_two_that_cross_neither_is_hit(air, lateral):
    cross = {"obstacles": [[40.0, 15.0, 1.0], [30.0, -16.0, 3.0]], "radii": [8.0, 6.0]}
    cross |= {"velocities": [[0.0, -4.0, 0.0], [0.0, 5.0, -1.0]]}
    flight = air.fly("vo", waypoint=WAYPOINT, V=V, cfg=air.settings(lateral=lateral), **cross)
    assert (flight.closest > np.array([8.0, 6.0]) - 0.02).all()


def test_where_no_way_is_free_the_wanted_velocity_stays(air):
    """A wall of spheres: a documented outcome, not an error."""
    wall = [[20.0, y, z] for y in (-8.0, 8.0) for z in (-8.0, 8.0)]
    row = air.belief(WAYPOINT, V, wall, [22.9] * 4)
    assert np.array_equal(air.decided("vo", row, air.settings()), np.zeros(3))


def test_all_commands_are_finite(air):
    rng = np.random.default_rng(1)
    for k in range(40):
        places = rng.normal(size=(6, 3)) * 20.0
        places[0] *= k % 3
        row = air.belief(WAYPOINT, 2.0 * V * (k % 4 - 1), places, rng.uniform(1, 20, 6), t_go=8.0)
        for lateral in (0, 1):
            assert np.isfinite(air.decided("vo", row, air.settings(lateral=lateral))).all()
