from __future__ import annotations

import io
import json
import subprocess
import sys
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from agents.classical import ZeroPolicy
from agents.registry import names, shipped
from eval import jobs, leaderboard, results, tables
from eval.board import make_board, missing_row
from eval.columns import figure, interval, share
from eval.jobs import plan_scene
from eval.leaderboard import Options, run
from visenvs.core.cli import guarded
from visenvs.core.registry import environment_files, laws, load_task
from visenvs.core.units import FOOT

ENV = "visenvs/Rendezvous-v0"
ROOT = Path(__file__).resolve().parents[2]
KEYS = {
    *("env", "scenario", "estimator", "perception", "policy", "information", "episodes"),
    *("cost_mean", "cost_median", "cost_ci", "cost_p95", "success_rate", "failure_rate"),
    *("miss_mean", "effort_mean", "nees_mean", "diff_to", "diff_mean", "diff_ci"),
    *("prob_improvement", "us_per_decision"),
}


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.setattr(results, "RESULTS", tmp_path / "results")
    return tmp_path / "results"


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """Rows, page and Markdown of one small run."""
    out = tmp_path_factory.mktemp("leaderboard")
    (out / "README.md").write_text("# top\n<!-- leaderboard -->\n<!-- /leaderboard -->\nend\n")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(results, "RESULTS", out / "results")
        options = Options(
            env=ENV,
            policies="zero,osa",
            episodes=60,
            json=out / "rows.json",
            html=out / "page.html",
            markdown=out / "README.md",
        )
        assert guarded(lambda: run(options)) == 0
    return out


@pytest.fixture(scope="module")
def rows(written):
    return json.loads((written / "rows.json").read_text(), parse_constant=pytest.fail)["rows"]


def row_of(rows, policy, estimator="ekf"):
    return next(r for r in rows if (r["policy"], r["estimator"]) == (policy, estimator))


def test_rows_have_the_published_keys(rows):
    for row in rows:
        assert KEYS <= set(row)
        assert set(row) - KEYS == {"label", "cost_iqm", "lost_rate", "aside_mean", "reason"}


def test_the_reference_flies_too_and_every_law_once_more_on_the_truth(rows):
    flown = [(row["policy"], row["estimator"]) for row in rows]
    assert sorted(flown) == [
        ("lq", "ekf"),
        ("lq", "truth"),
        ("osa", "ekf"),
        ("osa", "truth"),
        ("zero", "ekf"),
    ]


def test_the_best_comes_first_and_the_truth_stands_apart(rows):
    flying = [row["cost_mean"] for row in rows if row["estimator"] == "ekf"]
    told = [row["cost_mean"] for row in rows if row["estimator"] == "truth"]
    assert [row["cost_mean"] for row in rows] == sorted(flying) + sorted(told)


def test_estimation_has_a_price(rows):
    for law in ("lq", "osa"):
        told, guessing = row_of(rows, law, "truth"), row_of(rows, law)
        assert told["cost_mean"] < guessing["cost_mean"]
        assert (told["information"], guessing["information"]) == ("truth", "belief")
        assert told["nees_mean"] is None
        assert guessing["nees_mean"] > 0.0
        assert told["success_rate"] == 1.0
    assert row_of(rows, "zero")["information"] == "none"


def test_figures_agree_with_the_seeds_in_the_files(rows, written):
    for row in rows:
        name = f"{row['policy']}.json"
        path = written / "results" / "Rendezvous-v0" / "random" / row["estimator"] / name
        content = json.loads(path.read_text())
        cost = np.array(content["metrics"]["total_cost"])
        assert content["seeds"] == list(range(100_000, 100_060))
        assert row["episodes"] == len(cost) == 60
        assert row["cost_mean"] == pytest.approx(cost.mean())
        assert row["cost_median"] == pytest.approx(np.median(cost))
        assert row["cost_p95"] == np.sort(cost)[56]
        assert row["cost_ci"][0] < cost.mean() < row["cost_ci"][1]
        assert row["success_rate"] == content["outcomes"].count("success") / 60
        assert row["failure_rate"] == pytest.approx(1.0 - row["success_rate"])


