"""Observer manoeuvres: information against explicit filtering, symmetry, and who beats whom."""

import math
from itertools import pairwise

import numba
import numpy as np
import pytest

from agents.classical import LawPolicy
from agents.policy import NotApplicable
from eval.rollout import rollout
from visenvs.core.config import to_record
from visenvs.core.registry import find_law, laws, load_task
from visenvs.guidance.observability import COURSES, information_gain

pytestmark = pytest.mark.kernel

TASK = load_task("visenvs/BearingsOnly-v0")
CONFIG = TASK.scenarios["random"]
SETTINGS = to_record(CONFIG)
NAMES = ("straight", "perpendicular", "d-optimal", "d-optimal-10")


def beliefs(count, seed=0):
    """Random beliefs: records of the observation layout, and their covariances in L."""
    rng = np.random.default_rng(seed)
    out = np.zeros(count, TASK.observation.dtype)
    out["range_hat"] = rng.uniform(500.0, 4000.0, count)
    out["vhat_T_L"] = rng.normal(size=(count, 2)) * 5.0
    course = rng.uniform(-math.pi, math.pi, count)
    out["v_V_L"] = 18.0 * np.stack([np.cos(course), np.sin(course)], axis=1)
    out["t_go"] = 200.0
    covariances = np.empty((count, 4, 4))
    for i in range(count):
        root = rng.normal(size=(4, 4)) * [[500.0], [60.0], [5.0], [5.0]]
        covariances[i] = root @ root.T + np.diag([50.0, 50.0, 1.0, 1.0])
        packed = np.linalg.cholesky(covariances[i])[np.tril_indices(4)]
        out["chol_r"][i], out["chol_v"][i] = packed[:3], packed[3:]
    return out, covariances


def commands(name, given):
    out = np.full((len(given), 1), np.nan)
    find_law(name).decide(given, SETTINGS, out)
    return out[:, 0]


def path(belief, course, steps, substeps=50):
    """Target relative to the observer after every step, each flown in many short ones."""
    r, heading = np.array([belief["range_hat"], 0.0]), math.atan2(*belief["v_V_L"][::-1])
    speed, dt = np.hypot(*belief["v_V_L"]), CONFIG.dt
    left = (course - heading + math.pi) % (2 * math.pi) - math.pi
    out = np.empty((steps, 2))
    for k in range(steps):
        bend = np.clip(left, -CONFIG.turn_max * dt, CONFIG.turn_max * dt)
        for j in range(substeps):
            angle = heading + bend * (j + 0.5) / substeps
            own = speed * np.array([math.cos(angle), math.sin(angle)])
            r = r + dt / substeps * (belief["vhat_T_L"] - own)
        heading, left = heading + bend, left - bend
        out[k] = r
    return out


def filtered(belief, P, course, steps):
    """log det of the covariance before minus after `steps` linear updates, one by one."""
    before, Phi = np.linalg.slogdet(P)[1], np.eye(4) + CONFIG.dt * np.eye(4, k=2)
    variance = CONFIG.sigma_bearing**2 / CONFIG.p_detect
    for north, east in path(belief, course, steps):
        P = Phi @ P @ Phi.T
        h = np.array([-east, north, 0.0, 0.0]) / (north**2 + east**2)
        P = P - np.outer(P @ h, P @ h) / (h @ P @ h + variance)
    return before - np.linalg.slogdet(P)[1]


@pytest.mark.parametrize("steps", [1, 3, 10])
def test_the_gain_is_what_a_linear_filter_would_find(steps):
    given, covariances = beliefs(8)
    courses = np.random.default_rng(1).uniform(-6.0, 6.0, 8)
    for belief, P, course in zip(given, covariances, courses, strict=True):
        gain = information_gain(belief, course, steps, SETTINGS[0], np.empty((4, 4)))
        # the chord is flown with the arc's mean direction: equal but for the turn's curvature
        assert gain == pytest.approx(filtered(belief, P, course, steps), rel=5e-3)


def test_nothing_is_to_be_learnt_about_what_is_known():
    given, _ = beliefs(5)
    given["chol_r"] = given["chol_v"] = 0.0
    for belief in given:
        assert information_gain(belief, 1.0, 10, SETTINGS[0], np.empty((4, 4))) == 0.0
    assert commands("d-optimal", given).tolist() == [0.0] * 5


