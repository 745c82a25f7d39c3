"""Cascades: training separates, files keep them, the shipped one finds robots, OpenCV agrees."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest

from visenvs.sensors.images.boosting import (
    Recipe,
    feature_pool,
    passing,
    train,
    values_of,
    windows_of,
)
from visenvs.sensors.images.cascade_file import SHIPPED, from_xml, shipped_cascade, to_xml
from visenvs.sensors.images.haar import SIDE, detect, floor_sizes, group
from visenvs.sensors.images.scenes import NADIR, OPTICS, TILTED, WINDOW, attitude, draw_scene
from visenvs.sensors.images.train_cascade import main, positives


def patches(count, bright, seed):
    """Noise with a bright middle, or without."""
    rng = np.random.default_rng(seed)
    out = rng.normal(110.0, 25.0, (count, SIDE, SIDE))
    out[:, 8:16, 8:16] += 70.0 * bright
    return np.clip(out, 0, 255).astype(np.uint8)


@pytest.mark.kernel
def test_a_feature_is_its_rectangles_over_the_deviation():
    (patch,) = patches(1, 1, 0)
    rects, weights = feature_pool()
    k = len(rects) - 1
    values = values_of(patch[None], rects[k:], weights[k:])
    inner = patch[1:-1, 1:-1].astype(float)
    total = 0.0
    for (x, y, w, h), weight in zip(rects[k], weights[k], strict=True):
        total += weight * patch[y : y + h, x : x + w].sum()
    assert values[0, 0] == pytest.approx(total / (inner.std() * inner.size), rel=1e-5)


def test_every_feature_is_blind_to_brightness():
    rects, weights = feature_pool()
    areas = (rects[..., 2] * rects[..., 3] * weights).sum(axis=1)
    assert not areas.any()
    assert 10_000 < len(rects) < 20_000


def test_the_command_writes_a_cascade_and_its_card(tmp_path, capsys):
    main(["--positives", "40", "--negatives", "6", "--stages", "2", "--out", str(tmp_path)])
    cascade = from_xml((tmp_path / SHIPPED).read_text(encoding="utf-8"))
    card = json.loads((tmp_path / "card.json").read_text(encoding="utf-8"))
    assert (card["stages"], card["stumps"]) == (len(cascade.ends), len(cascade.thresholds))
    assert 1 <= card["stages"] <= 2
    assert passing(positives(30, seed=7), cascade).mean() > 0.8
    assert "CPU time" in capsys.readouterr().out


def test_a_small_cascade_learns_what_it_is_shown():
    rounds = iter(range(100))

    def mine(current):
        negatives = patches(80, 0, 10 + next(rounds))
        return negatives[passing(negatives, current)] if len(current.ends) else negatives

    cascade = train(patches(60, 1, 1), mine, Recipe(stages=2, stumps=4))
    assert passing(patches(100, 1, 77), cascade).mean() > 0.9
    assert passing(patches(100, 0, 78), cascade).mean() < 0.2
    assert not passing(np.full((1, SIDE, SIDE), 90, np.uint8), cascade).any()


def test_a_file_keeps_the_cascade():
    cascade = shipped_cascade()
    again = from_xml(to_xml(cascade))
    for one, other in zip(cascade.parts, again.parts, strict=True):
        assert np.array_equal(one, other)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("hello", "not an XML file"),
        ("<a/>", "has no <cascade>"),
        ("<a><cascade><stageType>BOOST</stageType></cascade></a>", "BOOST stages of HAAR"),
    ],
)
def test_other_files_are_refused(text, expected):
    with pytest.raises(ValueError, match=expected):
        from_xml(text)


def test_tilted_features_are_refused():
    text = to_xml(shipped_cascade()).replace("<tilted>0", "<tilted>1", 1)
    with pytest.raises(ValueError, match="expected upright ones"):
        from_xml(text)


@pytest.mark.parametrize(("down", "seed"), [(NADIR, 700_000), (TILTED, 710_000)])
def test_the_shipped_cascade_finds_robots_and_little_else(down, seed):
    found = false = visible = 0
    for k in range(12):
        scene = draw_scene(seed + k, down, 3)
        pixels, sizes = scene.tops()
        whole = np.array([OPTICS.shows(p, 0.42 * s) for p, s in zip(pixels, sizes, strict=True)])
        expected = floor_sizes(OPTICS, scene.C, scene.height, WINDOW)
        hit = np.zeros(3, bool)
        for detection in detect(scene.image, shipped_cascade(), expected):
            gaps = np.hypot(*(pixels - detection.pixel).T)
            near = gaps < 0.3 * sizes + 2.0
            hit |= near
            false += not near.any()
        found, visible = found + int((hit & whole).sum()), visible + int(whole.sum())
    assert found >= 0.85 * visible > 10
    assert false <= 3


def test_the_size_follows_the_depth_of_the_floor():
    C = attitude(0.4, math.radians(55), 0.1)
    model = floor_sizes(OPTICS, C, 1.9, WINDOW)
    place = np.array([1.9 * 0.8, 0.5, 1.9])
    pixel, depth = OPTICS.project(C, place)
    assert model.at(pixel) == pytest.approx(WINDOW * OPTICS.focal / depth)


def test_windows_that_agree_are_one_object():
    hits = np.array([[50.0, 50, 30, 1.0], [52, 51, 32, 3.0], [200, 80, 30, 1.0]])
    (one,) = group(hits)
    assert one.votes == 2
    assert 50.0 < one.pixel[0] < 52.0
    assert len(group(hits, votes=1)) == 2
    assert group(np.empty((0, 4))) == []


def visited(windows, columns, first):
    """Which windows OpenCV looks at: it leaves out the one behind one that the first stage stops.

    Flat windows stop before the first stage.
    """
    flat = windows[:, 1:-1, 1:-1].std(axis=(1, 2)) <= 10.0
    stopped = ~passing(windows, first) & ~flat
    out = np.zeros(len(windows), bool)
    for row in range(0, len(windows), columns):
        k = row
        while k < row + columns:
            out[k] = True
            k += 2 if stopped[k] else 1
    return out


def test_opencv_finds_the_same_windows(tmp_path):
    cv2 = pytest.importorskip("cv2")
    if not hasattr(cv2, "CascadeClassifier"):
        pytest.skip("this OpenCV has no CascadeClassifier; opencv-contrib-python-headless has")
    path = tmp_path / "robot.xml"
    path.write_text(to_xml(shipped_cascade()))
    classifier, size = cv2.CascadeClassifier(str(path)), (SIDE, SIDE)
    full = shipped_cascade()
    first = replace(full, ends=full.ends[:1], limits=full.limits[:1])
    one = other = both = 0
    for seed in range(720_000, 720_020):
        scene = draw_scene(seed, NADIR, 4)
        scale = SIDE / scene.tops()[1].mean()
        small = cv2.resize(scene.image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
        across, down = (range(0, n - SIDE + 1, 2) for n in small.shape[::-1])
        places = np.array([(x, y) for y in down for x in across])
        windows = windows_of(small, places)
        looked = visited(windows, len(across), first)
        passed = places[passing(windows, shipped_cascade()) & looked]
        ours = {tuple(place) for place in passed.tolist()}
        found = classifier.detectMultiScale(small, 1.1, 0, 0, size, size)
        theirs = {(int(x), int(y)) for x, y, *_ in found}
        one, other, both = one + len(ours), other + len(theirs), both + len(ours & theirs)
    assert both >= 0.99 * max(one, other) > 50, (both, one, other)
