"""Laws of formation flight with perfect information: what they keep, and fly beside it."""

import math

import numpy as np
import pytest

from visenvs.core.registry import find_law
from visenvs.envs._formation_layout import OBSERVATION
from visenvs.guidance.excitation import optimal_path

pytestmark = pytest.mark.kernel

DT, SPEED, OFFSET = 0.1, 20.0, np.array([28.0, 5.0, -3.0])
NUMBERS = {"dt": DT, "a_max": 5.0, "sigma_image": 2e-3, "meander_reach": 3.0}
NUMBERS |= {"meander_segment": 8.0, "meander_weight": 2000.0}
SETTINGS = np.dtype(
    [*((name, "f8") for name in NUMBERS), ("speed", "f8", 2), ("meander_window", "f8", 2)]
)
FIRM_LAWS = ("follow", "follow-firm", "follow-ff", "follow-firm-ff", "follow-headway-2")


def settings(**changes):
    out = np.zeros(1, SETTINGS)
    for name, value in (NUMBERS | {"speed": SPEED, "meander_window": (0.0, 1e9)} | changes).items():
        out[name] = value
    return out


def turned(angle, vector):
    """A vector of N in a frame of that heading."""
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]) @ vector


def fly(name, seconds, leader, error=(0.0, 0.0, 0.0), omega=0.0, sd=1.0, cfg=None):
    """Fly a point mass without a lag, with perfect information, in small steps.

    Args:
        leader: t -> position (3,).
        error: of the place at the start.
        omega: turn rate of the frame of the offset, in which the vehicle flies too.

    Returns the relative positions and the own accelerations in that frame, (k, 3) each.
    """
    law, row = find_law(name), np.zeros(1, OBSERVATION.dtype)
    cfg, h = settings() if cfg is None else cfg, 1e-3
    memory = None if law.memory is None else np.zeros((1, law.memory(cfg[0], 3)))
    spin, heading = np.array([0.0, 0.0, omega]), 0.0
    r = leader(0.0) - OFFSET - error
    v = (leader(h) - leader(-h)) / (2 * h) - np.cross(spin, OFFSET)
    places, pushes = [], []
    for k in range(round(seconds / DT)):
        t = k * DT
        velocity = (leader(t + h) - leader(t - h)) / (2 * h)
        accel = (leader(t + h) - 2 * leader(t) + leader(t - h)) / h**2
        row["rhat_LV_F"] = turned(heading, leader(t) - r)
        row["vhat_LV_F"] = turned(heading, velocity - v)
        row["ahat_L_F"] = turned(heading, accel)
        row["v_V_F"], row["offset_F"] = turned(heading, v), OFFSET
        row["offset_rate"] = row["turn_rate"] = omega
        row["sd_log_range"] = sd
        command = np.full((1, 3), np.nan)
        law.decide(row, cfg, *(() if memory is None else (memory,)), command)
        places.append(row["rhat_LV_F"][0].copy())
        pushes.append(command[0])
        push = turned(-heading - 0.5 * omega * DT, command[0])
        r, v = r + DT * v + 0.5 * DT**2 * push, v + DT * push
        row["a_V_F"] = command[0]
        heading += omega * DT
    return np.array(places), np.array(pushes)


def straight(t):
    return np.array([SPEED * t, 0.0, 0.0])


def circle(t, omega=0.1):
    return np.array([math.sin(omega * t), 1 - math.cos(omega * t), 0.0]) * SPEED / omega


@pytest.mark.parametrize("name", FIRM_LAWS)
def test_an_error_decays_behind_a_straight_leader(name):
    places, _ = fly(name, 40.0, straight, error=(3.0, -4.0, 2.0))
    assert np.linalg.norm(places[0] - OFFSET) > 5.0
    assert np.abs(places[-1] - OFFSET).max() < 0.01


