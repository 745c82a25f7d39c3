"""Segments that contend for lines: assigned together, each part of an edge seen once."""

import numpy as np
import pytest
from scipy.optimize import linear_sum_assignment

from visenvs.core.config import override, to_record
from visenvs.core.frames import camera_towards
from visenvs.envs._mapping_config import SCENARIOS
from visenvs.estimation.line_map import map_dtype, use_image, work_dtype
from visenvs.estimation.line_matching import LONE, UNCLEAR, associate, foresee, ztest

pytestmark = pytest.mark.kernel

SIGMA, HEIGHT = 0.002, 30.0
PIXEL = SIGMA * HEIGHT  # what the image noise is on the ground, m
PLACE, ROWS = np.array([0.0, 0.0, -HEIGHT]), 12


class Scene:
    """Known lines on the ground, and a camera 30 m above that looks straight down."""

    def __init__(self, lines, deviation=0.001, **changes):
        self.cfg = to_record(override(SCENARIOS["pyramid"], changes))[0]
        self.map, n = np.zeros(1, map_dtype(ROWS))[0], len(lines)
        self.work = np.zeros(1, work_dtype(ROWS, ROWS))[0]
        self.map["x"][:n] = np.reshape(lines, (n, 6))
        self.map["P"][:n] = deviation**2 * np.eye(6)
        self.map["closed"][:n] = 1.0
        self.map["alive"][:n] = self.map["hits"][:n] = 1.0
        self.map["owner"][:n], self.map["used"] = np.arange(n), n
        self.C, self.cut = np.zeros((3, 3)), np.zeros((ROWS, 2))
        camera_towards(np.array([0.0, 0.0, 1.0]), self.C)

    def image(self, segments):
        """Of segments given by their ends in N, (n, 2, 3)."""
        seen = np.zeros((ROWS, 4))
        q = (np.asarray(segments) - PLACE) @ self.C.T
        seen[: len(segments)] = (q[..., 1:] / q[..., :1]).reshape(-1, 4)
        return seen

    def choose(self, segments):
        """The line of each."""
        seen = self.image(segments)
        foresee(self.map, self.C, PLACE, self.cfg, self.work)
        associate(self.map, seen, self.cut, len(segments), self.cfg, self.work)
        return self.work["choice"][: len(segments)].tolist()

    def values(self, segments):
        """z-test values of all segments with all lines."""
        seen, lines = self.image(segments), range(int(self.map["used"]))
        foresee(self.map, self.C, PLACE, self.cfg, self.work)
        closed, work = self.map["closed"], self.work
        return np.array(
            [
                [ztest(seen[i], self.cut[i], closed[j], j, self.cfg, work) for j in lines]
                for i in range(len(segments))
            ]
        )


def edge(east, first=-6.0, last=6.0):
    """An edge that runs north on the ground; `east` in deviations of the image noise."""
    return np.array([[first, east * PIXEL, 0.0], [last, east * PIXEL, 0.0]])


def scipys(values, alone):
    """Line of each segment at the least sum, where no line costs `alone`."""
    rows, columns = values.shape
    padded = np.full((rows, columns + rows), alone)
    padded[:, :columns] = np.where(values <= alone, values, 1e6)
    picked = linear_sum_assignment(padded)[1]
    return np.where(picked < columns, picked, UNCLEAR).tolist()


def test_the_best_of_all_assignments():
    """Against scipy's: up to six lines in one another's way; often not the nearest one each."""
    rng, nearest = np.random.default_rng(0), 0
    for _ in range(60):
        n = rng.integers(2, 7)
        scene = Scene([edge(east) for east in rng.uniform(-4.0, 4.0, n)])
        segments = scene.map["x"][:n].reshape(n, 2, 3)[rng.permutation(n)[: rng.integers(2, n + 1)]]
        noisy = segments + PIXEL * rng.normal(size=segments.shape) * (1.0, 1.0, 0.0)
        values = scene.values(noisy)
        greedy = values.argmin(axis=1).tolist()
        contended = len(set(greedy)) < len(greedy)
        expected = scipys(values, scene.cfg["ztest_max"] + 2.0 * LONE) if contended else greedy
        assert scene.choose(noisy) == expected
        nearest += expected == greedy
    assert nearest < 40


