"""A map of lines: association, growth, addition, deletion, and the published update."""

import numpy as np
import pytest

from visenvs.core.config import override, to_record
from visenvs.core.frames import camera_towards
from visenvs.envs._mapping_config import SCENARIOS
from visenvs.estimation.line_map import map_dtype, positive, use_image, work_dtype
from visenvs.estimation.line_matching import NEW

pytestmark = pytest.mark.kernel

SIGMA = 0.002
WIDTH = float(np.tan(np.radians(30.0)))


class Camera:
    """Looks at edges without noise, from anywhere straight down, and tells a map."""

    def __init__(self, slots=16, **changes):
        self.cfg = to_record(override(SCENARIOS["pyramid"], changes))[0]
        self.map = np.zeros(1, map_dtype(slots))[0]
        self.work = np.zeros(1, work_dtype(slots, 16))[0]
        self.rng = np.random.default_rng(0)

    def look(self, place, segments, cut=None, labels=None, noise=0.0):
        """Use segments given by their ends in N, (n, 2, 3)."""
        r_V, C = np.array(place, float), np.zeros((3, 3))
        camera_towards(np.array([0.0, 0.0, 1.0]), C)
        n = len(segments)
        seen, ends = np.zeros((16, 4)), np.zeros((16, 2))
        for i, segment in enumerate(segments):
            q = (np.asarray(segment) - r_V) @ C.T
            seen[i] = (q[:, 1:] / q[:, :1]).ravel() + noise * self.rng.normal(size=4)
        if cut is not None:
            ends[:n] = cut
        marks = np.zeros(16)
        marks[:n] = np.arange(n) if labels is None else labels
        use_image(self.map, C, r_V, seen, ends, marks, n, self.cfg, self.work)
        return self.work["choice"][:n].copy()

    @property
    def alive(self):
        return np.flatnonzero(self.map["alive"] > 0)


def circle(n=24, radius=15.0, altitude=30.0):
    angle = 2 * np.pi * np.arange(n) / n
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), np.full(n, -altitude)], 1)


ROOF = np.array([[-4.0, -3.0, -6.0], [5.0, -2.0, -6.0]])
GROUND = np.array([[-4.0, 4.0, 0.0], [5.0, 5.0, 0.0]])
EAST = np.array([0.0, 1.0, 0.0])


def ends_of(camera, j):
    """Ends of line j, in the order of their north coordinates."""
    x = camera.map["x"][j].reshape(2, 3)
    return x[np.argsort(x[:, 0])]


@pytest.mark.parametrize("estimator", ["four", "d-only"])
def test_a_roof_edge_leaves_the_ground_where_it_was_put(estimator):
    camera = Camera(estimator=estimator)
    places = circle()
    camera.look(places[0], [ROOF, GROUND])
    assert ends_of(camera, 0)[:, 2] == pytest.approx([0.0, 0.0], abs=1e-9)
    for place in places[1:]:
        assert camera.look(place, [ROOF, GROUND]).tolist() == [0, 1]
    assert ends_of(camera, 0) == pytest.approx(ROOF, abs=0.3 if estimator == "d-only" else 0.01)
    assert ends_of(camera, 1) == pytest.approx(GROUND, abs=0.01)
    assert camera.map["made"] == 2 and camera.map["wrong"] == 0


def test_ends_in_any_order_are_the_same_segment():
    camera = Camera()
    for k, place in enumerate(circle()):
        camera.look(place, [ROOF[::-1] if k % 2 else ROOF])
    assert ends_of(camera, 0) == pytest.approx(ROOF, abs=0.01)
    assert len(camera.alive) == 1


def test_the_nearer_of_two_lines_wins_and_what_fits_none_is_new():
    camera = Camera()
    beside = GROUND + EAST
    camera.look([0, 0, -30], [GROUND, beside])
    assert camera.look([0, 0, -30], [beside, GROUND], labels=[1, 0]).tolist() == [1, 0]
    assert camera.look([0, 0, -30], [GROUND + 0.5 * EAST]).tolist() == [NEW]


def test_uncertain_lines_do_not_win_by_being_uncertain():
    """The distance of both lines is the same; the wider one has the smaller d' S^-1 d."""
    camera = Camera()
    camera.look([0, 0, -30], [GROUND, GROUND + 0.2 * EAST])
    camera.map["P"][0] = 0.01**2 * np.eye(6)
    camera.map["P"][1] = 0.5**2 * np.eye(6)
    assert camera.look([0, 0, -30], [GROUND + 0.1 * EAST]).tolist() == [0]


