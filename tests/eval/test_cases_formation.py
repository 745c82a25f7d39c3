"""The cases of formation flight: logs and replays agree with what was flown."""

from __future__ import annotations

import numpy as np
import pytest

from eval.cases import fig7, gtmax, ukf
from eval.cases._formation import errors, figure, fly, in_heading, record, replay, root_mean, scene
from visenvs.core.units import FOOT

SHORT = {"t_f": 8.0, "score_from": 2.0}


def test_a_replay_of_the_filter_that_flew_is_what_it_told():
    log = record("gtyak", 3, **SHORT)
    assert log.shape == (81, 3)
    again = replay(log, scene("gtyak", **SHORT)[1])
    e = in_heading(log, again["e"][..., :3])
    assert e / FOOT == pytest.approx(errors(log), abs=1e-6)
    assert in_heading(log, again["a"]) == pytest.approx(log["ahat_L_F"], abs=1e-9)
    assert again["b"] == pytest.approx(log["bhat"], abs=1e-9)


def test_a_log_gives_the_errors_that_the_flights_report():
    log, records = record("gtyak", 3, **SHORT), fly("gtyak", 3, **SHORT)
    late = errors(log)[20:]
    assert np.mean(late**2, axis=0) == pytest.approx(records["square_r"] / FOOT**2, rel=1e-4)


def test_another_filter_flies_the_same_log():
    log = record("gtyak", 3, **SHORT)
    told = [replay(log, scene("gtyak", estimator=e, **SHORT)[1])["e"] for e in ("ekf", "ukf")]
    assert np.abs(told[0] - told[1])[40:].max() < 1.0 and (told[0] != told[1]).any()


def test_a_figure_without_flights_is_not_a_number():
    row = figure("none", np.zeros(0), root_mean)
    assert np.isnan(row.ours) and row.n == 0 and row.ok is None
    assert figure("one", np.array([4.0, 16.0]), root_mean).ours == pytest.approx(10**0.5)


@pytest.mark.parametrize("case", [fig7, gtmax, ukf])
def test_rows_have_names_of_their_own_and_pass_on_few_flights(case):
    rows = case.rows(2)
    names = [row.id for row in rows]
    assert len(set(names)) == len(names)
    assert all(name.startswith(f"{case.CASE}/") for name in names)
