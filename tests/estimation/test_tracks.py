"""Tracks: every kind by the same signatures; birth, coasting, death, ghosts and wrong updates."""

import math

import numpy as np
import pytest

from visenvs.core.sight import ANGLES, see
from visenvs.estimation import tracks as T
from visenvs.estimation.association import IGNORED, NEW, by_label

pytestmark = pytest.mark.kernel

LEVEL = np.eye(3)
KINDS = range(len(T.KINDS))
SLOTS, ROWS, WINDOW = 3, 5, 8


class Scene:
    """A vehicle that flies north among objects, and what its tracks make of the images."""

    def __init__(self, kind, cfg, objects, labelled=False):
        self.kind, self.cfg, self.labelled = kind, cfg, labelled
        self.objects = np.array(objects, float)
        self.tracks = np.zeros(1, T.tracks_dtype(SLOTS, WINDOW))[0]
        self.work = np.zeros(1, T.work_dtype(SLOTS, ROWS))[0]
        self.here, self.prior = np.zeros(3), np.tile([100.0, 28.87], (ROWS, 1))

    def sight(self, k):
        return np.array(see(ANGLES, LEVEL, self.objects[k] - self.here, 1.0)[:2])

    def fly(self, moved=(2.0, 0.5, 0.0)):
        self.here = self.here + moved
        T.predict(self.kind, self.tracks, self.here, np.array(moved), self.cfg, self.filter)

    def image(self, seen, labels):
        """Give an image to the tracks: list of pairs and whose they are; returns the choices."""
        pad, owner, n = np.zeros((ROWS, 2)), np.zeros(ROWS), len(seen)
        pad[:n], owner[:n] = np.reshape(seen, (n, 2)), labels
        tracks, work, cfg, kind, here = self.tracks, self.work, self.cfg, self.kind, self.here
        T.compare(kind, tracks, here, LEVEL, pad, n, cfg, work)
        threshold = float(cfg["ztest_max"])
        if self.labelled:
            threshold = -1.0
            by_label(tracks["owner"], tracks["alive"], owner, n, work["choice"])
        else:
            T.associate(n, cfg, work)
        T.absorb(kind, tracks, here, LEVEL, pad, owner, self.prior, n, threshold, cfg, work)
        T.report(kind, tracks, here, cfg, self.filter)
        return work["choice"][:n].tolist()

    @property
    def filter(self):
        return self.work["filter"]

    @property
    def alive(self):
        return self.tracks["alive"].tolist()

    def count(self, name):
        return int(self.tracks[name])


@pytest.fixture
def scene(settings):
    def build(*objects, kind=T.INVERSE_UKF, labelled=False, **changes):
        return Scene(kind, settings(sigma_angle=0.01, fade=0.0, **changes), objects, labelled)

    return build


@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_finds_an_object_that_it_passes(kind, scene):
    """All by the same calls. The report's process noise makes the spherical filter forget."""
    quiet = {"q_angle": 1e-5, "q_range": 1e-2} if kind == T.SPHERICAL else {}
    at = scene((120.0, 30.0, -10.0), kind=kind, **quiet)
    at.prior[:] = [100.0, 28.87]
    for _ in range(45):
        choice = at.image([at.sight(0)], [0])
        at.fly()
    assert choice == [0]
    T.report(kind, at.tracks, at.here, at.cfg, at.filter)
    r, cov = at.tracks["r"][0], at.tracks["cov"][0]
    assert r == pytest.approx(at.objects[0] - at.here, abs=1.0)
    assert np.linalg.eigvalsh(cov)[0] > 0.0
    assert math.sqrt(np.trace(cov)) < 3.0
    assert at.count("made") == 1
    assert at.count("ghosts") == at.count("wrong") == at.count("dropped") == 0


@pytest.mark.parametrize("kind", [k for k in KINDS if k != T.BANK])
def test_moments_are_the_first_sighting_and_its_uncertainty(kind, scene):
    at = scene((120.0, 30.0, -10.0), kind=kind)
    at.image([at.sight(0)], [0])
    r, cov = at.tracks["r"][0], at.tracks["cov"][0]
    u = r / 100.0
    assert np.linalg.norm(r) == pytest.approx(100.0)
    assert see(ANGLES, LEVEL, r.copy(), 1.0)[:2] == pytest.approx(at.sight(0))
    assert math.sqrt(u @ cov @ u) == pytest.approx(28.87)


