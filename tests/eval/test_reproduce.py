"""The papers' figures: which rows there are, their verdicts, what is written, what is refused."""

from __future__ import annotations

import json
import runpy
from types import SimpleNamespace

import numpy as np
import pytest

from eval import reproduce
from eval.cases import Row, cases, lq_gains, rendezvous, standard_error
from eval.reproduce import Options, main
from visenvs.core.cli import guarded
from visenvs.core.provenance import CHECKOUT

KEYS = ["id", "paper", "ours", "se", "n", "low", "high", "ok"]
PUBLISHED = {
    "lq-gains": {"lq-gains/max_error"},
    "rendezvous": {
        f"rendezvous/{q}/{law}/{figure}"
        for q in ("q0", "q01")
        for law in ("lq", "osa")
        for figure in ("miss_ft_median", "miss_ft_mean", "J_mean")
    },
    "table2": {
        f"table2/{solver}/n={n}/{part}"
        for solver in ("exact", "gauss_seidel")
        for n in (0, 1, 50, 100)
        for part in ("Jf", "Jc", "J")
    },
    "table3": {
        f"table3/{solver}/n={n}/{part}"
        for solver in ("exact", "gauss_seidel")
        for n in (0, 1, 50, 100)
        for part in ("step_s", "total_s", "share_of_period", "over_thesis")
    },
    "table4": {
        f"table4/{solver}/p={p}/{part}"
        for solver in ("exact", "gauss_seidel")
        for p in (0, 10, 60, 100)
        for part in ("Jf", "Jc", "J")
    },
    "table5": {
        f"table5/{solver}/p={p}/{part}"
        for solver in ("exact", "gauss_seidel")
        for p in (0, 10, 60, 100)
        for part in ("step_s", "total_s", "share_of_period", "over_thesis")
    },
    "fig47": {f"fig47/exact/n={n}/J" for n in (0, 1, 2, 5, 10, 20, 30, 50, 70, 100)},
    "fig50": {"fig50/exact/exponent"},
}
BANDS = {
    "lq-gains/max_error": (0.0, 1e-12),
    "rendezvous/q0/lq/miss_ft_median": (1.7, 2.8),
    "rendezvous/q0/osa/miss_ft_median": (0.2, 0.45),
    "rendezvous/q01/lq/miss_ft_median": (12.0, 15.0),
    "rendezvous/q01/osa/miss_ft_median": (None, 1.5),
    "rendezvous/q0/J_cut": (10.0, None),
    "rendezvous/q01/J_cut": (10.0, None),
    "table2/exact/n=0/Jf": (46.0, 55.0),
    "table2/exact/n=1/J": (19.0, 23.0),
    "table2/exact/n=50/J": (4.6, 5.1),
    "table2/exact/n=100/J": (4.6, 5.1),
    "table2/gauss_seidel/n=0/Jf": (46.0, 55.0),
    "table2/gauss_seidel/n=1/J": (19.0, 23.0),
    "table2/gauss_seidel/n=100/J": (9.3, 10.5),
    "table4/exact/p=60/J": (4.6, 5.1),
    "table4/gauss_seidel/p=10/J": (24.8, 25.8),
    "table4/gauss_seidel/p=60/J": (8.6, 9.6),
}

# figures of those that are left of two flights, or of two pictures
SOME_LEFT_OUT = ("fig10/", "fig11/", "string/", "leader/")


@pytest.fixture(scope="module")
def flown():
    """Rows of every case, from two episodes."""
    return {name: case.rows(2) for name, case in cases().items()}


@pytest.fixture(scope="module")
def ours(flown):
    return {row.id: row.ours for rows in flown.values() for row in rows}


def test_every_published_row_is_there_once(flown):
    assert PUBLISHED.keys() <= flown.keys()
    every = [row.id for rows in flown.values() for row in rows]
    assert len(every) == len(set(every))
    for name, rows in flown.items():
        assert all(row.id.startswith(f"{name}/") for row in rows)
        assert PUBLISHED.get(name, set()) <= {row.id for row in rows}


