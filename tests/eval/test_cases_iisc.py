from __future__ import annotations

import math

import numpy as np
import pytest

from eval.cases import _iisc, iisc_2, iisc_3, iisc_4, iisc_5, iisc_sigma
from eval.cases._iisc import ENTRIES, OURS, approach, flight, fly, setting, success
from visenvs.core.registry import find_law

TABLES = (iisc_2, iisc_3, iisc_4, iisc_5)
FEW = 12  # episodes


def track(x: tuple[float, ...], variances: tuple[float, ...], anchor=(0.0, 0.0, 0.0)):
    """Records of one vehicle at (1, 2, 3) with one track."""
    tracks = np.dtype([(n, "f8", (1, 3)) for n in ("x", "anchor")] + [("P", "f8", (1, 3, 3))])
    records = np.zeros(1, [("r_V_N", "f8", (3,)), ("tracks", tracks)])
    records["r_V_N"] = 1.0, 2.0, 3.0
    records["tracks"]["x"][0, 0], records["tracks"]["anchor"][0, 0] = x, anchor
    records["tracks"]["P"][0, 0] = np.diag(variances)
    return records


def test_the_closest_approach_is_beside_the_path_or_at_one_of_its_ends():
    a = np.array([[-3.0, 4.0, 0.0], [1.0, 2.0, 2.0], [-5.0, 0.0, 3.0], [3.0, 0.0, 4.0]])
    b = np.array([[9.0, 4.0, 0.0], [2.0, 4.0, 4.0], [-4.0, 0.0, 3.0], [3.0, 0.0, 4.0]])
    np.testing.assert_allclose(approach(a, b), [4.0, 3.0, 5.0, 5.0])


def test_success_takes_every_obstacle_and_the_target():
    closest = np.array([[1.05, 0.95], [1.05, 1.15], [0.85, 1.0], [1.0, 1.0]])
    miss = np.array([9.9, 0.0, 0.0, 10.0])
    np.testing.assert_array_equal(success(closest, miss, 0.1), [True, False, False, False])
    np.testing.assert_array_equal(success(closest, miss, 0.2), [True, True, True, False])


@pytest.mark.parametrize("table", TABLES)
def test_wider_bands_and_fewer_obstacles_are_easier(table):
    for shares in table.PAPER.values():
        assert list(shares) == sorted(shares)
        assert all(both <= one for both, one in zip(table.PAPER["all"], shares, strict=True))


def test_only_what_is_called_truth_is_told_the_truth():
    for name, (law, changes) in (ENTRIES | OURS | _iisc.OVERLAP).items():
        card = find_law(law.format("dgg"))
        assert card is not None
        told = name.startswith("truth")
        assert ("r_OV_N" in card.needs) == told == (("observation", "told") in changes)


def test_errors_of_the_spherical_filter_are_counted_in_deviations():
    place = np.array([1.0, 2.0 + 30.0, 3.0 + 40.0])  # range 50, east and down
    truth = 50.0, 0.5 * math.pi, math.atan2(40.0, 30.0)
    records = track((truth[0] + 6.0, truth[1] - 0.2, truth[2]), (9.0, 0.01, 0.04))
    errors = iisc_sigma.spherical_errors(records, 0, place)
    np.testing.assert_allclose(errors, [[2.0, -2.0, 0.0]], atol=1e-12)


def test_an_angle_errs_by_the_shorter_way_round():
    place = np.array([1.0 - 10.0, 2.0 - 1e-9, 3.0])  # theta just above -pi
    errors = iisc_sigma.spherical_errors(track((10.0, 3.1, 0.0), (1.0, 1.0, 1.0)), 0, place)
    assert errors[0, 1] == pytest.approx(3.1 - math.pi)


def test_errors_of_the_inverse_range_filter_are_as_from_its_anchor():
    anchor = np.array([-4.0, 0.0, 1.0])
    records = track((0.1, -0.3, 0.025), (0.04, 0.01, 1e-4), tuple(anchor))
    cosine = math.cos(-0.1)
    toward = np.array([cosine * math.cos(0.3), cosine * math.sin(0.3), math.sin(-0.1)])
    errors = iisc_sigma.inverse_errors(records, 0, anchor + 50.0 * toward)
    np.testing.assert_allclose(errors, [[0.5, -1.0, -2.0]], atol=1e-12)


def test_there_is_no_control_before_the_end_of_the_pre_run():
    config = setting("one")
    first = round(config.pre_run / config.dt)
    for step, records in enumerate(flight("one", "dgg", FEW, ENTRIES["known"].changes)):
        assert step > first or not records["a_V_N"].any()
    assert records["step"].min() > first
    assert (np.abs(records["r_V_N"] - records["r_V_N"][:1])[:, 1:] > 0.0).any()


@pytest.mark.parametrize("scene", ["one", "two"])
def test_who_knows_where_the_obstacles_are_enters_no_sphere_and_hits_the_target(scene):
    known = fly(scene, "dgg", FEW, ENTRIES["known"].changes)
    assert known.closest.shape == (FEW, {"one": 1, "two": 2}[scene])
    assert known.closest.min() > 0.98
    assert known.miss.max() < 1.0


def test_the_miss_is_no_larger_than_in_the_plane_of_the_target():
    _, changes = OURS["best"]
    *_, last = flight("two", "dgg", FEW, changes)
    assert (fly("two", "dgg", FEW, changes).miss <= last["miss_distance"] + 1e-9).all()


def test_dgg_and_ngg_are_one_law():
    assert _iisc.difference("one", "truth", FEW) <= _iisc.SAME


def test_every_row_of_a_table_has_a_name_of_its_own():
    ids = [row.id for row in (*iisc_4.rows(FEW), *iisc_sigma.rows(FEW))]
    assert len(ids) == len(set(ids))
    assert {"iisc-4/truth/S1", "iisc-4/estimate/S4", "iisc-4/best/S1", "iisc-4/hug/S2"} <= set(ids)
