"""The bank of tracks: it finds robots, keeps them, guesses at them, and knows their clocks."""

import math

import numpy as np
import pytest

from visenvs.core.config import override, to_record
from visenvs.core.frames import wrap_angle
from visenvs.envs._herding_config import HerdingConfig
from visenvs.estimation import herd, robot_clock
from visenvs.estimation.herd import FINISHED, NONE, TRACKED
from visenvs.estimation.mmae import NEVER
from visenvs.estimation.whereabouts import PHASE
from visenvs.sensors.ground_camera import in_view, mount, pixel_size

pytestmark = pytest.mark.kernel

DT = 0.1


def settings(**changes):
    return to_record(override(HerdingConfig(), {"false_detections": 0.0, **changes}))[0]


class Scene:
    """Robots that drive straight and reverse every 20 s, a camera, and a bank."""

    def __init__(self, r, headings, place=(0.0, 0.0, -3.0), seed=0, **changes):
        self.cfg, self.rng = settings(**changes), np.random.default_rng(seed)
        self.r, self.headings = np.array(r, float), np.array(headings, float)
        self.there, self.left = np.ones(len(r), bool), np.zeros(len(r))
        self.pose, self.t, self.extra = np.zeros((4, 3)), 0.0, []
        self.pose[0] = place
        mount(np.eye(3), self.pose)
        self.bank = np.zeros(1, herd.bank_dtype())[0]  # one size: each would be compiled anew
        self.work = np.zeros(1, herd.work_dtype())[0]
        herd.start(self.bank)
        self.bank["status"][len(r) :] = FINISHED

    def begin(self):
        for j, (r, heading) in enumerate(zip(self.r, self.headings, strict=True)):
            herd.place(self.bank, j, r[0], r[1], heading, 0.03, 0.05)
        return self

    def spin(self, j):
        self.left[j] = self.cfg["spin_time"]

    def run(self, seconds):
        for _ in range(round(seconds / DT)):
            self.t += DT
            if self.t % 20.0 < 1e-6 or self.t % 20.0 > 20.0 - 1e-6:
                self.left[:] = self.cfg["spin_time"]
            for j in range(len(self.r)):
                turning = min(self.left[j], DT)
                self.headings[j] += math.pi * turning / self.cfg["spin_time"]
                self.left[j] -= turning
                way = (DT - turning) * self.cfg["speed"]
                self.r[j] += way * np.array(
                    [math.cos(self.headings[j]), math.sin(self.headings[j])]
                )
            self.look()
        return self

    def look(self):
        seen = np.zeros((13, 2))
        sd, found = self.cfg["sigma_pixel"] * pixel_size(self.pose, self.cfg), []
        for r, there in zip(self.r, self.there, strict=True):
            if there and in_view(self.pose, r[0], r[1], 0.0, self.cfg) and self.rng.random() < 0.9:
                found.append(r + sd * self.rng.normal(size=2))
        found += self.extra
        self.extra = []
        seen[: len(found)] = np.reshape(found, (-1, 2))
        herd.step(self.bank, seen, len(found), self.pose, DT, self.cfg, self.work)

    def errors(self):
        """Distances of the tracks from the nearest robots, and heading errors there."""
        r_N, count = self.bank["r_N"][: len(self.r)], len(self.r)
        away = np.hypot(*(r_N[:, None] - self.r[None]).transpose(2, 0, 1))
        off = wrap_angle(self.bank["heading"][:count] - self.headings[away.argmin(1)])
        return away.min(1), np.abs(off)


def circle(count=10):
    angle = 0.3 + 2.0 * math.pi * np.arange(count) / count
    return np.stack([np.cos(angle), np.sin(angle)], 1), angle


def test_ten_robots_are_found_from_nothing():
    scene = Scene(*circle()).run(1.5)
    away, off = scene.errors()
    assert (scene.bank["status"] == TRACKED).all()
    assert away.max() < 0.15 and off.max() < 0.6
    assert len(set(np.round(scene.bank["r_N"], 1).ravel())) > 10
    assert (
        scene.bank["phase"] == pytest.approx(np.full(10, 1.5)) and not scene.bank["sd_phase"].any()
    )


def test_a_track_in_sight_is_as_good_as_it_says():
    """Squared place errors over the stated variances: 2 on average, or less as robots swerve."""
    nees = []
    for seed in range(30):
        scene = Scene([[0.0, -2.0]], [math.pi / 2], seed=seed).begin().run(8.0)
        error = scene.bank["r_N"][0] - scene.r[0]
        nees.append(error @ np.linalg.solve(scene.bank["P"][0, 0, :2, :2], error))
        assert scene.bank["sd_r"][0] < 0.04 and scene.bank["age"][0] < 0.5
    assert 0.5 < np.mean(nees) < 3.0