def test_every_case_stands_on_one_page_and_is_recorded():
    pages = runpy.run_path(str(CHECKOUT / "docs" / "pages.py"))
    assert sorted(name for names in pages["CASES"].values() for name in names) == sorted(cases())
    assert {row["id"].split("/")[0] for row in pages["recorded"]()["rows"]} == set(cases())


def test_the_bands_are_those_that_were_agreed(flown):
    rows = [row for name in PUBLISHED for row in flown[name] if row.ok is not None]
    assert {row.id: (row.low, row.high) for row in rows} == BANDS


def test_rows_are_plain_figures(flown):
    for row in (row for rows in flown.values() for row in rows):
        assert np.isfinite(row.ours) and row.se >= 0.0
        assert row.n >= 2 or row.id.startswith(SOME_LEFT_OUT)
        assert row.paper is None or row.paper >= 0.0


def test_errors_are_of_those_that_were_not_lost(flown):
    # whether one of these leaders is lost depends on the last digits, which differ between machines
    rows = {row.id: row for name in ("fig10", "fig11") for row in flown[name]}
    for lost in [row for name, row in rows.items() if name.endswith("/lost")]:
        kept = lost.n - round(lost.ours * lost.n)
        errors = [row for name, row in rows.items() if name.startswith(lost.id[:-4])]
        assert {row.n for row in errors if row is not lost} == ({kept} if kept else set())


def test_a_total_cost_is_its_parts(ours):
    for name in [name for name in ours if name.endswith("/Jf")]:
        at = name.removesuffix("/Jf")
        assert ours[f"{at}/Jf"] + ours[f"{at}/Jc"] == pytest.approx(ours[f"{at}/J"])


def test_tables_agree_where_they_tell_of_the_same_law(ours):
    for part in ("Jf", "Jc", "J"):
        for solver in ("exact", "gauss_seidel"):
            tables = f"table2/{solver}/n={{}}/{part}", f"table4/{solver}/p={{}}/{part}"
            assert ours[tables[0].format(0)] == ours[tables[1].format(0)]
            assert ours[tables[0].format(100)] == pytest.approx(ours[tables[1].format(100)])
        assert ours[f"table2/exact/n=0/{part}"] == ours[f"table2/gauss_seidel/n=0/{part}"]
    for n in (0, 1, 50, 100):
        assert ours[f"fig47/exact/n={n}/J"] == ours[f"table2/exact/n={n}/J"]


def test_times_are_told_in_control_periods_and_over_the_thesis_too(flown, ours):
    paper = {row.id: row.paper for name in ("table3", "table5") for row in flown[name]}
    for name in [name for name in ours if name.endswith("/step_s")]:
        at = name.removesuffix("/step_s")
        assert ours[f"{at}/share_of_period"] == pytest.approx(ours[name] / 0.1)
        assert ours[f"{at}/over_thesis"] == pytest.approx(ours[name] / paper[name])
        assert ours[f"{at}/total_s"] >= ours[name] > 0.0


def test_a_cut_in_cost_is_a_ratio_with_its_error():
    rng = np.random.default_rng(5)
    before, after = 40.0 + rng.normal(size=400), 2.0 + 0.1 * rng.normal(size=400)
    row = rendezvous.cut("cut", before, after)
    assert row.ours == pytest.approx(20.0, rel=0.01)
    exact = 20.0 * np.hypot(1 / 40, 0.1 / 2) / np.sqrt(400)  # of a quotient of independent means
    assert row.se == pytest.approx(exact, rel=0.15)
    assert row.ok is True and rendezvous.cut("cut", after, before).ok is False


def test_the_closed_form_gains_are_the_matrix_solutions(flown):
    (row,) = flown["lq-gains"]
    assert row.ok is True
    assert (row.n, row.se) == (2000, 0.0)


