"""The benchmark's structure, arithmetic and errors; speed itself is never asserted."""

import json
import shutil
import sys

import gymnasium
import numpy as np
import pytest

from eval import benchmark
from eval.benchmarks import Budget, avoidance, filter, groups, left_out, nsa, race, row, training
from visenvs.core.cli import guarded
from visenvs.core.config import override, to_record
from visenvs.core.lanes import Lanes
from visenvs.core.registry import load_task

QUICK = Budget(seconds=0.0, rounds=1)
ENV_ID = "visenvs/Rendezvous-v0"


def solved(make, problems, settings, *more):
    solutions = np.zeros(len(problems), filter.SOLUTION)
    portion = make(problems, settings, solutions, *more)
    assert portion() == len(problems)
    return solutions


def largest_difference(a, b, fields=("rhat", "P")):
    return max(np.abs(a[name] - b[name]).max() for name in fields)


def test_a_group_is_found_by_being_there():
    assert {"avoidance", "faces", "filter", "loop", "nsa", "training"} <= set(groups())
    for name, group in groups().items():
        assert group.__name__.endswith(f".{name}")


def test_a_ratio_is_the_median_over_rounds_of_the_rates_in_the_same_round():
    rates = {"ours": [1.0, 4.0, 9.0], "theirs": [2.0, 8.0, 3.0]}
    compared = row("ours", "steps", rates, "theirs")
    assert (compared.value, compared.ratio, compared.reference) == (4.0, 0.5, "theirs")
    assert row("theirs", "steps", rates).ratio is None


def test_sides_take_turns_and_the_first_portion_does_not_count():
    calls = []

    def side(name, units):
        def portion():
            sum(range(10_000))
            calls.append(name)
            return units

        return portion

    rates = race({"a": side("a", 1), "b": side("b", 10)}, Budget(seconds=0.0, rounds=3))
    turns = [name for name, after in zip(calls, [*calls[1:], None], strict=True) if name != after]
    assert turns in (["a", "b", "a", "b", "a", "b"], ["a", "b", "a", "b", "a", "b", "a", "b"])
    assert {name: len(rate) for name, rate in rates.items()} == {"a": 3, "b": 3}


def test_a_round_lasts_as_long_as_asked():
    calls = 0

    def portion():
        nonlocal calls
        calls += 1
        return 1

    (rate,) = race({"a": portion}, Budget(seconds=0.02, rounds=1))["a"]
    assert (calls - 1) / rate >= 0.02


@pytest.mark.parametrize("name", ["faces", "loop"])
def test_every_row_is_positive_and_compared_with_a_row_that_is_there(name):
    rows = {row.id: row for row in groups()[name].rows(QUICK)}
    assert all(row.value > 0.0 for row in rows.values())
    for one in rows.values():
        assert (one.ratio is None) == (one.reference is None)
        assert one.reference is None or one.reference in rows
    if name == "faces":
        faces = ["single", *(f"vector/{lanes}" for lanes in (1, 16, 256, 1024))]
        expected = {f"faces/{face}": f"faces/cartpole/{face}" for face in faces}
    else:
        expected = {"loop/lanes/1": "faces/single", "loop/lanes/1024": "faces/vector/1024"}
    assert {one.id: one.reference for one in rows.values() if one.reference} == expected


def test_avoidance_is_measured_with_six_tracks():
    rows = groups()["avoidance"].rows(QUICK)
    assert [row.id for row in rows] == ["avoidance/single", "avoidance/vector/1024"]
    assert all(row.value > 0.0 for row in rows)
    env = gymnasium.make(avoidance.ENV_ID, **avoidance.SIX, p_detect=1.0)
    row = env.unwrapped.layout.unpack(env.reset(seed=0)[0])
    assert row["valid_O"].sum() == 6


def test_both_compiled_filters_solve_the_same_problems():
    problems, settings = filter.draw_problems(filter.COUNT), filter.rendezvous_settings()
    stationary = solved(filter.stationary, problems, settings)
    assert largest_difference(solved(filter.vector, problems, settings), stationary) < 1e-12
    assert largest_difference(stationary, problems) > 1e-3
    assert stationary["nis"].max() < settings["gate"][0] ** 2
    filter.check_agreement("filter/vector", stationary, stationary)