def test_robots_that_pass_each_other_keep_their_tracks():
    scene = Scene([[-1.0, 0.0], [1.0, 0.3]], [0.0, math.pi]).begin().run(7.0)
    assert np.hypot(*(scene.bank["r_N"][:2] - scene.r).T).max() < 0.15


def test_out_of_sight_a_track_goes_by_the_clock():
    scene = Scene([[0.0, 0.0]], [0.0]).begin().run(2.0)
    scene.pose[0, 2] = 0.0  # on the ground it sees nothing
    scene.run(27.0)
    away, off = scene.errors()
    assert scene.bank["status"][0] == TRACKED and scene.bank["age"][0] == pytest.approx(
        27.0, abs=0.5
    )
    assert away[0] < 1.5 and off[0] < 0.4
    assert scene.bank["phase"][0] == pytest.approx(9.0, abs=0.2)
    assert scene.bank["sd_r"][0] > 0.5


def test_a_reversal_by_the_clock_sets_it_right():
    scene = Scene([[-2.0, 0.0]], [0.0]).begin()
    scene.bank["phase"][0], scene.bank["sd_phase"][0] = 1.0, 0.5  # wrong by a second
    for _ in range(21):
        scene.pose[0, :2] = scene.r[0]
        scene.run(1.0)
    assert scene.bank["p_spin"][0] > 0.9
    scene.run(3.0)
    assert scene.bank["phase"][0] == pytest.approx(4.0, abs=0.3)
    assert scene.errors()[1][0] < 0.4


@pytest.mark.parametrize("near", [True, False])
def test_a_spin_that_nothing_explains_re_sets_the_clock(near):
    scene = Scene([[0.0, -1.0]], [math.pi / 2]).begin().run(5.0)
    if near:
        scene.bank["r_O_N"][0] = scene.r[0] + [0.0, 0.5]
    scene.spin(0)
    scene.run(2.0)
    expected = 7.0 if near else 2.0
    assert scene.bank["phase"][0] == pytest.approx(expected, abs=0.4)


def test_where_a_bump_restarts_the_timer_every_half_turn_tells_it():
    scene = Scene([[0.0, -1.0]], [math.pi / 2], bump_restarts_timer=1).begin().run(5.0)
    scene.bank["r_O_N"][0] = scene.r[0] + [0.0, 0.5]
    scene.spin(0)
    assert scene.run(2.0).bank["phase"][0] == pytest.approx(2.0, abs=0.4)
    herd.tell(scene.bank, 0, True, scene.cfg)
    assert scene.bank["phase"][0] == 0.0


@pytest.mark.parametrize(
    "spun, turn, restarts, told",
    [(0.5, 2.456, 1, 9.0), (1.2, 2.456, 1, 1.2), (1.2, 0.614, 1, 9.0), (1.2, 2.456, 0, 9.0)],
)
def test_a_spin_restarts_the_timer_once_it_is_believed(spun, turn, restarts, told):
    """Not one that may be a mistake, nor a touch's, nor under the official firmware."""
    scene = Scene([[0.0, 0.0]], [0.0], bump_restarts_timer=restarts).begin()
    bank = scene.bank
    bank["phase"][0], bank["spun"][0], bank["turn"][0] = 9.0, spun, turn
    robot_clock.note_restart(bank, 0, scene.cfg)
    assert bank["phase"][0] == told


@pytest.mark.parametrize("restarts", [0, 1])
def test_guesses_that_are_bumped_have_their_own_timers_only_where_a_bump_restarts_it(restarts):
    scene = Scene([[0.0, 0.0]], [0.0], bump_restarts_timer=restarts).begin().run(2.0)
    scene.pose[0, 2] = 0.0  # on the ground it sees nothing
    phases = scene.run(15.0).bank["guesses"][0, :, PHASE]
    assert (len(np.unique(np.round(phases, 6))) > 1) == bool(restarts)
    herd.tell(scene.bank, 0, False, scene.cfg)
    assert scene.bank["guesses"][0, :, PHASE].max() > 10.0
    herd.tell(scene.bank, 0, True, scene.cfg)
    assert (scene.bank["guesses"][0, :, PHASE].max() == 0.0) == bool(restarts)


