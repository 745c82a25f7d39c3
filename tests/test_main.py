"""`python -m visenvs`, as a stranger types it."""

import subprocess
import sys
from importlib.metadata import PackageNotFoundError
from pathlib import Path

import pytest

from visenvs import __main__, doctor
from visenvs.core.registry import environment_files, load_task

ROOT = Path(__file__).resolve().parents[1]


def typed(*words, monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["visenvs", *words])
    with pytest.raises(SystemExit) as end:
        __main__.main()
    out, err = capsys.readouterr()
    return end.value.code, out, err


@pytest.fixture
def visenvs(monkeypatch, capsys):
    return lambda *words: typed(*words, monkeypatch=monkeypatch, capsys=capsys)


def test_list_names_every_environment(visenvs):
    code, out, _ = visenvs("list")
    assert code == 0
    for env_id in environment_files():
        assert env_id in out and load_task(env_id).summary in out
    default = load_task("visenvs/Mapping-v0").scenarios["town"].estimator
    assert f"estimators: {default}, " in out.partition("Mapping-v0")[2]


@pytest.mark.parametrize("policy", ["ppo", "random"])
def test_what_is_no_law_is_told_those_that_can_fly_and_where_others_do(policy, visenvs):
    code, _, err = visenvs("demo", "Mapping-v0", "--policy", policy)
    assert code == 1 and err.count("\n") == 1
    listed = err.partition("can fly visenvs/Mapping-v0: ")[2].partition(";")[0].split(", ")
    assert {"circle", "information-gain"} <= set(listed) and not {"pn", "dgg"} & set(listed)
    assert f"`python -m eval.film --env visenvs/Mapping-v0 --policy {policy} --out" in err


@pytest.mark.parametrize("env_id", environment_files())
def test_the_default_estimator_is_listed_first(env_id):
    config = next(iter(load_task(env_id).scenarios.values()))
    listed = __main__.default_first(config)
    assert not listed or listed[0] == config.estimator


@pytest.mark.parametrize("env_id", environment_files())
def test_info_tells_rows_actions_costs_and_scenarios(env_id, visenvs):
    code, out, _ = visenvs("info", env_id)
    task = load_task(env_id)
    assert code == 0
    names = [*task.observation.names, *task.metrics, *task.scenarios, *task.action.names]
    assert all(name in out for name in names)


def test_demo_flies_and_writes_a_video(visenvs, tmp_path):
    words = ("demo", "Tracking2D-v0", "--policy", "pn", "--scenario", "random", "--seed", "3")
    code, out, err = visenvs(*words, "--video", str(tmp_path / "flight.gif"))
    assert code == 0, err
    assert "seed 3: " in out and "total_cost = " in out
    assert (tmp_path / "flight.gif").read_bytes().startswith(b"GIF8")


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (("info", "Rendezvou-v0"), "did you mean 'visenvs/Rendezvous-v0'"),
        (("demo", "Rendezvous-v0", "--policy", "osaa"), "did you mean 'osa'"),
        (("demo", "Rendezvous-v0", "--policy", "straight"), "straight needs"),
        (("demo", "Rendezvous-v0", "--scenario", "thesi"), "did you mean 'thesis'"),
        (("demo", "Rendezvous-v0", "--seed", "-1"), "expected 1 integer seeds"),
        (("demo", "Rendezvous-v0", "--video", "a.avi"), ".gif, .mp4, .png"),
        (("demo", "Rendezvous-v0", "--video", "no/such/folder.gif"), "no folder"),
    ],
)
def test_a_mistake_is_one_line(words, told, visenvs):
    code, _, err = visenvs(*words)
    assert code == 1
    assert told in err and err.count("\n") == 1


def test_the_doctor_finds_this_installation_well(visenvs):
    code, out, err = visenvs("doctor")
    assert code == 0, err
    assert "BAD" not in out and "ok  step: visenvs/Rendezvous-v0" in out


def test_the_doctor_sees_two_opencvs_and_what_is_missing(monkeypatch):
    class Found:
        def __init__(self, name):
            self.name = name

    both = [Found("opencv-python"), Found("opencv-python-headless")]
    monkeypatch.setattr(doctor, "distributions", lambda: both)
    clash = doctor.opencv()
    assert not clash.ok and "pip uninstall -y opencv-python &&" in clash.text

    def missing(name):
        raise PackageNotFoundError(name)

    monkeypatch.setattr(doctor, "version", missing)
    found = {finding.name: finding for finding in doctor.packages()}
    assert not found["numba"].ok and "pip install numba" in found["numba"].text
    assert found["torch"].ok and found["torch"].text == "not installed"


def test_the_doctor_sees_a_cache_that_cannot_be_written(monkeypatch):
    monkeypatch.setattr(doctor.os, "access", lambda *_: False)
    assert not doctor.cache().ok


def test_a_check_that_fails_is_a_finding(monkeypatch):
    def broken():
        raise RuntimeError("no compiler")

    monkeypatch.setattr(doctor, "step", broken)
    (step,) = [finding for finding in doctor.examine() if finding.name == "step"]
    assert not step.ok and "no compiler" in step.text


def test_the_command_itself():
    done = subprocess.run(
        [sys.executable, "-m", "visenvs", "list"], cwd=ROOT, capture_output=True, text=True
    )
    assert done.returncode == 0 and "visenvs/Rendezvous-v0" in done.stdout