def test_filterpy_solves_the_same_problems():
    pytest.importorskip("filterpy")
    problems, settings = filter.draw_problems(50), filter.rendezvous_settings()
    theirs = solved(filter.with_filterpy, problems, settings)
    assert largest_difference(theirs, solved(filter.stationary, problems, settings)) < 1e-9


@pytest.mark.skipif(not (shutil.which("g++") or shutil.which("c++")), reason="no C++ compiler")
@pytest.mark.parametrize("gate", [0.0, 1.0])
def test_cpp_solves_the_same_problems(tmp_path, gate):
    """With a gate of one standard deviation, both leave the same image points out."""
    config = override(load_task(ENV_ID).scenarios["random"], {"gate": gate})
    problems, settings = filter.draw_problems(200), to_record(config)
    problems["rhat"][0] *= -1.0  # behind the camera: linearised at the minimum range
    ours = solved(filter.stationary, problems, settings)
    theirs = solved(filter.with_cpp, problems, settings, tmp_path)
    fields = ("rhat", "P", "innovation")
    assert largest_difference(theirs, ours, fields) < 1e-9
    assert np.allclose(theirs["nis"], ours["nis"], rtol=1e-9)
    left = (ours["rhat"] == problems["rhat"]).all(axis=1)
    assert left.any() == (gate > 0.0)
    assert not left.all()


def test_sides_that_disagree_are_not_compared():
    ours = np.zeros(3, filter.SOLUTION)
    theirs = ours.copy()
    theirs["P"][1, 2, 2] = 2e-9
    with pytest.raises(ValueError, match="filter/cpp differs by 2e-09"):
        filter.check_agreement("filter/cpp", theirs, ours)
    theirs["P"][1, 2, 2] = np.nan
    with pytest.raises(ValueError, match="differs by nan"):
        filter.check_agreement("filter/cpp", theirs, ours)


def test_rows_without_their_tools_are_left_out_and_say_what_brings_them_back(monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "filterpy.kalman", None)
    monkeypatch.setattr(shutil, "which", lambda _name: None)
    rows = filter.rows(QUICK)
    assert [row.id for row in rows] == ["filter/stationary", "filter/vector"]
    assert all(row.reference is None and row.ratio is None for row in rows)
    said = capsys.readouterr().err
    assert "filter/filterpy: n/a: pip install 'visenvs[bench]'" in said
    assert "filter/cpp: n/a: install a C++ compiler" in said


def test_both_references_have_a_row_for_each_filter():
    pytest.importorskip("filterpy")
    if not (shutil.which("g++") or shutil.which("c++")):
        pytest.skip("no C++ compiler")
    found = {row.id: row.reference for row in filter.rows(QUICK)}
    assert found == {
        "filter/stationary": "filter/filterpy",
        "filter/vector": "filter/filterpy",
        "filter/stationary/against-cpp": "filter/cpp",
        "filter/vector/against-cpp": "filter/cpp",
        "filter/filterpy": None,
        "filter/cpp": None,
    }


def test_the_file_and_the_table_hold_each_row_once(tmp_path, capsys):
    path = tmp_path / "benchmark.json"
    benchmark.measure(benchmark.Options(only=("loop", "faces"), json=path), QUICK)
    content = json.loads(path.read_text())
    ids = [row["id"] for row in content["rows"]]
    assert len(set(ids)) == len(ids) == 12
    assert content["rows"][0]["reference"] == "faces/cartpole/single"
    assert set(content["rows"][0]) == {"id", "value", "unit", "reference", "ratio"}
    assert {"versions", "commit", "seeds", "date"} <= set(content["meta"])
    assert content["meta"]["seeds"] == {"first": 0, "last": 1023, "count": 1024}
    assert content["meta"]["command"].startswith("python -m eval.benchmark")
    shown = capsys.readouterr().out
    assert all(name in shown for name in ids)
    assert all(f"{name} wants: {groups()[name].WANTS}" in shown for name in ("faces", "loop"))


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"only": ("face",)}, "did you mean 'faces'?"),
        ({"json": "absent/benchmark.json"}, "no folder"),
    ],
)
def test_mistakes_cost_one_line_and_no_measurement(tmp_path, capsys, options, said):
    if "json" in options:
        options = {"json": tmp_path / options["json"]}
    assert guarded(lambda: benchmark.run(benchmark.Options(**options))) == 1
    printed = capsys.readouterr()
    assert said in printed.err
    assert printed.err.count("\n") == 1
    assert "measuring" not in printed.err + printed.out


