"""Segments of a scene: projection, clipping, hidden lines, and what goes wrong with them."""

import numpy as np
import pytest
from scipy import stats

from visenvs.core.config import override, to_record
from visenvs.core.frames import camera_towards
from visenvs.envs import _mapping_world as world
from visenvs.envs._mapping_config import SCENARIOS
from visenvs.sensors.segments import NOBODY, SCRATCH, scene_columns, take_segments

pytestmark = pytest.mark.kernel

WIDTH = float(np.tan(np.radians(30.0)))
CLEAR = {"p_detect": 1.0, "p_split": 0.0, "p_false": 0.0, "sigma_image": 1e-9, "min_length": 1e-6}


def empty(edges=64, solids=4):
    return np.zeros(1, scene_columns(edges, solids))[0]


def houses(*poses, wall=6.0, rise=0.0, wide=4.0):
    scene = empty()
    for north, east in poses:
        world.add_house(scene, (north, east, 1.0, 0.0), 5.0, wide, wall, rise)
    return scene


def wires(*edges):
    scene = empty()
    for a, b in edges:
        world.add_edge(scene, a, b, -1, -1, -1)
    return scene


def look(scene, place, towards, step=0, **changes):
    cfg = to_record(override(SCENARIOS["town"], CLEAR | changes))[0]
    C, r_V = np.zeros((3, 3)), np.array(place, float)
    camera_towards(np.asarray(towards, float) - r_V, C)
    seen, cut, labels = np.zeros((80, 4)), np.zeros((80, 2)), np.zeros(80)
    work = np.zeros(1, SCRATCH)[0]
    n = take_segments(scene, C, r_V, cfg, 7, 0, step, 1, seen, cut, labels, work)
    return C, seen[:n], cut[:n], labels[:n].astype(int)


def image(C, place, X):
    q = C @ (np.asarray(X) - place)
    return q[1:] / q[0]


def same_ends(segment, a, b, tol=1e-6):
    p, q = segment[:2], segment[2:]
    straight = np.allclose(p, a, atol=tol) and np.allclose(q, b, atol=tol)
    return straight or (np.allclose(p, b, atol=tol) and np.allclose(q, a, atol=tol))


def test_an_edge_in_view_is_its_projection():
    a, b = (2.0, 3.0, -1.0), (-4.0, 1.0, -5.0)
    C, seen, cut, labels = look(wires((a, b)), (0, 0, -30), (1, 1, 0))
    assert labels.tolist() == [0] and not cut.any()
    place = np.array([0, 0, -30.0])
    assert same_ends(seen[0], image(C, place, a), image(C, place, b))


def test_what_leaves_the_picture_or_passes_the_camera_is_cut_off_there():
    scene = wires(((-100.0, 0.0, 0.0), (2.0, 0.0, 0.0)), ((-50.0, 0.5, -29.0), (50.0, 0.5, -29.0)))
    _, seen, cut, labels = look(scene, (0, 0, -30), (0, 0, 0))
    assert labels.tolist() == [0, 1]
    assert sorted(cut[0]) == [0.0, 1.0] and cut[1].tolist() == [1.0, 1.0]
    ends = seen.reshape(2, 2, 2)
    assert np.abs(ends[cut == 1.0]).max(axis=1) == pytest.approx(WIDTH, abs=1e-6)
    # from within: the part behind the camera must not be mirrored into the picture
    _, seen, cut, _ = look(wires(((-9.0, 1.0, -30.0), (9.0, 1.0, -30.0))), (0, 0, -30), (5, 0, -30))
    assert len(seen) == 1 and sorted(cut[0]) == [0.0, 1.0] and (seen[0][[0, 2]] > 0).all()
    assert not len(look(scene, (0, 0, -30), (0, 0, -60))[1])


def test_a_box_shows_nine_edges_and_hides_three():
    scene, place = houses((0.0, 0.0)), (20.0, 15.0, -25.0)
    assert scene["edges"] == 12
    _, _, _, labels = look(scene, place, (0, 0, -3), hidden=1)
    ends = scene["edge"][:12].reshape(12, 2, 3)
    far = np.array([-5.0, -4.0, 0.0])  # the corner on the ground that is turned away
    touches = (np.abs(ends - far).sum(axis=2) < 1e-9).any(axis=1)
    assert touches.sum() == 3
    assert sorted(labels) == np.flatnonzero(~touches).tolist()
    assert len(look(scene, place, (0, 0, -3), hidden=0)[1]) == 12


def test_a_gable_has_fifteen_edges_on_the_planes_of_its_faces():
    scene = houses((3.0, 1.0), rise=3.0)
    assert scene["edges"] == 15 and scene["faces"][0] == 6
    for e in range(15):
        for k in scene["face"][e]:
            n = scene["plane"][0, k]
            for X in scene["edge"][e].reshape(2, 3):
                assert n[:3] @ X == pytest.approx(n[3], abs=1e-9)
        for k in range(6):  # the rest of the house lies behind every face
            n = scene["plane"][0, k]
            assert (scene["edge"][e].reshape(2, 3) @ n[:3] <= n[3] + 1e-9).all()
    assert np.linalg.norm(scene["plane"][0, :, :3], axis=1) == pytest.approx(np.ones(6))


