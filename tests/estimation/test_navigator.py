"""Hovering over the arena on rendered pictures: the navigator stays where the vehicle is."""

import numpy as np
import pytest

from visenvs.core.units import GRAVITY
from visenvs.estimation.navigator import Navigator, settings
from visenvs.sensors.images.arena import shared_arena
from visenvs.sensors.images.exposure import Exposure, expose
from visenvs.sensors.images.optics import Optics
from visenvs.sensors.images.robots import ROBOT

OPTICS = Optics(320, 240, 277.0)
DOWN = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
BIAS = np.array([0.06, -0.04, 0.03])  # of the accelerometer, m/s^2: half a metre in four seconds


def hover(seeing):
    """Four seconds at 10 Hz; returns the navigator, the true place, and landmarks used."""
    p, arena = np.array([0.4, -0.3, -2.0]), shared_arena(0, False)
    navigator = Navigator.start(OPTICS, DOWN, settings(OPTICS), p, np.zeros(3), np.eye(3))
    feeling = np.zeros((10, 2, 3))
    feeling[:, 0] = BIAS - (0.0, 0.0, GRAVITY)
    robot, used = np.zeros(1, ROBOT), []
    for k in range(40):
        navigator.feel(feeling)
        if seeing:
            robot["place"] = (0.4, -1.5 + 0.05 * k)
            frame = arena.render(OPTICS, DOWN, p, robot)
            used.append(navigator.see(expose(frame, Exposure(), 3, 0, 0, k), 2.0))
    return navigator, p, used


def test_pictures_hold_the_place_and_tell_the_bias():
    navigator, p, used = hover(seeing=True)
    nav = navigator.nav[0]
    assert nav["p"] == pytest.approx(p, abs=0.03)
    assert nav["v"] == pytest.approx(np.zeros(3), abs=0.03)
    assert nav["biases"][0, 2] == pytest.approx(BIAS[2], abs=0.02)
    assert np.mean(used[5:]) > 4.0
    assert (nav["D"] > 0.0).all()


def test_without_pictures_it_drifts_away():
    navigator, p, _ = hover(seeing=False)
    off = navigator.nav[0]["p"] - p
    assert off == pytest.approx(0.5 * 4.0**2 * BIAS, abs=1e-3)
