"""Patterns cover what they should; information gain is that of the textbook, and is looked for."""

import math

import numpy as np
import pytest

from agents.registry import load
from eval.rollout import rollout
from visenvs.core.config import override, to_record
from visenvs.core.frames import camera_towards
from visenvs.core.registry import find_law, load_task
from visenvs.guidance.mapping import (
    BOUSTROPHEDON,
    CELL,
    ZIGZAG,
    line_gain,
    pattern_point,
    picture_gain,
    shows,
)

TASK = load_task("visenvs/Mapping-v0")
CONFIG = TASK.scenarios["town"]
SETTINGS = to_record(CONFIG)
K = 32


def belief(place=(0.0, 0.0), velocity=(0.0, 0.0), covered=1.0):
    out = np.zeros(1, TASK.observation.dtype)
    out["r_V_N"] = (*place, -30.0)
    out["v_V_N"], out["covered"], out["t_go"] = velocity, covered, 30.0
    return out


def add_line(row, k, first, last, worst):
    for name, value in (("rhat_1_N", first), ("rhat_2_N", last), ("worst_N", worst)):
        row[name][0, 3 * k : 3 * k + 3] = value
    row["valid"][0, k] = 1.0


def decided(name, row):
    commands = np.zeros((1, 4))
    find_law(name).decide(row, SETTINGS, commands)
    return commands[0]


@pytest.mark.kernel
@pytest.mark.parametrize("pattern", [ZIGZAG, BOUSTROPHEDON])
def test_a_pattern_is_one_path_from_corner_to_corner_and_back(pattern):
    swath = 30.0 * CONFIG.half_width
    half = CONFIG.area - 0.9 * swath
    points = np.array([pattern_point(pattern, s, SETTINGS[0]) for s in np.arange(0.0, 900.0, 0.5)])
    assert points[0] == pytest.approx([-half, -half])
    assert np.abs(points).max() <= half + 1e-9
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    turns = np.abs(steps - 0.5) > 1e-6
    assert steps.max() <= 0.5 + 1e-9 and turns.sum() < 30
    assert np.linalg.norm(points - [half, points[:, 1].max()], axis=1).min() < half
    assert np.abs(points[:, 0] - half).min() < 0.5


@pytest.mark.kernel
def test_lanes_leave_no_gap():
    points = np.array(
        [pattern_point(BOUSTROPHEDON, s, SETTINGS[0]) for s in np.arange(0, 600, 1.0)]
    )
    swath = 30.0 * CONFIG.half_width
    for north in np.linspace(-60.0, 60.0, 25):
        for east in np.linspace(-60.0, 60.0, 25):
            away = np.abs(points - (north, east)).max(axis=1)
            assert away.min() <= swath


def flown(law, **changes):
    config = override(CONFIG, changes)
    return rollout(load(law, TASK, config).policy, TASK, config, range(90000, 90020)).records


def test_boustrophedon_shows_everything_in_time():
    records = flown("boustrophedon", t_f=90.0)
    assert records["coverage"].min() > 0.98


def test_a_circle_is_flown_and_its_middle_kept_in_the_picture():
    records = flown("circle", t_f=40.0)
    radius = np.linalg.norm(records["r_V_N"][:, :2], axis=1)
    assert np.abs(radius - 36.0).max() < 8.0
    for record in records:
        tilt = record["C"][0]
        assert tilt[:2] @ record["r_V_N"][:2] < 0.0
        assert math.acos(tilt[2]) == pytest.approx(CONFIG.tilt_max, rel=0.05)
        turning = np.cross([*record["r_V_N"][:2], 0.0], [*record["v_V_N"], 0.0])[2]
        assert turning > 0.0  # clockwise from above: north to east