def test_a_missing_row_is_named(capsys):
    left_out("filter/cpp", "why")
    assert capsys.readouterr().err == "filter/cpp: n/a: why\n"


def test_lanes_that_never_move_look_like_ours():
    pytest.importorskip("stable_baselines3")
    from train.presets import preset_for
    from train.speed import sides

    lanes, noop = sides(load_task(ENV_ID), preset_for(ENV_ID, "ppo")).values()
    assert noop.observation_space == lanes.observation_space
    assert noop.action_space == lanes.action_space
    assert noop.num_envs == lanes.num_envs
    actions = np.zeros((lanes.num_envs, *lanes.action_space.shape), np.float32)
    for ours, theirs in zip(
        [lanes.reset(), *lanes.step(actions)], [noop.reset(), *noop.step(actions)], strict=True
    ):
        assert len(ours) == len(theirs) == lanes.num_envs
        if isinstance(ours, np.ndarray):
            assert (ours.dtype, ours.shape) == (theirs.dtype, theirs.shape)
    assert all(noop.observation_space.contains(row) for row in noop.reset())


def test_training_is_measured_on_both_sides():
    pytest.importorskip("stable_baselines3")
    from train.presets import Preset
    from train.speed import measure

    small = Preset(4, {"n_steps": 8, "batch_size": 16, "n_epochs": 1}, {"net_arch": [8]})
    rates = measure(load_task(ENV_ID), small, rounds=2)
    assert {side: len(values) for side, values in rates.items()} == {"lanes": 2, "noop": 2}
    assert min(rates["lanes"] + rates["noop"]) > 0.0


def test_training_runs_in_a_process_of_its_own():
    pytest.importorskip("stable_baselines3")
    ours, noop = training.measured("--rounds", "1", "--lanes", "4")
    assert (ours.id, ours.reference, noop.id) == ("training/ppo", "training/noop", "training/noop")
    assert ours.ratio == pytest.approx(ours.value / noop.value)


def test_a_failure_in_that_process_is_reported(monkeypatch):
    monkeypatch.setattr(sys, "executable", shutil.which("false") or pytest.skip("no `false`"))
    with pytest.raises(ValueError, match=r"train\.speed --rounds 1` failed"):
        training.measured("--rounds", "1")


@pytest.fixture(scope="module")
def starts():
    """Cold problems of a few steps, planned."""
    problems = {name: nsa.at_the_start(name, 20) for name in nsa.TASKS}
    for one in problems.values():
        assert nsa.compiled(one)() == nsa.LANES
    return problems


def test_plans_are_measured_in_a_process_of_its_own_and_compared_with_rows_that_are_there():
    rows = {one.id: one for one in nsa.rows(QUICK)}
    expected = {nsa.PERIOD: None, nsa.LINEAR: None}
    for task, whole in (("nsa/plane", 100), ("nsa/space", 200)):
        sides = [*nsa.HORIZONS, "slowest", "en-route"]
        expected |= {f"{task}/{side}": nsa.PERIOD for side in sides}
        expected |= {f"{task}/{kind}exponent": nsa.LINEAR for kind in ("", "evaluation/")}
        expected |= {f"{task}/{side}": None for side in (f"evaluation/{whole}", "scipy")}
        expected[f"{task}/en-route/warm"] = f"{task}/en-route"
        expected[f"{task}/{whole}/against-scipy"] = f"{task}/scipy"
        others = ("no-push", "gauss-seidel", "scipy")
        expected |= {f"{task}/{other}/cost": f"{task}/exact/cost" for other in others}
        expected[f"{task}/exact/cost"] = None
    expected["nsa/plane/gauss-seidel"] = None
    expected["nsa/plane/100/against-gauss-seidel"] = "nsa/plane/gauss-seidel"
    assert {name: one.reference for name, one in rows.items()} == expected
    assert all(one.value > 0.0 for one in rows.values())
    assert rows[nsa.PERIOD].value == pytest.approx(10.0)
    for task in nsa.TASKS:
        assert rows[f"nsa/{task}/scipy/cost"].ratio == pytest.approx(1.0, abs=1e-3)
        assert rows[f"nsa/{task}/no-push/cost"].ratio > 1.0
    cold = rows["nsa/plane/100"]
    assert cold.ratio == pytest.approx(cold.value / 10.0)


