"""Prediction against the firmware, the value table against what must be, and the strategies."""

import math

import numpy as np
import pytest

from visenvs.core.config import override, to_record
from visenvs.core.registry import find_law
from visenvs.dynamics.ground_robot import ACTIVE, drive_all
from visenvs.envs._herding_config import SCENARIOS
from visenvs.envs._herding_layout import LANE, OBSERVATION
from visenvs.guidance.choices import CHOICES
from visenvs.guidance.herding_value import value, value_table
from visenvs.guidance.interception import POSE, advance

RECORD = to_record(SCENARIOS["firmware"])
CFG = RECORD[0]


@pytest.fixture(scope="module")
def table():
    return value_table(RECORD)


def row(*tracks, t_go=500.0, **values):
    """A belief with tracks (north, east, heading, phase), all choices allowed."""
    belief = np.zeros(1, OBSERVATION.dtype)
    belief["allowed"], belief["height"], belief["t_go"] = 1.0, 3.0, t_go
    for i, (north, east, heading, phase) in enumerate(tracks):
        belief["track_r_N"][0, 2 * i : 2 * i + 2] = north, east
        belief["track_sin"][0, i], belief["track_cos"][0, i] = math.sin(heading), math.cos(heading)
        belief["track_phase"][0, i], belief["track_status"][0, i] = phase, 1.0
    belief["track_status"][0, len(tracks) :] = 2.0
    for i in range(len(tracks), 10):
        belief["allowed"][0, 1 + 7 * i : 8 + 7 * i] = 0.0
    for name, number in values.items():
        belief[name] = number
    return belief


def decision(name, belief, settings=RECORD):
    commands = np.zeros((len(belief), 1))
    find_law(name).decide(belief, settings, commands)
    return CHOICES[int(commands[0, 0])]


@pytest.mark.kernel
@pytest.mark.kernel
@pytest.mark.parametrize("seconds", [0.3, 4.0, 16.5, 19.0, 41.7])
def test_a_pose_ahead_is_where_the_firmware_drives(seconds):
    cfg = to_record(override(SCENARIOS["firmware"], {"noise_max": 0.0, "tick": 0.01}))[0]
    arena = np.zeros(1, LANE)[0]
    arena["fate"][0], arena["heading"][0] = ACTIVE, 0.7
    poses = []
    for k in range(round((3.0 + seconds) / 0.01) + 1):
        if k == 300:
            poses.append((*arena["r_R_N"][0], arena["heading"][0], 3.0, 1.0))
        arena["t"] = k * 0.01
        if k == round((3.0 + seconds) / 0.01):
            break
        drive_all(arena, cfg)
    pose = np.array(poses[0])
    advance(pose, seconds, cfg)
    assert pose[:2] == pytest.approx(arena["r_R_N"][0], abs=1e-6)
    assert pose[2] == pytest.approx(arena["heading"][0], abs=1e-6)
    assert len(pose) == POSE


def test_values_are_chances_and_need_time(table):
    assert table.min() >= 0.0 and table.max() <= 1.0 + 1e-6
    assert value(table, 5.0, 0.0, 0.0, 5.0, -1.0, CFG) == 0.0
    later = [value(table, 0.0, 0.0, 0.0, 5.0, left, CFG) for left in (20.0, 60.0, 120.0, 300.0)]
    assert later == sorted(later) and later[0] < 0.1 < 0.5 < later[-1]


def test_values_know_what_the_clock_will_do(table):
    near, far = 9.0, 2.0
    homeward = value(table, near, 0.0, 0.0, 3.0, 400.0, CFG)
    assert homeward > 0.95
    assert value(table, -9.0, 0.0, math.pi, 3.0, 400.0, CFG) < 0.4
    turning = value(table, far, 0.0, 0.0, 19.9, 400.0, CFG)
    assert turning < value(table, far, 0.0, math.pi, 19.9, 400.0, CFG)


def test_without_touches_east_and_west_are_alike():
    table = value_table(to_record(SCENARIOS["paper"]))
    mirrored = table[:, :, :, ::-1][..., (-np.arange(24)) % 24]
    assert np.allclose(table, mirrored, atol=1e-5)


def test_the_rule_blocks_the_foremost_robot_that_heads_away():
    tracks = (7.0, 0.0, 0.0, 5.0), (4.0, 1.0, 3.0, 5.0), (2.0, 1.0, 3.0, 5.0)
    assert decision("paper-rule", row(*tracks)) == "block 1"
    assert decision("paper-rule", row(tracks[0])) == "look at 0"
    assert decision("paper-rule", row()) == "hover"
    aslant = (4.0, 1.0, math.acos(-0.5), 5.0)
    assert decision("paper-rule-0.4", row(aslant)) == "block 0"
    assert decision("paper-rule-0.6", row(aslant)) == "look at 0"


@pytest.mark.parametrize("law", ["index", "index-look"])
def test_the_index_serves_where_it_helps(law):
    lost, safe = (-6.0, 0.0, math.pi, 3.0), (8.5, 0.0, 0.0, 3.0)
    assert decision(law, row(safe, lost)).startswith("block 1")
    assert decision(law, row(safe)) == "hover"
    assert decision(law, row(safe, track_age=5.0)) == ("look at 0" if law == "index" else "hover")


def test_the_index_leaves_a_robot_that_is_about_to_turn_by_itself():
    about_to_turn = (3.0, 0.0, math.pi, 13.0)
    assert not decision("index", row(about_to_turn)).startswith("block 0")


def test_the_index_searches_when_all_are_missing_and_goes_on_from_place_to_place():
    missing = row(track_status=0.0)
    first = decision("index", missing)
    assert first.startswith("go to place")
    place = int(first.split()[-1])
    at = {"r_V_N": [0.0, 0.0], "aim_N": [0.0, 0.0]}
    here = decision("index", row(track_status=0.0, **at))
    assert here == "go to place 5" and place in range(9)
    underway = {"r_V_N": [0.0, 2.0], "aim_N": [0.0, 20 / 3]}
    assert decision("index", row(track_status=0.0, **underway)) in {
        "go to place 5",
        "go to place 3",
    }


def test_another_aircraft_has_its_own_robot():
    lost = (-6.0, 0.0, math.pi, 3.0), (-5.0, 5.0, math.pi, 3.0)
    mine = decision("index", row(*lost, r_V_N=[-6.0, 0.0]))
    assert mine.startswith("block 0")
    north, east = -6.0 - 0.33 * 3.0 - 0.557, 0.0
    taken = row(*lost, r_V_N=[-6.0, 0.0])
    taken["others_N"][0, 2:4], taken["others_first"][0, 0] = (north, east), 1.0
    assert not decision("index", taken).startswith("block 0")


def test_a_cosine_is_at_most_one():
    with pytest.raises(ValueError, match=r"a cosine is at most 1; write paper-rule-0\.4"):
        find_law("paper-rule-1.5")
    assert find_law("paper-rule-0.25").name == "paper-rule-0.25"