def test_the_comparison_of_gains_finds_the_smallest_difference(monkeypatch):
    def spoilt(T, s_x, s_v):
        K_X, K_V = true(T, s_x, s_v)
        return K_X * (1.0 + 1e-11), K_V

    true = lq_gains.gains
    monkeypatch.setattr(lq_gains, "gains", spoilt)
    monkeypatch.setattr(lq_gains, "TRIALS", 3)
    (row,) = lq_gains.rows(1)
    assert row.ok is False


@pytest.mark.parametrize(
    "low, high, value, ok",
    [
        (None, None, 5.0, None),
        (1.0, 2.0, 1.0, True),
        (1.0, 2.0, 2.0, True),
        (1.0, 2.0, 2.1, False),
        (1.0, None, 0.9, False),
        (1.0, None, 1e9, True),
        (None, 2.0, -1e9, True),
        (None, 2.0, 2.1, False),
        (1.0, 2.0, float("nan"), False),
    ],
)
def test_a_verdict_is_whether_the_band_holds_the_figure(low, high, value, ok):
    assert Row("row", None, value, 0.0, 1, low, high).ok is ok


def test_the_standard_error_of_a_mean_is_the_textbooks():
    values = np.random.default_rng(3).normal(2.0, 5.0, 500)
    assert standard_error(values) == pytest.approx(values.std(ddof=1) / np.sqrt(500), rel=0.05)
    assert standard_error(values) == standard_error(values)
    of_median = np.sqrt(np.pi / 2) * 5.0 / np.sqrt(500)  # of a normal sample
    assert standard_error(values, np.median) == pytest.approx(of_median, rel=0.2)
    assert standard_error(values[:1]) == 0.0


# the command


FINE = Row("made-up/fine", 1.0, 1.1, 0.2, 3, 0.5, 1.5)
TOLD = Row("made-up/told", None, 7.0, 0.0, 3)
FAR = Row("made-up/far", 2.0, 9.0, 0.2, 3, None, 2.5)


@pytest.fixture
def made_up(monkeypatch):
    """Cases by name, each with its rows; they note the episodes that they are asked for."""
    asked = []

    def case(*rows):
        return SimpleNamespace(rows=lambda episodes: asked.append(episodes) or list(rows))

    found = {"good": case(FINE, TOLD), "bad": case(FAR, FINE)}
    monkeypatch.setattr(reproduce, "cases", lambda: found)
    found["drawn"] = case(TOLD)
    found["drawn"].plot = lambda folder, episodes: folder / f"drawn-{episodes}.png"
    return asked


def test_rows_are_written_with_the_published_keys(made_up, tmp_path, capsys):
    asked = Options(cases=("good",), episodes=3, json=tmp_path / "rows.json")
    assert guarded(lambda: main(asked)) == 0
    assert made_up == [3]
    content = json.loads((tmp_path / "rows.json").read_text(), parse_constant=pytest.fail)
    assert [list(row) for row in content["rows"]] == [KEYS, KEYS]
    assert content["rows"][0] == {
        "id": "made-up/fine",
        "paper": 1.0,
        "ours": 1.1,
        "se": 0.2,
        "n": 3,
        "low": 0.5,
        "high": 1.5,
        "ok": True,
    }
    told = content["rows"][1]
    assert (told["paper"], told["low"], told["high"], told["ok"]) == (None, None, None, None)
    assert {"versions", "commit", "seeds", "date"} <= set(content["meta"])
    assert content["meta"]["seeds"] == {"first": 100_000, "last": 100_002, "count": 3}
    lines = [line for line in capsys.readouterr().out.splitlines() if "made-up" in line]
    assert "ok" in lines[0] and "0.5 to 1.5" in lines[0]
    assert "reported" in lines[1]