@pytest.mark.parametrize(("name", "steps"), [("d-optimal", 1), ("d-optimal-10", 10)])
def test_the_d_optimal_course_is_the_best_of_those_compared(name, steps):
    given, _ = beliefs(20, seed=2)
    for belief, command in zip(given, commands(name, given), strict=True):
        heading = math.atan2(*belief["v_V_L"][::-1])
        courses = heading + 2 * math.pi * np.arange(COURSES) / COURSES
        gains = [
            information_gain(belief, course, steps, SETTINGS[0], np.empty((4, 4)))
            for course in courses
        ]
        off = np.angle(np.exp(1j * (courses[int(np.argmax(gains))] - heading)))
        assert abs(command) == pytest.approx(min(abs(off) / CONFIG.dt, CONFIG.turn_max), rel=1e-6)
        assert abs(off) > 3.1 or command * off >= 0.0


def test_the_horizon_ends_with_the_episode():
    given, _ = beliefs(20, seed=3)
    given["t_go"] = 4 * CONFIG.dt
    assert np.array_equal(commands("d-optimal-4", given), commands("d-optimal-999", given))
    assert not np.array_equal(commands("d-optimal-4", given), commands("d-optimal-1", given))


@pytest.mark.parametrize("name", NAMES)
def test_what_is_mirrored_is_answered_by_the_mirrored_turn(name):
    given, covariances = beliefs(50, seed=4)
    mirror = np.diag([1.0, -1.0, 1.0, -1.0])
    other = given.copy()
    for field in ("vhat_T_L", "v_V_L"):
        other[field][:, 1] *= -1.0
    for i, P in enumerate(covariances):
        packed = np.linalg.cholesky(mirror @ P @ mirror)[np.tril_indices(4)]
        other["chol_r"][i], other["chol_v"][i] = packed[:3], packed[3:]
    turns, mirrored = commands(name, given), commands(name, other)
    assert turns == pytest.approx(-mirrored, abs=1e-9)
    assert (np.abs(turns) <= CONFIG.turn_max).all()
    assert name == "straight" or (np.abs(turns) > 1e-3).sum() > 25


def test_perpendicular_turns_to_the_nearer_side():
    given = np.zeros(3, TASK.observation.dtype)
    angles = np.radians([80.0, -170.0, 85.0])
    given["v_V_L"] = 18.0 * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    turns = commands("perpendicular", given)
    assert turns == pytest.approx(
        [math.radians(5.0), CONFIG.turn_max, math.radians(2.5)], rel=1e-12
    )
    assert commands("straight", given).tolist() == [0.0] * 3


def test_the_family_is_found_by_name():
    assert find_law("d-optimal-25").name == "d-optimal-25"
    assert find_law("d-optimal-x") is None
    with pytest.raises(ValueError, match="write d-optimal-1"):
        find_law("d-optimal-0")
    given, _ = beliefs(30, seed=5)
    assert np.array_equal(commands("d-optimal", given), commands("d-optimal-1", given))


def test_laws_fly_only_what_they_command():
    rendezvous = load_task("visenvs/Rendezvous-v0")
    for name in NAMES:
        with pytest.raises(NotApplicable, match="actions in units of turn_max"):
            LawPolicy(laws()[name], rendezvous, rendezvous.scenarios["random"])
    with pytest.raises(NotApplicable, match="actions in units of a_max"):
        LawPolicy(laws()["pn"], TASK, CONFIG)


@pytest.mark.skipif(numba.config.DISABLE_JIT, reason="flies 45,000 steps")
def test_d_optimal_beats_perpendicular_beats_straight():
    """Mean position error over the same 100 seeds; 4 standard errors of the paired differences."""
    errors = [
        rollout(LawPolicy(laws()[name], TASK, CONFIG), TASK, CONFIG, range(100)).records[
            "position_error_mean"
        ]
        for name in ("straight", "perpendicular", "d-optimal")
    ]
    for worse, better in pairwise(errors):
        gain = worse - better
        assert gain.mean() > 4 * gain.std() / math.sqrt(len(gain))