@pytest.mark.kernel
@pytest.mark.parametrize("seed", range(5))
def test_the_gain_of_a_line_is_that_of_one_measurement_across_it(seed):
    rng, C, J = np.random.default_rng(seed), np.zeros((3, 3)), np.zeros((2, 3))
    camera_towards(np.array([*rng.uniform(-0.5, 0.5, 2), 1.0]), C)
    first, last, worst = rng.normal(size=3), rng.normal(size=3), rng.normal(size=3)
    middle = 30.0 * C[0] + rng.normal(size=3)
    first, last = middle + first, middle + last

    def image(X):
        q = C @ X
        return q[1:] / q[0]

    along = image(middle + 1e-6 * (last - first)) - image(middle - 1e-6 * (last - first))
    n = np.array([-along[1], along[0]]) / np.linalg.norm(along)
    h = n @ (image(middle + 1e-6 * worst) - image(middle - 1e-6 * worst)) / 2e-6
    expected = 0.5 * 0.9 * math.log(1.0 + (h / 0.002) ** 2)
    found = line_gain(first, last, worst, 0, middle, C, SETTINGS[0], J)
    assert found == pytest.approx(expected, rel=1e-6)


@pytest.mark.kernel
def test_a_picture_counts_the_lines_and_new_cells_that_it_shows():
    C, r, J = np.zeros((3, 3)), np.zeros(3), np.zeros((2, 3))
    camera_towards(np.array([0.0, 0.0, 1.0]), C)
    row, offset = belief(), np.array([3.0, -2.0, 0.0])
    assert picture_gain(row[0], offset, C, SETTINGS[0], r, J) == 0.0
    row["covered"] = 0.0
    width = 15.0
    middles = [((c // 8 + 0.5) * width - 60 - 3, (c % 8 + 0.5) * width - 60 + 2) for c in range(64)]
    shown = sum(max(abs(n), abs(e)) < 30 * CONFIG.half_width for n, e in middles)
    assert picture_gain(row[0], offset, C, SETTINGS[0], r, J) == pytest.approx(shown * CELL)
    row["covered"] = 1.0
    add_line(row, 0, (2.0, 0.0, 30.0), (4.0, 0.0, 30.0), (0.0, 1.0, 0.0))
    add_line(row, 1, (80.0, 0.0, 30.0), (84.0, 0.0, 30.0), (0.0, 5.0, 0.0))  # out of view
    alone = 0.45 * math.log(1.0 + (1.0 / 30.0 / 0.002) ** 2)
    assert picture_gain(row[0], offset, C, SETTINGS[0], r, J) == pytest.approx(alone)
    assert shows(C, np.array([0.0, 0.0, 30.0]), SETTINGS[0])
    assert not shows(C, np.array([0.0, 0.0, -30.0]), SETTINGS[0])


def test_it_looks_and_flies_to_where_something_is_to_be_learnt():
    row = belief()
    assert decided("information-gain", row) == pytest.approx(np.zeros(4))
    add_line(row, 0, (-1.0, 30.0, 30.0), (1.0, 30.0, 28.0), (0.0, 0.0, 4.0))
    command = decided("information-gain", row)
    assert command[3] > 0.0 and abs(command[2]) < 1e-9  # 45 degrees to the east
    row = belief(place=(-55.0, 0.0), covered=1.0)
    row["covered"][0, 56:] = 0.0  # the northern row of cells, out of reach of one manoeuvre
    assert not decided("information-gain", row).any()
    row["r_V_N"][0, 0] = -15.0
    assert decided("information-gain", row)[0] > 0.0


def test_information_gain_beats_the_patterns():
    costs = {
        law: flown(law)["total_cost"]
        for law in ("information-gain", "zigzag", "circle", "boustrophedon")
    }
    for law in ("zigzag", "circle", "boustrophedon"):
        assert (costs["information-gain"] < costs[law]).mean() > 0.9


def test_commands_keep_their_own_limits():
    """Acceleration and camera are shortened apart from each other."""
    policy = load("circle", TASK, CONFIG).policy
    row = TASK.observation.pack(
        {
            field.name: np.zeros(field.size) if field.size > 1 else 0.0
            for field in TASK.observation.fields
        }
        | {"r_V_N": (300.0, 0.0, -30.0), "v_V_N": (0.0, -50.0)}
    )
    action = policy.predict(row[None])[0][0]
    assert np.hypot(*action[:2]) == pytest.approx(1.0)
    assert np.hypot(*action[2:]) == pytest.approx(1.0)
    assert action[2] < 0.0