def test_differences_are_to_the_reference_law_on_the_estimate(rows):
    reference = row_of(rows, "lq")
    for row in rows:
        assert row["diff_to"] == "lq"
        assert row["diff_mean"] == pytest.approx(row["cost_mean"] - reference["cost_mean"])
    assert reference["diff_ci"] == [0.0, 0.0]
    assert reference["prob_improvement"] == 0.5
    assert row_of(rows, "zero")["diff_ci"][0] > 0.0


def test_a_second_run_gives_the_same_figures(rows, tmp_path):
    options = Options(env=ENV, policies="zero,osa", episodes=60, json=tmp_path / "again.json")
    run(options)
    again = json.loads((tmp_path / "again.json").read_text())["rows"]
    for before, after in zip(rows, again, strict=True):
        assert before | {"us_per_decision": after["us_per_decision"]} == after


def test_the_page_and_the_readme_hold_every_policy(written):
    text = (written / "page.html").read_text()
    readme = (written / "README.md").read_text()
    assert readme.startswith("# top\n<!-- leaderboard -->\n| policy |")
    assert readme.endswith("\n<!-- /leaderboard -->\nend\n")
    for label in ("zero", "osa", "lq", "lq (truth)", "osa (truth)"):
        assert f'data-value="{label}"' in text
        assert f"| {label} |" in readme


def test_by_default_every_environment_flies_with_what_ships():
    flying = set()
    for env in environment_files():
        scene = plan_scene(env, None, None, None, None)
        told = [job.policy for job in scene.jobs if job.told_truth]
        assert {"zero", "random", *shipped(env)} <= {job.policy for job in scene.jobs}
        assert all(job.entry is not None for job in scene.jobs)
        assert set(told) <= set(laws())
        assert scene.scenario == next(iter(load_task(env).scenarios))
        flying |= {job.policy for job in scene.jobs}
        task = load_task(env)  # a law may be for another scenario than the default
        flying |= {name for config in task.scenarios.values() for name in names(task, config)}
    assert set(laws()) <= flying


def test_a_model_brings_its_own_information_set():
    scene = plan_scene("visenvs/Tracking2D-v0", None, None, ["recurrent-ppo", "ppo-lq"], "lq")
    assert [job.entry.information for job in scene.jobs[:3]] == ["raw", "belief", "belief"]
    assert [job.entry.config.observation for job in scene.jobs[:3]] == ["raw", "belief", "belief"]


def test_a_task_adds_columns_of_its_own(written):
    task = load_task("visenvs/BearingsOnly-v0")
    options = Options(env=task.id, policies="straight", episodes=20, json=written / "bearings.json")
    assert guarded(lambda: run(options)) == 0
    row = json.loads((written / "bearings.json").read_text())["rows"][0]
    errors = results.load(next(results.RESULTS.rglob("straight.json"))).episodes.metrics
    worst = np.sort(errors["position_error_mean"])
    assert row["position_error_mean"] == pytest.approx(worst.mean())
    assert row["position_error_mean_p99"] == worst[-1]
    assert row["lost_rate"] is None


def test_disasters_are_counted_apart(written):
    task = load_task("visenvs/Tracking2D-v0")
    options = Options(env=task.id, policies="zero", episodes=50, json=written / "tracking.json")
    assert guarded(lambda: run(options)) == 0
    rows = json.loads((written / "tracking.json").read_text())["rows"]
    costs = results.load(next(results.RESULTS.rglob("zero.json"))).episodes.cost
    zero = next(row for row in rows if row["policy"] == "zero")
    assert zero["aside_mean"] == pytest.approx(0.0, abs=1e-12)  # thesis: it lies straight ahead
    assert 0.0 < zero["lost_rate"] < 1.0
    assert zero["lost_rate"] == np.mean(costs / FOOT**2 > 200.0)


def test_one_estimator_for_all_leaves_no_second_row():
    scene = plan_scene(ENV, "thesis", "truth", ["lq", "lq", "zero"], "lq")
    assert [str(job) for job in scene.jobs] == ["lq (truth)", "zero (truth)"]
    assert scene.scenario == "thesis"


def shy(task, config):
    """A factory of a policy that refuses this environment."""
    raise jobs.NotApplicable("needs a map, which is not given")


def clumsy(task, config):
    """A factory with a bug."""
    return config.no_such_thing