def test_a_clock_that_should_have_struck_is_wrong():
    scene = Scene([[0.0, 0.0]], [0.0]).begin()
    scene.bank["phase"][0] = 25.0
    robot_clock.note_overdue(scene.bank, 0, scene.cfg)
    assert scene.bank["phase"][0] == 5.0 and scene.bank["sd_phase"][0] == robot_clock.UNKNOWN


def test_a_spin_that_outlasts_its_time_is_two():
    scene = Scene([[0.0, 0.0]], [0.0]).begin()
    bank = scene.bank
    bank["phase"][0], bank["spun"][0], bank["turn"][0] = 21.0, 3.0, scene.cfg["spin_time"]
    robot_clock.note_double(bank, 0, scene.cfg)
    assert bank["spun"][0] == pytest.approx(3.0 - scene.cfg["spin_time"]) == bank["phase"][0]


def test_what_the_aircraft_has_done_is_told():
    scene = Scene([[0.0, 0.0]], [0.4]).begin().run(1.0)
    before = scene.bank["heading"][0]
    herd.tell(scene.bank, 0, False, scene.cfg)
    scene.left[0] = 0.25 * scene.cfg["spin_time"]
    scene.run(2.5)
    assert wrap_angle(scene.bank["heading"][0] - before) == pytest.approx(math.pi / 4, abs=0.35)
    assert scene.bank["phase"][0] == pytest.approx(3.5)


def test_one_false_finding_changes_no_track():
    scene = Scene([[0.0, 0.0], [6.0, 6.0]], [0.0, 0.0]).begin().run(2.0)
    scene.extra = [np.array([1.5, -2.0])]
    scene.run(1.0)
    assert scene.bank["age"][1] > 2.0
    assert scene.bank["r_N"][0] == pytest.approx(scene.r[0], abs=0.15)


def test_a_robot_that_leaves_is_finished():
    scene = Scene([[9.0, 0.0]], [0.0], place=(8.0, 0.0, -3.0)).begin().run(3.0)
    assert scene.bank["status"][0] == TRACKED
    scene.there[0] = False
    scene.run(3.0)
    assert scene.bank["status"][0] == FINISHED and scene.bank["r_N"][0, 0] > 9.5


def test_the_search_goes_on_where_the_robot_can_still_be():
    scene = Scene([[0.0, 0.0]], [0.0]).begin().run(1.0)
    scene.there[0] = False  # somewhere else, and not where it is looked for
    for _ in range(12):
        scene.run(1.0)
        leader = scene.bank["r_N"][0]
        assert scene.bank["status"][0] != NONE
        scene.pose[0, :2] = leader
    assert scene.bank["sd_r"][0] > 1.5
    scene.there[0], scene.r[0], scene.headings[0] = True, scene.pose[0, :2] + 0.5, 2.0
    scene.run(1.5)
    away, off = scene.errors()
    assert scene.bank["age"][0] < 0.3 and away[0] < 0.15 and off[0] < 0.6


def test_guesses_near_a_candidate_are_not_doubted():
    """A robot found again beside its track is found by it, not searched for elsewhere."""
    scene = Scene([[0.0, 0.0]], [0.0]).begin().run(1.0)
    scene.r[0] += [0.0, 0.35]  # pushed aside: outside the gate
    scene.run(1.2)
    assert scene.bank["age"][0] < 0.3
    assert scene.bank["r_N"][0] == pytest.approx(scene.r[0], abs=0.15)


def test_the_same_pictures_make_the_same_tracks():
    one, two = (Scene(*circle(4), seed=5).run(25.0).bank for _ in range(2))
    assert one.tobytes() == two.tobytes()


def test_numbers_stay_numbers_through_everything():
    scene = Scene(*circle(6), seed=2, false_detections=0.3)
    for _ in range(40):
        scene.pose[0, :2] = scene.rng.uniform(-9, 9, 2)
        scene.extra = [scene.rng.uniform(-9, 9, 2)]
        scene.run(1.0)
    for name in ("r_N", "heading", "p_spin", "phase", "sd_r", "sd_heading", "sd_phase", "age"):
        assert np.isfinite(scene.bank[name]).all()
    assert (scene.bank["p_spin"] >= 0).all() and (scene.bank["p_spin"] <= 1).all()
    assert ((scene.bank["spun"] == NEVER) | (scene.bank["spun"] >= 0)).all()


def test_a_bank_has_a_track():
    with pytest.raises(ValueError, match=r"slots=0.*bank_dtype\(10\)"):
        herd.bank_dtype(0)
