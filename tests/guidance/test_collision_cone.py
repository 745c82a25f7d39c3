"""The collision cone against its definition: what touches the sphere, and what leads into it."""

import numpy as np
import pytest

from visenvs.guidance.collision_cone import (
    abeam,
    coordinates,
    is_farther,
    leads_in,
    tangents,
    time_to,
    way_out,
)

pytestmark = pytest.mark.kernel


def scenes(n=300):
    """Spheres around a vehicle that is outside of them, and relative velocities of all kinds."""
    rng = np.random.default_rng(0)
    for _ in range(n):
        X = rng.normal(size=3) * rng.uniform(1, 50)
        V = rng.normal(size=3) + X / norm(X)
        yield X, rng.uniform(1, 20) * V, rng.uniform(0.01, 0.999) * norm(X)


def norm(v):
    return np.linalg.norm(v)


def angle(p, q):
    return np.arctan2(norm(np.cross(p, q)), p @ q)


def both(X, V, d):
    p1, p2 = np.empty(3), np.empty(3)
    c, a, b = coordinates(X, V, d)
    tangents(X, V, d, c, p1, p2)
    return p1, p2, a, b


def test_tangents_touch_the_sphere_and_span_the_velocity():
    for X, V, d in scenes():
        p1, p2, a, b = both(X, V, d)
        size = norm(X)
        for p in (p1, p2):
            assert norm(p - X) == pytest.approx(d, rel=1e-9)
            assert abs(p @ (p - X)) < 1e-9 * size * size
        assert np.allclose(a * p1 + b * p2, V, rtol=0, atol=1e-8 * norm(V))


def test_a_velocity_is_in_the_cone_where_its_ray_meets_the_sphere():
    inside = 0
    for X, V, d in scenes():
        _, a, b = coordinates(X, V, d)
        assert leads_in(a, b) == (a > 0 and b > 0)
        hit = angle(X, V) < np.arcsin(d / norm(X))
        assert (a > 0 and b > 0) == hit
        inside += hit
    assert 60 < inside < 240


def test_the_first_tangent_is_always_the_nearer_one():
    """The second line of (3.21) cannot happen."""
    for X, V, d in scenes():
        p1, p2, a, b = both(X, V, d)
        assert a > b
        assert angle(p1, V) < angle(p2, V)


@pytest.mark.parametrize("forward", [1.0, -1.0])
def test_head_on_there_is_no_plane_but_a_cone(forward):
    X, d = np.array([30.0, 6.0, 6.0]), 10.0
    V = forward * X / 3.0  # thesis 4.2.4
    c, a, b = coordinates(X, V, d)
    assert c == np.inf
    assert a == b
    assert a * forward > 0
    _, near_a, near_b = coordinates(X, V + 1e-3 * np.eye(3)[1], d)
    assert (near_a, near_b) == pytest.approx((a, b), rel=1e-3)


def test_standing_still_is_head_on_and_no_threat():
    assert coordinates(np.array([3.0, 4.0, 0.0]), np.zeros(3), 1.0) == (np.inf, 0.0, 0.0)


@pytest.mark.parametrize("X", [[3.0, 4.0, 0.0], [1.0, 1.0, 1.0], [0.0, 0.0, 0.0]])
def test_on_and_inside_the_sphere_there_are_no_tangents(X):
    assert coordinates(np.array(X), np.array([1.0, 0.3, 0.0]), 5.0) == (0.0, 0.0, 0.0)


def test_the_way_out_is_the_nearest_point_of_the_sphere():
    X, d, p = np.array([1.0, 2.0, -2.0]), 10.0, np.empty(3)
    assert way_out(X, d, p)
    assert norm(p - X) == pytest.approx(d)
    assert norm(p) == pytest.approx(d - norm(X))
    assert p == pytest.approx(-7.0 * X / 3.0)
    assert not way_out(np.zeros(3), d, p)


def test_abeam_is_across_the_line_of_sight_to_the_side_of_the_velocity():
    for X, V, d in scenes(50):
        p = np.empty(3)
        assert abeam(X, V, d, p)
        assert norm(p - X) == pytest.approx(d)
        assert abs((p - X) @ X) < 1e-9 * d * norm(X)
        assert abs((p - X) @ np.cross(X, V)) < 1e-9 * d * norm(X) * norm(V)
        assert (p - X) @ V > 0
    assert not abeam(np.array([1.0, 2.0, 3.0]), np.array([2.0, 4.0, 6.0]), 5.0, np.empty(3))


def test_the_farther_point_is_told_from_the_middle_of_the_overlap():
    """In a plane that is the middle of the chord through both points where the circles cross."""
    X, Y, d, e = np.array([0.0, 0.0, 0.0]), np.array([4.0, 0.0, 0.0]), 3.0, 2.0
    x = (16.0 + 9.0 - 4.0) / 8.0
    crossing = np.array([x, np.sqrt(9.0 - x * x), 0.0])
    assert norm(crossing - Y) == pytest.approx(e)
    middle = np.array([x, 0.0, 0.0])
    rng = np.random.default_rng(1)
    for _ in range(50):
        p, q = rng.normal(size=(2, 3)) * 5
        assert is_farther(p, q, X, d, Y, e) == (norm(p - middle) >= norm(q - middle))
    assert is_farther(X + d, X - d, X, d, X, d)  # the same sphere twice: any point is as far


def test_time_to_a_point():
    p, V = np.array([30.0, 8.0, 0.0]), np.array([10.0, 5.0, 0.0])
    assert time_to(p, V, True) == 3.0
    t = time_to(p, V, False)
    here, before, after = (norm(p - (t + h) * V) for h in (0.0, -1e-3, 1e-3))
    assert here < min(before, after)
    assert time_to(p, np.array([0.0, 5.0, 0.0]), True) == -1.0
    assert time_to(p, np.zeros(3), False) == -1.0
    assert time_to(-p, V, True) == -3.0