def test_a_failure_to_plan_is_reported(monkeypatch):
    monkeypatch.setattr(sys, "executable", shutil.which("false") or pytest.skip("no `false`"))
    with pytest.raises(ValueError, match=r"eval\.benchmarks\.nsa 0\.0 1` failed"):
        nsa.rows(QUICK)


@pytest.mark.parametrize("name", nsa.TASKS)
def test_beliefs_are_the_tasks_own_and_there_is_time_for_every_plan(name):
    config = nsa.first_scenario(nsa.TASKS[name])
    for n in nsa.HORIZONS:
        problems = nsa.at_the_start(name, n)
        assert problems.guesses.shape[:2] == (nsa.LANES, n)
        assert not problems.guesses.any()
        assert problems.T == pytest.approx(max(config.t_f, n * config.dt))
        assert len(np.unique(problems.X, axis=0)) == nsa.LANES
        assert all(problems.settings[key][0] == getattr(config, key) for key in ("s_x", "s_v"))
    lanes = Lanes(load_task(nsa.TASKS[name]), config, nsa.LANES)
    lanes.reset(range(nsa.LANES))
    believed, true = lanes.records["rhat_TV_N"], lanes.records["r_TV_N"]
    assert np.array_equal(problems.X, believed)
    error = np.linalg.norm(believed, axis=1) - np.linalg.norm(true, axis=1)
    assert error.min() < -2.0
    assert error.max() > 2.0


@pytest.mark.parametrize("name", nsa.TASKS)
def test_the_last_plan_saves_evaluations(name):
    warm = nsa.en_route(name)
    cold = warm.cold()
    for problems in (warm, cold):
        assert nsa.compiled(problems)() == nsa.LANES * nsa.MOMENTS == len(problems.T)
    assert warm.guesses.any()
    assert not cold.guesses.any()
    assert warm.tries.mean() < 0.5 * cold.tries.mean()
    dt = warm.settings["dt"][0]
    expected = np.repeat(warm.guesses.shape[1] - np.arange(1, nsa.MOMENTS + 1), nsa.LANES)
    assert np.array_equal(np.round(warm.T / dt), expected)


@pytest.mark.parametrize("name", nsa.TASKS)
def test_scipy_and_the_sweeps_plan_for_the_same_problems(starts, name):
    exact = starts[name]
    theirs, swept, none = (exact.cold() for _ in range(3))
    nsa.with_scipy(theirs)()
    nsa.compiled(swept, sweeps=True)()
    stake, best = nsa.predicted(exact)
    assert (np.abs(nsa.predicted(theirs)[1] - best) < 1e-6 * stake).all()
    assert (nsa.predicted(swept)[1] > best - 1e-6 * stake).all()
    blind, idle = nsa.predicted(none)
    assert np.array_equal(blind, stake)
    assert (best < idle).all()
    assert (idle < blind).all()
    for problems in (exact, theirs, swept):
        assert problems.plans.any(axis=(1, 2)).all()
        assert (problems.tries > 1).all()


def test_one_problem_alone_is_solved_as_among_the_others(starts):
    exact = starts["space"]
    alone = exact.only(3)
    assert nsa.compiled(alone)() == 1
    assert np.array_equal(alone.plans[0], exact.plans[3])
    assert alone.tries[0] == exact.tries[3]
    assert nsa.evaluations(exact)() == nsa.REPEATS * nsa.LANES


def test_plans_that_are_no_minimum_are_not_compared():
    nsa.check("nsa/plane/scipy", np.array([-1.0, 0.9e-6]))
    for share in (2e-6, np.nan):
        with pytest.raises(ValueError, match=rf"nsa/plane/scipy: .* differ by {share:.3g} of"):
            nsa.check("nsa/plane/scipy", np.array([0.0, share]))


def test_an_exponent_is_the_slope_of_log_time_over_log_n():
    rates = [[1e6 / n, 3e6 / n**1.5] for n in nsa.HORIZONS]
    assert nsa.exponents(rates) == pytest.approx([1.0, 1.5])