@pytest.mark.parametrize("kind", [T.CARTESIAN, T.INVERSE_EKF, T.SPHERICAL, T.BATCH])
def test_the_test_value_is_the_nis_of_the_update(kind, scene):
    """Computed in Cartesian coordinates for all kinds; the batch's is that of its last step."""
    at = scene((120.0, 30.0, -10.0), kind=kind)
    for _ in range(10):
        at.image([at.sight(0)], [0])
        at.fly()
    seen = at.sight(0) + np.array([0.004, -0.003])
    T.compare(kind, at.tracks, at.here, LEVEL, seen[None], 1, at.cfg, at.work)
    value = at.work["ztest"][0, 0]
    nis = T.update(kind, at.tracks, 0, at.here, LEVEL, seen, at.cfg, at.filter)
    assert nis == pytest.approx(value, rel=0.02 if kind == T.BATCH else 1e-9)


def test_two_objects_get_two_tracks_and_keep_them(scene):
    at = scene((150.0, 20.0, 0.0), (150.0, -20.0, 0.0))
    for k in range(30):
        order = [0, 1] if k % 2 else [1, 0]
        at.image([at.sight(i) for i in order], order)
        at.fly((2.0, 0.0, 0.0))
    assert at.alive == [1.0, 1.0, 0.0]
    assert at.tracks["owner"][:2].tolist() == [1.0, 0.0]
    assert at.tracks["hits"].tolist() == [30.0, 30.0, 0.0]
    assert at.count("made") == 2
    assert at.count("wrong") == at.count("ghosts") == 0


def test_duplicate_detections_make_one_track(scene):
    at = scene((150.0, 20.0, 0.0))
    first = at.image([at.sight(0), at.sight(0) + 0.003], [0, 0])
    assert first == [NEW, IGNORED]
    at.fly()
    assert at.image([at.sight(0) + 0.004, at.sight(0)], [0, 0]) == [IGNORED, 0]
    assert at.alive == [1.0, 0.0, 0.0]
    assert at.count("made") == 1


@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_numbers_that_are_not_finite_are_left_out(bad, scene):
    at = scene((150.0, 20.0, 0.0))
    assert at.image([[bad, 0.1], at.sight(0)], [0, 0]) == [IGNORED, NEW]
    at.fly()
    before = at.tracks["x"].copy()
    assert at.image([[0.1, bad]], [0]) == [IGNORED]
    assert np.array_equal(at.tracks["x"], before)
    assert at.alive == [1.0, 0.0, 0.0]


def test_a_false_measurement_is_a_ghost_and_dies_unseen(scene):
    at = scene((150.0, 20.0, 0.0), delete_after=5)
    at.image([at.sight(0), [0.5, 0.4]], [0, T.NOBODY])
    assert at.alive == [1.0, 1.0, 0.0]
    assert at.count("ghosts") == 1
    at.fly()
    at.image([at.sight(0)], [0])
    assert at.alive == [1.0, 0.0, 0.0]


def test_an_established_track_survives_dropouts_up_to_the_limit(scene):
    at = scene((150.0, 20.0, 0.0), delete_after=5)
    for _ in range(10):
        at.image([at.sight(0)], [0])
        at.fly()
    for missed in range(1, 6):
        at.image([], [])
        at.fly()
        assert at.tracks["missed"][0] == missed
        assert at.alive[0] == (0.0 if missed == 5 else 1.0)


def test_without_a_limit_and_out_of_view_tracks_coast(scene):
    for changes in ({"delete_after": 0}, {"delete_after": 3, "half_width": 0.1}):
        at = scene((150.0, 20.0, 0.0), **changes)
        at.image([at.sight(0)], [0])
        at.image([at.sight(0)], [0])
        for _ in range(20):
            at.fly()
            at.image([], [])
        assert at.alive == [1.0, 0.0, 0.0]
        assert at.tracks["unseen"][0] == 20.0
        assert at.tracks["r"][0, 0] == pytest.approx(100.0 * math.cos(at.sight(0)[0]) - 40, abs=3.0)