def deaf(task, config):
    """A factory of a policy with a bug."""

    class Deaf(ZeroPolicy):
        def predict(self, observation, state=None, episode_start=None, deterministic=True):
            return observation.no_such_thing, state

    return Deaf(task)


@pytest.fixture
def own(monkeypatch):
    """This file as a module of the user's own."""
    monkeypatch.setitem(sys.modules, "own_policies", sys.modules[__name__])


def test_a_policy_that_cannot_fly_here_is_shown_with_the_reason(own, tmp_path, capsys):
    options = Options(env=ENV, policies="own_policies:shy", episodes=5, json=tmp_path / "rows.json")
    run(options)
    rows = json.loads((tmp_path / "rows.json").read_text())["rows"]
    row = row_of(rows, "own_policies:shy")
    assert (row["reason"], row["cost_mean"]) == ("needs a map, which is not given", None)
    assert KEYS <= set(row)
    out = capsys.readouterr().out
    assert "n/a: own_policies:shy: needs a map" in out


def one_line(options, capsys):
    """Exit code and the one line that a wrong command line leaves."""
    code = guarded(lambda: run(options))
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.count("\n") == 1
    assert "Traceback" not in captured.err
    return code, captured.err


@pytest.mark.parametrize(
    "wrong, words",
    [
        ({"env": "visenvs/Rendezvou-v0"}, "unknown environment 'visenvs/Rendezvou-v0'"),
        ({"scenario": "thesiss"}, "unknown scenario of visenvs/Rendezvous-v0 'thesiss'"),
        ({"policies": "lqq"}, "unknown policy 'lqq'"),
        ({"policies": "lq,,osa"}, "single commas between them, got 'lq,,osa'"),
        ({"policies": ""}, "single commas"),
        ({"policies": "nowhere.zip"}, "nowhere.zip"),
        ({"policies": "own_policies:missing"}, "own_policies:missing"),
        ({"policies": "own_policies:clumsy"}, "'own_policies:clumsy' cannot be made: Attribute"),
        ({"policies": "own_policies:deaf"}, "policy 'own_policies:deaf' on visenvs/Rendezvous-v0"),
        ({"reference": "nobody"}, "unknown policy 'nobody'"),
        ({"estimator": "oracle"}, "unknown choice 'oracle'"),
        ({"episodes": 0}, "must be from 1 to 1000, got 0"),
        ({"episodes": -3}, "must be from 1 to 1000, got -3"),
        ({"episodes": 1001}, "must be from 1 to 1000, got 1001"),
    ],
)
def test_a_wrong_option_is_one_line_and_leaves_no_output(own, wrong, words, tmp_path, capsys):
    given = {"env": ENV, "policies": "lq", "episodes": 2, "json": tmp_path / "rows.json"} | wrong
    code, line = one_line(Options(**given), capsys)
    assert code == 1
    assert words in line
    assert not (tmp_path / "rows.json").exists()


@pytest.mark.parametrize("option", ["json", "html", "markdown"])
@pytest.mark.parametrize("place", ["nowhere/file", "."])
def test_an_output_that_cannot_be_written_fails_before_anything_flies(
    option, place, tmp_path, capsys, monkeypatch
):
    monkeypatch.setattr(leaderboard, "fly", None)  # would fail otherwise if called
    code, line = one_line(Options(env=ENV, policies="lq", **{option: tmp_path / place}), capsys)
    assert code == 1
    assert "cannot write" in line