def test_neighbours_in_one_straight_line_are_told_apart():
    camera = Camera()
    first = np.array([[-6.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
    second = first + np.array([6.0, 0.0, 0.0])
    camera.look([0, 0, -30], [first, second])
    for place in circle(8, 3.0):
        assert camera.look(place, [second, first], labels=[1, 0]).tolist() == [1, 0]


def test_parts_of_one_edge_are_all_used_and_do_not_shorten_it():
    camera = Camera()
    parts = [np.array([ROOF[0], 0.6 * ROOF[0] + 0.4 * ROOF[1]])]
    parts.append(np.array([0.5 * (ROOF[0] + ROOF[1]), ROOF[1]]))
    camera.look(circle()[0], [ROOF])
    for place in circle()[1:]:
        assert camera.look(place, parts, labels=[0, 0]).tolist() == [0, 0]
    assert ends_of(camera, 0) == pytest.approx(ROOF, abs=0.02)


def test_a_line_grows_where_the_picture_cut_it_off_and_is_closed_by_its_end():
    camera, edge = Camera(), np.array([[-30.0, 2.0, 0.0], [30.0, 2.0, 0.0]])
    for north in np.arange(-30.0, 31.0, 2.0):
        low, high = max(-30.0, north - 15.0), min(30.0, north + 15.0)
        part = np.array([[low, 2.0, 0.0], [high, 2.0, 0.0]])
        camera.look([north, 0.0, -30.0], [part], cut=[[low > -30.0, high < 30.0]])
    assert ends_of(camera, 0) == pytest.approx(edge, abs=0.01)
    assert camera.map["closed"][0].tolist() == [1.0, 1.0]
    assert camera.map["made"] == 1
    part = np.array([[0.0, 2.0, 0.0], [20.0, 2.0, 0.0]])  # what a house hides is not gone
    camera.look([10.0, 0.0, -30.0], [part])
    assert ends_of(camera, 0) == pytest.approx(edge, abs=0.01)


def test_without_extension_more_lines_are_made():
    camera = Camera(extend_max=0.0)
    for north in np.arange(-30.0, 31.0, 2.0):
        part = np.array([[north - 10.0, 2.0, 0.0], [north + 10.0, 2.0, 0.0]])
        camera.look([north, 0.0, -30.0], [part], cut=[[1, 1]])
    assert camera.map["made"] > 1


def test_a_line_goes_when_it_should_be_seen_and_is_not():
    camera = Camera(delete_after=3, patience=0.5)
    for _ in range(4):
        camera.look([0, 0, -30], [GROUND])
    for missed in range(1, 6):
        camera.look([0, 0, -30], [])
        assert camera.map["missed"][0] == missed and len(camera.alive) == 1
    camera.look([0, 0, -30], [])  # 3 + 0.5 x 4 misses are forgiven
    assert len(camera.alive) == 0


def test_a_line_out_of_view_stays_but_a_phantom_ages():
    camera = Camera(delete_after=3, confirm=3, age_out=10)
    for _ in range(3):
        camera.look([0, 0, -30], [GROUND])
    camera.look([0, 0, -30], [GROUND, ROOF])  # the second one is never seen again
    away = [500.0, 0.0, -30.0]
    for _ in range(9):
        camera.look(away, [])
    assert camera.alive.tolist() == [0, 1]
    for _ in range(20):
        camera.look(away, [])
    assert camera.alive.tolist() == [0]


def test_what_finds_no_room_is_dropped_and_counted():
    camera = Camera(slots=1)
    camera.look([0, 0, -30], [GROUND, ROOF])
    assert camera.map["made"] == 1 and camera.map["dropped"] == 1
    with pytest.raises(ValueError, match=r"at least one line; write `map_dtype\(64\)`"):
        map_dtype(0)


def test_the_published_sum_of_gains_is_no_covariance():
    """Scalar P = 1, R = 0.01: two gains from the same P^- give 1 - 2 / 1.01 < 0."""
    halves = [np.array([ROOF[0], ROOF.mean(axis=0)]), np.array([ROOF.mean(axis=0), ROOF[1]])]
    for estimator, broken in (("printed", True), ("d-only", False)):
        camera = Camera(estimator=estimator)
        camera.look(circle()[0], [ROOF])
        for place in circle()[1:4]:
            camera.look(place, halves, labels=[0, 0])
        smallest = min(np.linalg.eigvalsh(camera.map["P"][j])[0] for j in camera.alive)
        assert (smallest < -1e-9) == broken
        assert (camera.map["indefinite"] > 0) == broken


def test_definite_matrices_are_told_from_others():
    rng = np.random.default_rng(1)
    for _ in range(50):
        root = rng.normal(size=(6, 6))
        A = root @ root.T + rng.uniform(-3.0, 3.0) * np.eye(6)
        lowest = np.linalg.eigvalsh(A)[0]
        assert positive(A.copy()) == (lowest > 0.0)
    assert not positive(np.full((2, 2), np.nan))