def test_a_row_outside_its_band_is_an_error_with_everything_written(made_up, tmp_path, capsys):
    asked = Options(cases=("bad", "good"), episodes=3, json=tmp_path / "rows.json")
    assert guarded(lambda: main(asked)) == 1
    captured = capsys.readouterr()
    assert captured.err.splitlines()[-1] == "error: outside the accepted band: made-up/far"
    (line,) = [line for line in captured.out.splitlines() if "made-up/far" in line]
    assert "outside" in line and "-inf to 2.5" in line
    rows = json.loads((tmp_path / "rows.json").read_text())["rows"]
    assert [row["ok"] for row in rows] == [False, True, True, None]


def test_all_cases_run_if_none_is_named_and_each_once(made_up):
    assert guarded(lambda: main(Options(episodes=2))) == 1
    assert made_up == [2, 2, 2]
    assert guarded(lambda: main(Options(cases=("good", "good"), episodes=4))) == 0
    assert made_up[3:] == [4]


def test_a_case_flies_as_often_as_its_bands_need_unless_told(made_up):
    reproduce.cases()["good"].EPISODES = 300
    assert guarded(lambda: main(Options(cases=("good", "drawn")))) == 0
    assert guarded(lambda: main(Options(cases=("good", "drawn"), episodes=4))) == 0
    assert made_up == [300, reproduce.EPISODES, 4, 4]


def test_cases_with_a_picture_draw_it(made_up, tmp_path, capsys):
    asked = Options(cases=("good", "drawn"), episodes=2, plots=tmp_path)
    assert guarded(lambda: main(asked)) == 0
    out = capsys.readouterr().out
    assert f"written: {tmp_path / 'drawn-2.png'}" in out.replace("\n", "")
    assert out.count("written:") == 1


def test_a_real_case_runs_from_the_command(tmp_path, monkeypatch):
    monkeypatch.setattr(lq_gains, "TRIALS", 3)
    asked = Options(cases=("lq-gains",), json=tmp_path / "rows.json")
    assert guarded(lambda: main(asked)) == 0
    (row,) = json.loads((tmp_path / "rows.json").read_text())["rows"]
    assert (row["id"], row["n"], row["ok"]) == ("lq-gains/max_error", 3, True)


@pytest.mark.parametrize(
    "wrong, words",
    [
        ({"cases": ("goood",)}, "unknown case 'goood'; did you mean 'good'? Known: good, bad"),
        ({"cases": ("good", "other")}, "unknown case 'other'"),
        ({"episodes": 0}, "--episodes must be from 1 to 1000, got 0"),
        ({"episodes": -1}, "must be from 1 to 1000, got -1"),
        ({"episodes": 1001}, "must be from 1 to 1000, got 1001"),
        ({"json": "nowhere/rows.json"}, "cannot write"),
        ({"json": "."}, "cannot write"),
        ({"plots": "nowhere"}, "cannot write"),
    ],
)
def test_a_wrong_option_is_one_line_before_anything_flies(made_up, wrong, words, tmp_path, capsys):
    places = {key: tmp_path / value for key, value in wrong.items() if isinstance(value, str)}
    asked = Options(**({"json": tmp_path / "rows.json"} | wrong | places))
    assert guarded(lambda: main(asked)) == 1
    captured = capsys.readouterr()
    assert (captured.out, captured.err.count("\n")) == ("", 1)
    assert words in captured.err
    assert made_up == [] and list(tmp_path.iterdir()) == []


def test_cases_on_pictures_add_their_rows(made_up, monkeypatch, tmp_path):
    reproduce.cases()["good"].image_rows = lambda episodes: [Row("made-up/images", None, 1.0, 0, 1)]
    asked = Options(cases=("good", "drawn"), episodes=2, images=True, json=tmp_path / "rows.json")
    assert guarded(lambda: main(asked)) == 0
    rows = json.loads((tmp_path / "rows.json").read_text())["rows"]
    assert "made-up/images" in [row["id"] for row in rows]


def test_pictures_where_there_are_none_are_an_error(made_up, capsys):
    assert guarded(lambda: main(Options(cases=("drawn",), images=True))) == 1
    assert "none of drawn is flown on rendered pictures" in capsys.readouterr().err