def test_a_readme_without_markers_fails_before_anything_flies(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(leaderboard, "fly", None)
    (tmp_path / "README.md").write_text("no table here")
    code, line = one_line(Options(env=ENV, markdown=tmp_path / "README.md"), capsys)
    assert code == 1
    assert "<!-- leaderboard -->" in line


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04 not a zip", b"plain text"])
def test_a_corrupt_model_is_one_line(content, tmp_path, capsys):
    model = tmp_path / "model.zip"
    model.write_bytes(content)
    code, line = one_line(Options(env=ENV, policies=str(model), episodes=2), capsys)
    assert code == 1
    assert str(model) in line


def test_an_interrupted_run_says_what_is_missing_and_keeps_what_is_finished(
    tmp_path, capsys, monkeypatch, folder
):
    flown = []

    def fly_shard(*args):
        if flown:
            raise KeyboardInterrupt
        flown.append(args)
        return original(*args)

    original = jobs.fly_shard
    monkeypatch.setattr(jobs, "fly_shard", fly_shard)
    options = Options(env=ENV, policies="lq,osa", episodes=2, json=tmp_path / "rows.json")
    code, line = one_line(options, capsys)
    assert code == 130
    assert "1 of 4 finished" in line
    assert "missing: osa (ekf), lq (truth), osa (truth)" in line
    assert [path.name for path in folder.rglob("*") if path.is_file()] == ["lq.json"]
    assert not (tmp_path / "rows.json").exists()


def test_the_command_line_itself():
    command = [sys.executable, "-m", "eval.leaderboard", "--episodes", "0"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=120)
    assert done.returncode == 1
    assert done.stderr.startswith("error: --episodes must be from 1 to 1000, got 0")
    assert done.stderr.count("\n") == 1
    done = subprocess.run([*command[:3], "--help"], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0
    assert all(f"--{field.name}" in done.stdout for field in fields(Options))


@pytest.mark.parametrize("width", [60, 80, 120, 200])
def test_no_terminal_cuts_a_figure(width, rows):
    task = load_task(ENV)
    lines = [(row | {"reason": None}, None) for row in rows]
    lines.append((missing_row(ENV, "random", "ekf", "points", "pn", "no camera"), None))
    console = Console(width=width, file=io.StringIO())
    tables.show(make_board(task, "random", lines), console)
    text = console.file.getvalue()
    assert "…" not in text
    for row in rows:
        assert figure(row["cost_mean"]) in text
        assert interval(row["cost_ci"]) in text


@pytest.mark.parametrize(
    "value, text",
    [
        (None, "-"),
        (float("inf"), "∞"),
        (0.0, "0"),
        (65_211.0, "65,200"),
        (404.9, "405"),
        (99.96, "100"),
        (8.5114, "8.51"),
        (9.999, "10.0"),
        (0.5214, "0.521"),
        (0.0694, "0.0694"),
        (-19.06, "-19.1"),
        (0.00013, "0.00013"),
        (12_345_678.0, "1.2e+07"),
    ],
)
def test_figures_have_three_digits(value, text):
    assert figure(value) == text


def test_shares_are_percent():
    assert (share(None), share(0.659), share(1.0)) == ("-", "65.9 %", "100.0 %")


def test_each_environment_has_a_reference_of_its_own():
    assert plan_scene(ENV, None, "ekf", ["zero"], None).reference == "lq"
    scene = plan_scene("visenvs/BearingsOnly-v0", None, None, ["zero", "lq"], None)
    assert scene.reference == "straight"
    flying = {job.policy: job.entry is not None for job in scene.jobs}
    assert flying == {"zero": True, "lq": False, "straight": True}
    assert plan_scene(ENV, None, "ekf", ["zero"], "pn").reference == "pn"


def test_without_an_environment_those_are_flown_in_which_all_can():
    def flown(**options):
        return [scene.task.id for scene in leaderboard._scenes(Options(**options), names)]

    names = None
    assert flown() == list(environment_files())
    assert flown(scenario="thesis") == ["visenvs/Rendezvous-v0", "visenvs/Tracking2D-v0"]
    names = ["lq", "ppo-lq"]
    assert flown() == ["visenvs/Rendezvous-v0", "visenvs/Tracking2D-v0"]
    names = ["straight"]
    assert flown() == ["visenvs/BearingsOnly-v0"]
    for names, message in ((["osaa"], "unknown policy 'osaa'"), (["lq", "straight"], "lq|--env")):
        with pytest.raises(ValueError, match=message):
            flown(policies=",".join(names))


def test_images_are_flown_when_asked_and_kept_beside_the_points(tmp_path):
    scene = plan_scene("visenvs/Avoidance-v0", None, None, ["zero"], "zero", perception="images")
    assert {job.perception for job in scene.jobs} == {"images"}
    assert not scene.asides
    with pytest.raises(ValueError, match="has no setting 'perception'"):
        plan_scene("visenvs/Rendezvous-v0", None, None, ["zero"], "zero", perception="images")
