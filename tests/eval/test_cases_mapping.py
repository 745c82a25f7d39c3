"""Errors that the mapping cases count, and that the cases hold what they promise on a few seeds."""

from __future__ import annotations

import numpy as np
import pytest

from eval.cases import _terrain, fig15, fig16
from eval.cases._mapping import coverage, fly, line_errors, settings, start, work
from visenvs.core.units import FOOT

SEEDS = np.array([100000], np.uint64)


def mapped(scenario, points=0):
    """A room whose map is the truth."""
    room = start(settings(scenario, "four", points), SEEDS)[0]
    n, m = int(room["edges"]), room["map"]
    m["alive"][:n], m["closed"][:n], m["owner"][:n] = 1.0, 1.0, np.arange(n)
    m["x"][:n], m["P"][:n], m["used"] = room["edge"][:n], 1e-4 * np.eye(6), n
    return room


def test_errors_of_ends_and_lines_are_in_feet_in_any_order():
    room = mapped("pyramid")
    assert line_errors(room) == (pytest.approx(np.zeros(8)), pytest.approx(np.zeros(8)))
    m = room["map"]
    m["x"][0] = np.roll(m["x"][0], 3)
    along = m["x"][0, 3:] - m["x"][0, :3]
    m["x"][0] += np.tile(along / np.linalg.norm(along), 2) * FOOT  # slides by a foot
    m["x"][1, [2, 5]] -= 2 * FOOT
    ends, across = line_errors(room)
    assert ends[:2] == pytest.approx([1.0, 2.0]) and across[0] == pytest.approx(0.0, abs=1e-6)
    assert 0.5 < across[1] < 2.0
    m["alive"][2] = 0.0
    assert len(line_errors(room)[0]) == 7


def test_coverage_is_the_share_of_the_length_that_has_a_line():
    room = mapped("frame")
    assert coverage(room) == 1.0
    room["map"]["alive"][0] = 0.0
    assert coverage(room) == pytest.approx(0.75, abs=0.01)
    x = room["map"]["x"][1]
    x[3:] = 0.5 * (x[:3] + x[3:])
    assert coverage(room) == pytest.approx(0.63, abs=0.01)  # and half a foot beyond its end


def test_points_of_terrain_are_where_lines_meet():
    room = mapped("terrain", _terrain.POINTS)
    assert len(_terrain.true_points(room)) == 256
    assert _terrain.point_errors(room) == pytest.approx(np.zeros(256), abs=1e-6)
    m = room["map"]
    m["x"][:480, [2, 5]] -= 3 * FOOT
    assert _terrain.point_errors(room) == pytest.approx(np.full(256, 3.0))
    m["closed"][:480] = 0.0
    m["closed"][0] = 1.0
    assert np.isfinite(_terrain.point_errors(room)).sum() == 2


def test_the_zigzag_is_flown_at_the_published_speed():
    path = fig16.zigzag()
    steps = np.linalg.norm(np.diff(path, axis=0), axis=1)
    assert np.median(steps) == pytest.approx(15 * FOOT * 0.02) and steps.max() < 0.1
    assert np.abs(path[:, :2]).max() <= 34 * FOOT + 1e-9


@pytest.mark.parametrize("case", [fig15, fig16])
def test_a_few_seeds_hold_the_bands_of_what_does_not_scatter(case):
    rows = {row.id: row for row in case.rows(3)}
    counted = [row for name, row in rows.items() if not name.endswith("_ft")]
    assert len(counted) > 5 and all(row.ok is not False for row in counted)
    wide = [row for row in rows.values() if row.high is not None and row.id.endswith("_ft")]
    assert len(wide) > 1 and all(row.ours < 2.0 * row.high for row in wide)


def broken(room):
    """How many lines of a map have a covariance that is none."""
    m = room["map"]
    return sum(np.linalg.eigvalsh(P).min() <= 0.0 for P in m["P"][m["alive"] > 0])


def test_lines_that_the_published_update_breaks_are_deleted_and_begun_anew():
    """In the first hundred images; where nothing is deleted they are still there."""
    seeds, left = np.arange(100000, 100006, dtype=np.uint64), {}
    path, gaze = fig15.turn(fig15.IMAGES)
    for keeps in ("some", "all"):
        never = dict.fromkeys(("delete_after", "age_out", "patience"), 10**6)
        changes = never if keeps == "all" else {}
        config = settings("pyramid", "printed", p_split=fig15.SPLIT, **changes)
        rooms = start(config, seeds)
        fly(rooms, seeds, path[:100], gaze[:100], 0, config, work())
        assert rooms["map"]["indefinite"].sum() > 10
        left[keeps] = sum(broken(room) for room in rooms)
    assert left["all"] > left["some"] == 0