def hidden_by(scene, solid, place, X):
    """Whether the straight line from the camera to a point passes through a solid, by sampling."""
    t = np.linspace(1e-3, 1 - 1e-3, 2000)[:, None]
    points = place + t * (X - place)
    planes = scene["plane"][solid, : scene["faces"][solid]]
    return bool(((points @ planes[:, :3].T < planes[:, 3] - 1e-9).all(axis=1)).any())


@pytest.mark.parametrize("rise", [0.0, 3.0])
def test_what_lies_behind_a_house_is_cut_out_exactly(rise):
    scene = houses((0.0, 0.0), rise=rise)
    world.add_edge(scene, (-12.0, -25.0, 0.0), (-14.0, 25.0, -2.0), -1, -1, -1)
    wire, place = int(scene["edges"]) - 1, np.array([25.0, 2.0, -12.0])
    C, seen, cut, labels = look(scene, place, (0, 0, -2), hidden=1, half_width=2.0)
    pieces = seen[labels == wire]
    assert len(pieces) == 2 and not cut[labels == wire].any()
    a, b = scene["edge"][wire].reshape(2, 3)
    for s in np.linspace(0.01, 0.99, 99):
        X = a + s * (b - a)
        p = image(C, place, X)
        drawn = any(
            np.hypot(*(p - q[:2])) + np.hypot(*(p - q[2:])) < np.hypot(*(q[:2] - q[2:])) + 1e-6
            for q in pieces
        )
        near_an_end = min(np.hypot(*(p - q)) for q in pieces.reshape(-1, 2)) < 5e-3
        assert near_an_end or drawn != hidden_by(scene, 0, place, X)


def test_a_house_before_another_hides_it_and_not_the_other_way_round():
    scene = houses((8.0, 0.0), (-8.0, 0.0), wall=8.0)
    _, seen, _, labels = look(scene, (40.0, 0.0, -9.0), (0, 0, -4), hidden=1)
    first, second = labels < 12, labels >= 12
    whole = look(scene, (40.0, 0.0, -9.0), (0, 0, -4), hidden=0)
    assert first.sum() == 7  # the front and the roof's sides, all whole
    for segment, label in zip(seen[first], labels[first], strict=True):
        other = whole[1][whole[3] == label][0]
        assert same_ends(segment, other[:2], other[2:])
    lengths = np.linalg.norm(seen[second][:, 2:] - seen[second][:, :2], axis=1)
    assert len(lengths) < 9 and lengths.sum() < 2.0


def test_noise_misses_splits_and_false_segments_come_as_often_as_told():
    scene = wires(((-5.0, 0.0, 0.0), (5.0, 0.0, 0.0)))
    changes = {"sigma_image": 0.01, "p_detect": 0.8, "p_split": 0.3, "p_false": 0.2}
    rates = {"found": 0, "split": 0, "false": 0, "turned": 0}
    errors, n = [], 1500
    for step in range(n):
        C, seen, cut, labels = look(scene, (0, 0, -30), (0, 0, 0), step, **changes)
        own = seen[labels == 0]
        rates["false"] += int((labels == NOBODY).sum())
        rates["found"] += len(own) > 0
        rates["split"] += len(own) > 1
        assert not cut.any()
        if len(own) == 1:
            true = image(C, np.array([0, 0, -30.0]), (-5.0, 0.0, 0.0))
            turned = np.hypot(*(own[0, :2] - true)) > np.hypot(*(own[0, 2:] - true))
            rates["turned"] += turned
            errors.append(own[0, 2:] - true if turned else own[0, :2] - true)
    expected = {"found": 0.8 * n, "split": 0.24 * n, "false": 0.2 * n, "turned": 0.5 * len(errors)}
    for name, mean in expected.items():
        assert abs(rates[name] - mean) < 4 * np.sqrt(mean), name
    assert stats.kstest(np.ravel(errors) / 0.01, "norm").pvalue > 1e-3


def test_a_full_picture_takes_no_more():
    scene = wires(*(((k * 0.2, 0.0, 0.0), (k * 0.2, 5.0, 0.0)) for k in range(60)))
    cfg = to_record(override(SCENARIOS["town"], CLEAR | {"p_false": 1.0, "p_split": 1.0}))[0]
    C, seen, cut, labels = np.zeros((3, 3)), np.zeros((7, 4)), np.zeros((7, 2)), np.zeros(7)
    camera_towards(np.array([0.0, 0.0, 1.0]), C)
    work = np.zeros(1, SCRATCH)[0]
    place = np.array([5.0, 0.0, -30.0])
    assert take_segments(scene, C, place, cfg, 1, 0, 0, 1, seen, cut, labels, work) == 7