@pytest.mark.parametrize("name", FIRM_LAWS[:4])
def test_the_place_is_kept_in_a_turn(name):
    places, pushes = fly(name, 60.0, circle, omega=0.1)
    assert np.abs(places - OFFSET).max() < 0.2
    # the follower turns on a circle of its own about the same centre
    radius = math.hypot(SPEED / 0.1 + OFFSET[1], OFFSET[0])
    assert np.linalg.norm(pushes[-1]) == pytest.approx(0.01 * radius, rel=0.02)


def test_both_gains_are_critically_damped():
    for name, root in (("follow", 0.4), ("follow-firm", 0.6)):
        places, _ = fly(name, 30.0, straight, error=(1.0, 0.0, 0.0))
        t = DT * np.arange(len(places))
        assert places[:, 0] - OFFSET[0] == pytest.approx(
            (1 + root * t) * np.exp(-root * t), abs=0.03
        )


def test_headway_asks_for_more_room_at_more_speed():
    places, _ = fly("follow-headway-2", 60.0, lambda t: 1.1 * straight(t))
    assert places[-1] - OFFSET == pytest.approx([2.0 * 0.1 * SPEED, 0.0, 0.0], abs=0.02)
    assert find_law("follow-headway-1.5").name == "follow-headway-1.5"
    assert find_law("follow-headway-x") is None


@pytest.mark.parametrize(("name", "gain"), [("follow", 1.19), ("follow-headway-2", 0.8)])
def test_a_headway_is_what_keeps_a_chain_from_growing(name, gain):
    """Amplitude of the follower over the leader's, at 0.4 rad/s along the course."""
    w, reach = 0.4, 2.0

    def swaying(t):
        return np.array([SPEED * t + reach * math.sin(w * t), 0.0, 0.0])

    places, _ = fly(name, 150.0, swaying)
    t = DT * np.arange(len(places))
    own = (np.array([swaying(s)[0] for s in t]) - places[:, 0] - SPEED * t)[-942:]
    mean, basis = own.mean(), np.exp(-1j * w * t[-942:])
    amplitude = 2 * abs(np.mean((own - mean) * basis)) / reach
    if name == "follow":  # told the acceleration, it only suffers from the period
        assert amplitude == pytest.approx(1.0, abs=0.05)
    else:
        assert amplitude < gain


def test_the_optimal_meander_is_flown():
    places, _ = fly("follow-optimal", 24.0, straight)
    beside = places[:, 1] - OFFSET[1]
    ends = [(0.0, 0.0, 3.0, 0.0), (3.0, 0.0, -3.0, 0.0), (-3.0, 0.0, 3.0, 0.0)]
    wanted = [optimal_path(end, 8.0, 2e-3, 2000.0, DT * k)[0] for end in ends for k in range(80)]
    assert beside == pytest.approx(wanted, abs=0.12)
    assert np.abs(places[:, [0, 2]] - OFFSET[[0, 2]]).max() < 1e-5


def test_the_sine_is_flown():
    places, _ = fly("follow-sine", 60.0, straight)
    t = DT * np.arange(len(places))
    wanted = OFFSET[1] + 3.0 * np.sin(2 * math.pi * t / 16.0)
    assert places[300:, 1] == pytest.approx(wanted[300:], abs=0.1)


@pytest.mark.parametrize("name", ["follow-optimal", "follow-sine", "follow-scheduled"])
def test_beyond_its_window_it_keeps_the_offset(name):
    cfg = settings(meander_window=(8.0, 40.0))
    places, _ = fly(name, 80.0, straight, cfg=cfg)
    beside = np.abs(places[:, 1] - OFFSET[1])
    assert beside[:80].max() < 1e-9
    assert beside[80:400].max() > 2.5
    assert beside[700:].max() < 0.02


def test_a_schedule_flies_less_where_the_range_is_known():
    reach = [
        np.ptp(fly("follow-scheduled", 40.0, straight, sd=sd)[0][:, 1]) for sd in (0.0, 0.05, 1.0)
    ]
    full = np.ptp(fly("follow-optimal", 40.0, straight)[0][:, 1])
    assert reach[2] == pytest.approx(full)
    assert reach[0] < 0.2 * reach[1] * 2 < 0.9 * full
    assert reach[1] < 0.5 * full