def test_the_nearest_line_is_not_taken_from_the_segment_that_has_no_other():
    """Two lines three deviations apart: what lies between them, nearer to 0, is of 1."""
    scene = Scene([edge(0.0), edge(3.0)])
    between, own = edge(1.2), edge(-0.5)
    assert scene.values([between, own]).argmin(axis=1).tolist() == [0, 0]
    assert scene.choose([between, own]) == [1, 0]
    assert scene.choose([own, between]) == [0, 1]
    assert scene.choose([between]) == [0]


def test_parts_share_a_line_and_are_no_reason_to_leave_it():
    scene = Scene([edge(0.0), edge(3.0)])
    parts = [edge(0.3, -6.0, -0.5), edge(-0.2, 0.5, 6.0)]
    assert scene.choose(parts) == [0, 0]
    assert scene.choose([*parts, edge(1.2)]) == [0, 0, 1]
    assert scene.choose([edge(1.2), *parts[::-1]]) == [1, 0, 0]


def test_what_no_line_is_left_for_is_used_for_nothing():
    scene = Scene([edge(0.0)])
    farther, nearer = edge(1.5), edge(0.1)
    assert scene.choose([farther, nearer]) == [UNCLEAR, 0]
    before = scene.map.copy()
    seen, labels = scene.image([farther, nearer]), np.array([5.0, 0.0])
    use_image(scene.map, scene.C, PLACE, seen, scene.cut, labels, 2, scene.cfg, scene.work)
    assert scene.map["made"] == before["made"] and scene.map["wrong"] == 0.0
    alone = Scene([edge(0.0)])
    seen = alone.image([nearer])
    use_image(alone.map, alone.C, PLACE, seen, alone.cut, labels[1:], 1, alone.cfg, alone.work)
    assert scene.map["x"][0].tolist() == alone.map["x"][0].tolist()


def stretched(estimator, share, beyond, closed=1.0):
    """Ends, and deviation of the farther one along, of a steep edge that is seen to end beyond it.

    Args:
        share: of its length by which the edge goes on in truth.
        beyond: noise of the segment's far end along the edge, deviations.
    """
    foot, top = np.array([6.0, 0.0, 0.0]), np.array([5.0, 0.0, -6.0])
    scene = Scene([[foot, top]], 1e-4, estimator=estimator)
    scene.map["closed"][0, 1] = closed
    seen = scene.image([[foot, top + share * (top - foot)]])
    u = seen[0, 2:] - seen[0, :2]
    seen[0, 2:] += beyond * SIGMA * u / np.linalg.norm(u)
    cut, label = scene.cut, np.zeros(1)
    use_image(scene.map, scene.C, PLACE, seen, cut, label, 1, scene.cfg, scene.work)
    x, along = scene.map["x"][0], (top - foot) / np.linalg.norm(top - foot)
    P = scene.map["P"][0, 3:, 3:]
    return (x[3:] - top) @ along, float(np.sqrt(along @ P @ along))


def test_an_end_on_edge_tells_its_end_as_badly_as_it_is_seen():
    """A deviation of the image is many on the edge; the covariance of a moved end knows."""
    slope = (stretched("d-only", 0.1, 0.5, 0.0)[0] - stretched("d-only", 0.1, -0.5, 0.0)[0]) / 1.0
    moved, deviation = stretched("d-only", 0.1, 0.0, 0.0)
    assert moved == pytest.approx(0.1 * np.sqrt(37.0), rel=1e-3)
    assert deviation == pytest.approx(slope, rel=0.02)
    assert slope > 4.0 * PIXEL


def test_a_closed_end_goes_on_only_where_it_can_be_taken_back():
    assert stretched("four", 0.0, 4.6)[0] > 0.5
    assert stretched("four", 0.0, 3.4)[0] < 0.01
    assert stretched("d-only", 0.0, 4.6)[0] == pytest.approx(0.0, abs=1e-3)
