"""Geometric guidance: two laws that are one, the line that they turn onto, and the spheres."""

import numpy as np
import pytest

from visenvs.guidance.geometric import gain, invert, turn

pytestmark = pytest.mark.kernel

WAYPOINT, V = np.array([800.0, 0.0, 0.0]), np.array([10.0, 0.0, 0.0])


def test_the_sine_with_the_gain_of_appendix_c_is_dynamic_inversion():
    """Nonlinear and differential geometric guidance are the same law, to rounding."""
    rng = np.random.default_rng(0)
    for _ in range(1000):
        u, T, k = (
            rng.choice([-1, 1]) * rng.uniform(0.1, 30),
            rng.uniform(0.05, 60),
            rng.uniform(0, 20),
        )
        v, y = rng.normal(size=2) * [20.0, 200.0]
        size = k * (abs(v) + abs(y / T))
        assert abs(turn(k, u, v, T, y) - invert(k, u, v, T, y)) < 1e-14 * size


def test_the_angle_goes_to_zero_whichever_side_it_is_on():
    """The report's appendix C has the sign of both laws reversed."""
    for v, y in ((3.0, 0.0), (-3.0, 0.0), (0.0, 5.0), (0.0, -5.0)):
        for law in (invert, turn):
            assert np.sign(law(1.0, 10.0, v, 2.0, y)) == np.sign(y / 2.0 - v)


def test_four_time_constants_fit_in_the_share_of_the_time_to_go(air):
    """The lateral velocity is within exp(-4) of the aiming line after 0.6 of the time to go."""
    T, dt, v, y = 10.0, 1e-3, 4.0, 30.0
    k = gain(T, dt)
    error = [abs(v - y / T)]
    for _ in range(6000):
        v += dt * invert(k, 10.0, v, T, y)
        error.append(abs(v - y / T))
    assert error[-1] == pytest.approx(np.exp(-4.0) * error[0], rel=0.01)
    assert gain(1e-9, 0.1) == 10.0


@pytest.mark.parametrize("lateral", [0, 1])
def test_both_fly_the_same_path(air, lateral):
    obstacles, radii = [[400.0, 8.0, -5.0], [650.0, -10.0, 3.0]], [60.0, 60.0]
    cfg = air.settings(dt=0.1, lateral=lateral)
    one, other = (air.fly(n, obstacles, radii, WAYPOINT, V, cfg) for n in ("dgg", "ngg"))
    assert np.abs(one.commands - other.commands).max() < 1e-9
    assert (one.closest > 0.97 * 60.0).all()
    assert one.miss < 1.0


def test_with_three_axes_the_speed_is_kept(air):
    row = air.belief([50.0, 20.0, -9.0], [8.0, -3.0, 2.0], [[30.0, -2.0, 4.0]], [9.0])
    a = air.decided("dgg", row, air.settings(lateral=0))
    assert np.linalg.norm(a) > 0.5
    assert abs(a @ [8.0, -3.0, 2.0]) < 1e-12 * np.linalg.norm(a) * 10.0


def test_it_does_not_steer_without_speed_nor_past_the_waypoint(air):
    cfg = air.settings()
    assert not air.decided("dgg", air.belief(WAYPOINT, 0.0 * V, [], [], t_go=1.0), cfg).any()
    behind = air.belief([-1.0, 5.0, 0.0], V, [], [], t_go=0.0)
    assert not air.decided("dgg", behind, cfg).any()


@pytest.mark.parametrize("x", [-5.0, -0.01, 0.0, 0.01, 5.0])
def test_inside_a_sphere_it_steers_out_before_and_behind_the_centre(air, x):
    """To the point straight out by its distance: the printed rule steers in where x > 0."""
    X, d = np.array([x, 6.0, -3.0]), 10.0
    row = air.belief(WAYPOINT, V, [X], [d])
    a = air.decided("dgg", row, air.settings())
    assert a[1] < 0.0 < a[2]
    assert a[0] == 0.0
    alone = air.decided("dgg", air.belief(WAYPOINT, V, [], []), air.settings())
    assert np.array_equal(air.decided("dgg-open", row, air.settings()), alone)


def test_a_law_that_is_told_the_truth_enters_and_leaves_spheres_by_it(air):
    cfg = air.settings()
    row = air.belief(WAYPOINT, V, [[40.0, 30.0, 0.0]], [10.0])
    row["r_OV_N"][0, :3] = [4.0, 6.0, -3.0]
    assert not air.decided("dgg", row, cfg).any()
    at_truth = air.belief(WAYPOINT, V, [[4.0, 6.0, -3.0]], [10.0])
    assert np.array_equal(air.decided("dgg-told", row, cfg), air.decided("dgg", at_truth, cfg))
    row["rhat_OV_N"], row["r_OV_N"] = row["r_OV_N"].copy(), row["rhat_OV_N"].copy()
    assert not air.decided("dgg-told", row, cfg).any()


def test_hugging_flies_to_a_sphere_that_it_would_have_missed(air):
    where = {"obstacles": [[400.0, 90.0, 0.0]], "radii": [60.0], "waypoint": WAYPOINT, "V": V}
    wide, near = (air.fly(n, cfg=air.settings(dt=0.1), **where) for n in ("dgg", "hug"))
    assert wide.closest[0] == pytest.approx(90.0, rel=1e-3)
    assert near.closest[0] == pytest.approx(60.0, rel=0.02)
    assert near.miss < 1.0
