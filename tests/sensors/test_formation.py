"""The camera that looks for a leader: geometry by projection, noise, dropouts, view."""

import math

import numpy as np
import pytest

from visenvs.core.units import GRAVITY
from visenvs.estimation.formation import LEADER, SIGHT
from visenvs.sensors.formation import (
    FACING,
    FLAT,
    NONE,
    POINTS,
    WINGS,
    half_wing,
    in_view,
    linked,
    take_sight,
)

pytestmark = pytest.mark.kernel

B, HEADING = 3.0, 0.7
SETTINGS = np.dtype([
    ("wings", "i8"), ("sigma_image", "f8"), ("view", "f8", 2), ("p_lose", "f8"), ("p_regain", "f8"),
])  # fmt: skip


def settings(wings=FACING, sigma=0.0):
    cfg = np.zeros(1, SETTINGS)
    cfg["wings"], cfg["sigma_image"] = wings, sigma
    cfg["view"], cfg["p_lose"], cfg["p_regain"] = (0.5, 0.4), 0.05, 0.25
    return cfg[0]


def leader(course=HEADING, turn=0.0, speed=20.0):
    record = np.zeros(1, LEADER)
    v = speed * np.array([math.cos(course), math.sin(course)])
    record["v_N"][0, :2], record["wingspan"] = v, B
    record["a_N"][0, :2] = turn * np.array([-v[1], v[0]])
    return record[0]


def ahead(*offset):
    """A place in the frame of the heading, in N."""
    c, s = math.cos(HEADING), math.sin(HEADING)
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ offset


def take(r, wings=FACING, sigma=0.0, step=1, **who):
    sight = np.zeros(1, SIGHT)
    take_sight(r, HEADING, leader(**who), settings(wings, sigma), 5, 0, 0, step, 0, sight[0])
    return sight[0]


def test_without_noise_the_direction_is_the_leaders():
    r = ahead(30.0, -5.0, 4.0)
    assert take(r)["u_N"] == pytest.approx(r / np.linalg.norm(r), abs=1e-12)


def test_a_wing_that_faces_the_camera_from_ahead_is_the_same_for_all_models():
    r = ahead(30.0, 0.0, 0.0)
    expected = 2 * math.atan(0.5 * B / 30.0)
    for wings in (FACING, POINTS, FLAT):
        assert take(r, wings)["alpha"] == pytest.approx(expected, rel=1e-9)
    assert take(r, NONE)["alpha"] == 0.0
    assert [WINGS[k] for k in (FACING, POINTS, FLAT, NONE)] == list(WINGS)


def test_tips_are_projected_from_a_banked_and_turned_wing():
    """UKF paper (18) by hand: both tips through the pinhole, seen from the optical centre."""
    r, course, turn = ahead(30.0, -4.0, -6.0), HEADING + 0.3, 0.1
    bank = math.atan(20.0 * turn / GRAVITY)
    right = np.array([-math.sin(course), math.cos(course), 0.0])
    wing = 0.5 * B * (math.cos(bank) * right + math.sin(bank) * np.array([0.0, 0.0, 1.0]))
    assert half_wing(leader(course, turn)) == pytest.approx(wing, abs=1e-12)
    c, s = math.cos(HEADING), math.sin(HEADING)
    to_camera = np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])
    points = []
    for place in (r - wing, r, r + wing):
        X, Y, Z = to_camera @ place
        points.append(np.array([Y / X, Z / X]))
    span, centre = np.hypot(*(points[2] - points[0])), points[1]
    off_axis = math.sqrt(1.0 + centre @ centre)
    seen = take(r, POINTS, course=course, turn=turn)["alpha"]
    assert seen == pytest.approx(2 * math.atan(0.5 * span / off_axis), rel=1e-9)
    seen = take(r, FLAT, course=course, turn=turn)["alpha"]  # thesis (2.24)
    assert seen == pytest.approx(2 * math.atan(0.5 * span), rel=1e-9)


def test_noise_has_the_size_that_the_filters_are_told():
    r, sigma, n = ahead(30.0, 0.0, 0.0), 0.002, 2000
    sights = [take(r, FACING, sigma, step) for step in range(n)]
    u = np.array([sight["u_N"] for sight in sights]) @ np.array([ahead(0, 1, 0), ahead(0, 0, 1)]).T
    alpha = np.array([sight["alpha"] for sight in sights]) - 2 * math.atan(0.5 * B / 30.0)
    for values, size in ((u[:, 0], sigma), (u[:, 1], sigma), (alpha, math.sqrt(2) * sigma)):
        assert values.mean() == pytest.approx(0.0, abs=4 * size / math.sqrt(n))
        assert values.std() == pytest.approx(size, rel=0.08)
    assert np.corrcoef(np.c_[u, alpha].T) == pytest.approx(np.eye(3), abs=0.1)


def test_dropouts_are_a_markov_chain_with_its_stationary_share():
    cfg, works, held = settings(), 1.0, []
    for step in range(20_000):
        works = linked(works, cfg, 3, 0, 0, step, 0)
        held.append(works)
    held = np.array(held)
    assert held.mean() == pytest.approx(0.25 / 0.30, abs=0.03)
    assert 1.0 - held[1:][held[:-1] == 1].mean() == pytest.approx(0.05, abs=0.01)
    assert held[1:][held[:-1] == 0].mean() == pytest.approx(0.25, abs=0.03)


def test_the_picture_is_a_rectangle_ahead():
    cfg = settings()
    wide, high = math.tan(0.5), math.tan(0.4)
    assert in_view(ahead(10.0, 9.99 * wide, -9.99 * high), HEADING, cfg)
    assert not in_view(ahead(10.0, 10.01 * wide, 0.0), HEADING, cfg)
    assert not in_view(ahead(10.0, 0.0, 10.01 * high), HEADING, cfg)
    assert not in_view(ahead(-10.0, 0.0, 0.0), HEADING, cfg)
