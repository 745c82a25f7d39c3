"""Training from start to end: files, interrupts, refusals, seeds, and the policy at the end."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest

from agents.card import digest
from agents.loading import load_network
from agents.registry import load
from eval.rollout import PUBLIC_SEEDS, rollout
from train import build, record, sb3
from train.build import build_lanes, build_model, scale_of
from train.callbacks import Keeper
from train.presets import DEFAULTS, PRESETS, Preset, preset_for
from train.sb3 import Options, train
from visenvs.core.cli import guarded, launch
from visenvs.core.registry import load_task

pytestmark = pytest.mark.filterwarnings("ignore::tqdm.TqdmExperimentalWarning")

ROOT = Path(__file__).resolve().parents[2]
ENV = "visenvs/Rendezvous-v0"
TASK = load_task(ENV)
CONFIG = TASK.scenarios["random"]
ON = {"n_steps": 64, "batch_size": 256, "n_epochs": 1, "gamma": 1.0, "learning_rate": 1e-3}
OFF = {"batch_size": 64, "learning_starts": 100, "learning_rate": 1e-3, "buffer_size": 2000}
NET = {"net_arch": [8]}
TINY = {
    "ppo": Preset(8, ON, NET | {"log_std_init": -1.5}, residual_scale=0.2, reward_floor=-3.0),
    "recurrent_ppo": Preset(8, ON, NET | {"lstm_hidden_size": 4}),
    "sac": Preset(8, OFF, NET),
    "td3": Preset(8, OFF, NET),
}


@pytest.fixture(autouse=True)
def tiny(monkeypatch):
    """Small networks, few lanes, and a validation of six episodes."""
    monkeypatch.setattr(sb3, "preset_for", lambda env, algo, pictures: TINY[algo])
    for module in (build, record):
        monkeypatch.setattr(module, "VALIDATION_SEEDS", range(90_000, 90_006))


def read(path):
    return json.loads(path.read_text(), parse_constant=pytest.fail)


def left(folder):
    """Names of the files and folders in a folder."""
    return {path.name for path in folder.iterdir()}


@pytest.fixture(scope="module")
def done(tmp_path_factory):
    """Folder of a finished run, a residual on LQ, and what it printed."""
    out = tmp_path_factory.mktemp("runs") / "deep" / "run"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sb3, "preset_for", lambda env, algo, pictures: TINY[algo])
        for module in (build, record):
            patch.setattr(module, "VALIDATION_SEEDS", range(90_000, 90_006))
        assert guarded(lambda: train(options(out, residual="lq", validate_every=1000))) == 0
    return out


def options(out, **changes):
    return Options(**({"out": out, "steps": 2048, "validate_every": 10_000} | changes))


def test_a_run_leaves_a_model_its_card_its_record_and_curves(done):
    assert left(done) == {"model.zip", "card.json", "run.json", "checkpoint.zip", "tb"}
    (events,) = (done / "tb").rglob("events.out.tfevents.*")
    assert b"validation/cost_mean" in events.read_bytes()


def test_the_record_tells_how_it_was_made(done):
    run = read(done / "run.json")
    assert (run["steps"], run["sessions"], run["finished"]) == (2048, 1, True)
    assert run["options"]["residual"] == "lq" and run["options"]["seed"] == 0
    assert (run["env"], run["scenario"], run["config"]["estimator"]) == (ENV, "random", "ekf")
    assert run["wall_seconds"] > 0.0 and run["cpu_seconds"] > 0.0
    assert run["frames_per_second"] == pytest.approx(2048 / run["wall_seconds"])
    assert {"commit", "date", "command", "versions"} <= set(run)


def test_the_card_tells_what_the_model_is_and_reached(done):
    card = read(done / "card.json")
    assert card["sha256"] == digest(done / "model.zip")
    assert card["residual"] == {"law": "lq", "scale": 0.2}
    assert (card["env"], card["scenario"], card["algo"]) == (ENV, "random", "ppo")
    assert card["seeds"] == {"training": [0, 89_999], "validation": [90_000, 90_005]}
    assert card["steps"] in (1024, 2048)
    assert read(done / "run.json")["best"] == {**card["reached"], "steps": card["steps"]}


def test_what_comes_out_loads_without_trust_and_flies_as_validated(done):
    entry = load(str(done), TASK, CONFIG)
    assert (entry.name, entry.kind) == ("run", "residual")
    costs = -rollout(entry.policy, TASK, CONFIG, range(90_000, 90_006)).returns
    reached = read(done / "card.json")["reached"]
    assert reached["episodes"] == 6
    assert reached["cost_mean"] == pytest.approx(costs.mean(), rel=1e-4)
    assert reached["cost_median"] == pytest.approx(np.median(costs), rel=1e-4)
    assert reached["cost_p95"] == pytest.approx(np.percentile(costs, 95), rel=1e-4)


@pytest.mark.parametrize("algo", ["recurrent_ppo", "sac", "td3"])
def test_every_algorithm_trains_and_its_model_flies_as_validated(algo, tmp_path, capsys):
    assert guarded(lambda: train(options(tmp_path / algo, algo=algo, steps=600))) == 0
    assert f"--policies lq,{tmp_path / algo / 'model.zip'}" in capsys.readouterr().out
    entry = load(str(tmp_path / algo), TASK, CONFIG)
    costs = -rollout(entry.policy, TASK, CONFIG, range(90_000, 90_006)).returns
    reached = read(tmp_path / algo / "card.json")["reached"]
    assert reached["cost_mean"] == pytest.approx(costs.mean(), rel=1e-4)
    assert (tmp_path / algo / "replay.pkl").exists() == (algo in ("sac", "td3"))


def test_training_changes_the_network(done, tmp_path):
    before = build_model(options(tmp_path), TINY["ppo"], lanes_of(tmp_path))
    after = load_network(done / "checkpoint.zip", TASK)
    old, new = before.policy.state_dict(), after.state_dict()
    assert any((old[name] != new[name]).any() for name in old)


# interrupts


@pytest.fixture
def interrupt(monkeypatch):
    """Presses Ctrl-C once, at a given step of the training."""
    at = []

    def on_step(self):
        if at and self.num_timesteps >= at[0]:
            at.clear()
            raise KeyboardInterrupt
        return True

    monkeypatch.setattr(Keeper, "_on_step", on_step)
    return at.append


@pytest.mark.parametrize("algo", ["ppo", "sac"])
def test_an_interrupted_run_goes_on_with_the_same_command(algo, interrupt, tmp_path, capsys):
    asked = options(tmp_path / "run", algo=algo, steps=1536, validate_every=512)
    interrupt(800)
    assert guarded(lambda: train(asked)) == 130
    line = capsys.readouterr().err.splitlines()[-1]
    assert line == "interrupted: 800 steps are kept; the same command goes on from there"
    run = read(asked.out / "run.json")
    assert (run["steps"], run["sessions"], run["finished"]) == (800, 1, False)
    files = {"model.zip", "card.json", "run.json", "checkpoint.zip", "tb"}
    files |= {"replay.pkl"} if algo == "sac" else set()
    assert left(asked.out) == files
    assert read(asked.out / "card.json")["steps"] == 512
    load(str(asked.out), TASK, CONFIG)
    kept = build_model(asked, TINY[algo], lanes_of(asked.out))
    assert kept.num_timesteps == 800
    if algo == "sac":
        assert kept.replay_buffer.pos == 800 // kept.n_envs - 1  # but for the step cut short

    assert guarded(lambda: train(asked)) == 0
    run = read(asked.out / "run.json")
    assert (run["sessions"], run["finished"]) == (2, True)
    assert 1536 <= run["steps"] < 1536 + 512
    assert left(asked.out) == files
    assert read(asked.out / "card.json")["sha256"] == digest(asked.out / "model.zip")


def test_the_best_of_an_earlier_session_stays(interrupt, tmp_path, monkeypatch):
    asked = options(tmp_path / "run", steps=1536, validate_every=512)
    costs = iter([5.0, 7.0, 6.0, 8.0])
    found = {"cost_median": 0.0, "cost_p95": 0.0, "success_rate": 0.0, "episodes": 6}
    monkeypatch.setattr("train.callbacks.validate", lambda *_: {**found, "cost_mean": next(costs)})
    interrupt(800)
    assert guarded(lambda: train(asked)) == 130
    best = digest(asked.out / "model.zip")
    assert guarded(lambda: train(asked)) == 0
    assert next(costs, None) is None
    assert digest(asked.out / "model.zip") == best
    assert digest(asked.out / "checkpoint.zip") != best
    card = read(asked.out / "card.json")
    assert (card["reached"]["cost_mean"], card["steps"]) == (5.0, 512)


def test_an_interrupt_before_anything_was_validated_leaves_no_model(interrupt, tmp_path):
    asked = options(tmp_path / "run")
    interrupt(8)
    assert guarded(lambda: train(asked)) == 130
    assert left(asked.out) == {"run.json", "checkpoint.zip", "tb"}
    assert read(asked.out / "run.json")["best"] is None


def test_an_interrupt_of_the_last_validation_only_repeats_that(tmp_path, monkeypatch):
    asked = options(tmp_path / "run", steps=600)  # rollouts of 512: it stops at 1024

    def keep(self):
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(Keeper, "keep", keep)
        assert guarded(lambda: train(asked)) == 130
    assert guarded(lambda: train(asked)) == 0
    run = read(asked.out / "run.json")
    assert (run["steps"], run["sessions"], run["finished"]) == (1024, 2, True)


def test_a_run_that_was_killed_goes_on_from_its_checkpoint(interrupt, tmp_path, monkeypatch):
    asked = options(tmp_path / "run", steps=1536, validate_every=512)
    interrupt(800)
    written = sb3.write_json
    with monkeypatch.context() as patch:  # a kill leaves what was on disk before
        patch.setattr(sb3, "checkpoint", lambda *_: None)
        patch.setattr(sb3, "write_json", lambda to, run: run.get("sessions") or written(to, run))
        patch.setattr(sb3, "card", lambda *_: {"sessions": 1})
        assert guarded(lambda: train(asked)) == 130
    assert read(asked.out / "run.json")["sessions"] == 0
    assert guarded(lambda: train(asked)) == 0
    assert read(asked.out / "run.json")["steps"] == 1536  # 512 and two rollouts more


# refusals


def one_line(asked, capsys):
    """Exit code and the one line that a refused command leaves."""
    code = guarded(lambda: train(asked))
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.count("\n") == 1 and "Traceback" not in captured.err
    return code, captured.err


def test_a_finished_run_is_not_overwritten(done, capsys):
    before = {path: path.read_bytes() for path in done.iterdir() if path.is_file()}
    code, line = one_line(options(done, residual="lq", validate_every=1000), capsys)
    assert code == 1
    assert (
        line == f"error: the training in {done} is finished; write --out {done}-2 for a new one\n"
    )
    assert before == {path: path.read_bytes() for path in done.iterdir() if path.is_file()}


@pytest.mark.parametrize(
    "changes, words",
    [
        ({"seed": 1}, "was started with other seed;"),
        ({"residual": None, "steps": 4096}, "was started with other steps, residual;"),
        ({"algo": "sac"}, "was started with other algo;"),
    ],
)
def test_other_options_do_not_go_on_with_a_run(done, changes, words, capsys):
    asked = options(done, **({"residual": "lq", "validate_every": 1000} | changes))
    code, line = one_line(asked, capsys)
    assert code == 1
    assert words in line and f"write --out {done}-2" in line


@pytest.mark.parametrize(
    "wrong, words",
    [
        ({"env": "visenvs/Rendevous-v0"}, "unknown environment 'visenvs/Rendevous-v0'; did you"),
        ({"scenario": "thesiss"}, "unknown scenario 'thesiss'; did you mean 'thesis'?"),
        ({"estimator": "oracle"}, "'oracle'"),
        ({"observation": "cones"}, "'observation'"),
        ({"residual": "oas"}, "unknown law 'oas'; did you mean 'osa'?"),
        ({"residual": "straight"}, "straight needs turn_max"),
        ({"residual": "lq", "residual_scale": 0.0}, "must lie in (0, 1], got 0.0"),
        ({"residual": "lq", "residual_scale": 1.5}, "must lie in (0, 1], got 1.5"),
        (
            {"residual_scale": 0.5},
            "--residual-scale 0.5 says how far a law is corrected; write --r",
        ),
        ({"steps": 0}, "steps, lanes and validate-every must be at least 1, got 0"),
        ({"steps": -5}, "must be at least 1, got -5"),
        ({"validate_every": 0}, "must be at least 1"),
        ({"lanes": 0}, "must be at least 1"),
        ({"lanes": 90_000}, "there are 90000 training seeds, got 90000 lanes"),
        ({"seed": -1}, "the seed must not be negative, got -1"),
    ],
)
def test_a_wrong_option_is_one_line_and_leaves_nothing(wrong, words, tmp_path, capsys):
    code, line = one_line(options(tmp_path / "run", **wrong), capsys)
    assert code == 1
    assert words in line
    assert left(tmp_path) == set()


@pytest.mark.parametrize("place", ["file", "file/run"])
def test_a_folder_that_cannot_be_made_is_one_line(place, tmp_path, capsys):
    (tmp_path / "file").write_text("mine")
    code, line = one_line(options(tmp_path / place), capsys)
    assert code == 1
    assert str(tmp_path / place) in line
    assert (tmp_path / "file").read_text() == "mine"


def test_a_broken_record_is_one_line(tmp_path, capsys):
    (tmp_path / "run.json").write_text('{"steps": 1')
    code, line = one_line(options(tmp_path), capsys)
    assert code == 1
    assert f"{tmp_path / 'run.json'} is not JSON" in line


def test_the_command_line_itself(monkeypatch, capsys):
    command = [sys.executable, "-m", "train.sb3", "--out", "nowhere", "--steps", "0"]
    run = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=120)
    assert run.returncode == 1
    assert run.stderr.startswith("error: steps, lanes and validate-every must be at least 1, got 0")
    assert run.stderr.count("\n") == 1
    monkeypatch.setattr(sys, "argv", ["train.sb3", "--help"])
    with pytest.raises(SystemExit) as left_with:
        launch("train.sb3", Options, train)
    assert left_with.value.code == 0
    told = capsys.readouterr().out
    assert all(f"--{field.name.replace('_', '-')}" in told for field in fields(Options))


# seeds and presets


def lanes_of(out, session=0, **changes):
    lanes, _ = build_lanes(options(out, **changes), TINY["ppo"], TASK, CONFIG, session)
    return lanes


@pytest.mark.parametrize("lanes", [1, 7, 256, 4096, 89_999])
def test_training_never_sees_a_seed_of_validation_or_of_the_public(lanes, tmp_path, monkeypatch):
    seen = []
    monkeypatch.setattr(sb3, "LaneVecEnv", lambda task, config, seeds, *_: seen.append(seeds))
    for seed in (0, 1, 350, 351, 352, 99_999, 2**40):
        for session in (0, 1, 5, 1000):
            asked = options(tmp_path, seed=seed, lanes=lanes)
            build_lanes(asked, TINY["ppo"], TASK, CONFIG, session)
    for training, validation in zip(seen[::2], seen[1::2], strict=True):
        assert len(training) == lanes
        assert min(training) >= 0 and max(training) < 90_000
        assert validation == range(90_000, 90_006)
    assert PUBLIC_SEEDS[0] == 100_000


def test_lane_i_flies_its_own_seed_and_another_one_after_an_interrupt(tmp_path):
    lanes = lanes_of(tmp_path, seed=3, lanes=5)
    lanes.reset()
    assert lanes.lanes.records["seed"].tolist() == [15, 16, 17, 18, 19]
    later = lanes_of(tmp_path, session=1, seed=3, lanes=5)
    later.reset()
    assert not set(later.lanes.records["seed"]) & set(lanes.lanes.records["seed"])


def test_training_is_shaped_and_validation_is_not(tmp_path):
    lanes, validation = build_lanes(options(tmp_path), TINY["ppo"], TASK, CONFIG, 0)
    still = np.zeros((8, 3), np.float32)
    lanes.reset()
    validation.reset()
    assert np.abs(lanes.step(still)[1]).max() > 1e-6
    assert (validation.step(still[:6])[1] == 0.0).all()  # no effort and not there yet: no cost


def test_the_scale_of_a_residual_is_the_presets_unless_told(tmp_path):
    assert scale_of(options(tmp_path), TINY["ppo"]) == 0.2
    assert scale_of(options(tmp_path, residual_scale=0.7), TINY["ppo"]) == 0.7


@pytest.mark.parametrize("algo", DEFAULTS)
def test_environments_without_a_preset_have_defaults(algo):
    assert preset_for("visenvs/Cart-v0", algo) is DEFAULTS[algo]


@pytest.mark.parametrize("env, algo", [*PRESETS, *((ENV, algo) for algo in TINY)])
def test_every_preset_is_one_that_sb3_takes(env, algo, tmp_path):
    preset = replace(preset_for(env, algo), lanes=8)
    task = load_task(env)
    config = next(iter(task.scenarios.values()))
    asked = options(tmp_path, env=env, algo=algo)
    lanes, _ = build_lanes(asked, preset, task, config, 0)
    if "n_steps" in preset.model:  # SB3 warns of minibatches that rollouts do not fill
        count = preset_for(env, algo).lanes * preset.model["n_steps"]
        assert count >= preset.model["batch_size"]
        preset = replace(preset, model=preset.model | {"batch_size": preset.model["n_steps"]})
    model = build_model(asked, preset, lanes)
    assert model.learning_rate(1.0) == preset.model["learning_rate"]
    assert model.learning_rate(0.0) == pytest.approx(preset.model["learning_rate"] / 20)