def test_what_was_seen_once_and_left_the_view_is_deleted(scene):
    at = scene((150.0, 20.0, 0.0), delete_after=5, half_width=0.1)
    at.image([at.sight(0)], [0])
    at.image([], [])
    assert at.alive == [0.0, 0.0, 0.0]


def test_a_full_table_drops_a_sighting_or_replaces_a_track_out_of_date(scene):
    at = scene()
    corners = [[0.4, 0.4], [-0.4, 0.4], [0.4, -0.4]]
    at.image([*corners, [-0.4, -0.4]], [0, 1, 2, 3])
    assert at.alive == [1.0] * 3
    assert at.count("dropped") == 1
    at.image([*corners[1:], [-0.4, -0.4]], [1, 2, 3])
    assert at.tracks["owner"].tolist() == [0.0, 1.0, 2.0]
    at.image([*corners[1:], [-0.4, -0.4]], [1, 2, 3])
    assert at.tracks["owner"].tolist() == [3.0, 1.0, 2.0]
    assert at.count("dropped") == 2
    assert at.count("made") == 4
    assert at.count("ghosts") == 0


def test_the_track_of_another_object_is_a_wrong_update_and_a_second_one_a_ghost(scene):
    at = scene((150.0, 20.0, 0.0))
    at.image([[0.3, 0.0]], [0])
    assert at.image([[0.302, 0.0]], [1]) == [0]
    assert at.count("wrong") == 1
    assert at.image([[-0.3, 0.0]], [0]) == [NEW]
    assert at.count("ghosts") == 1


def test_a_track_is_whose_most_of_its_last_sightings_are(scene):
    at = scene((150.0, 20.0, 0.0))
    owners = []
    for label in [0, 1, 1, 0, *[1] * 20, *[0] * 11]:
        at.image([[0.3, 0.0]], [label])
        owners.append(at.tracks["owner"][0])
    assert owners[:6] == [0.0, 0.0, 1.0, 1.0, 1.0, 1.0]
    assert owners[-2:] == [1.0, 0.0]
    assert at.count("made") == 1 and at.count("wrong") == 2 + 1 + 11


def test_labels_keep_apart_what_looks_the_same(scene):
    at = scene(labelled=True)
    assert at.image([[0.3, 0.0], [0.301, 0.0]], [0, 1]) == [NEW, NEW]
    assert at.image([[0.301, 0.0], [0.3, 0.0]], [1, 0]) == [1, 0]
    assert at.count("wrong") == at.count("ghosts") == 0


def test_image_points_behind_the_camera_are_no_candidates(scene, settings):
    at = scene((50.0, 5.0, 0.0))
    at.cfg = settings("image", sigma_angle=0.01)
    at.image([[0.1, 0.0]], [0])
    at.fly((150.0, 0.0, 0.0))
    T.compare(at.kind, at.tracks, at.here, LEVEL, np.zeros((1, 2)), 1, at.cfg, at.work)
    assert at.tracks["ahead"][0] == 0.0
    assert at.work["ztest"][0].tolist() == [math.inf] * SLOTS


def test_the_printed_prior_covariance_on_request(scene, settings):
    at = scene(kind=T.CARTESIAN)
    at.cfg = settings("image", sigma_angle=0.1, prior_covariance=T.THESIS)
    at.image([[0.2, 0.1]], [0])
    assert at.tracks["P"][0, 0, 1] == 0.0
    at = scene(kind=T.CARTESIAN)
    at.cfg = settings("image", sigma_angle=0.1, prior_covariance=T.FULL)
    at.image([[0.2, 0.1]], [0])
    assert at.tracks["P"][0, 0, 1] == pytest.approx(0.2 * 28.87**2)


@pytest.mark.parametrize("sizes", [(0, 1), (6, 0), (6, 1, 0)])
def test_a_record_without_room_is_refused(sizes):
    with pytest.raises(ValueError, match="tracks_dtype"):
        T.tracks_dtype(*sizes)
