"""Search for hyperparameters: it ends, goes on, and shares the work."""

import json
from dataclasses import replace

import optuna
import pytest

from train import build, sweep
from train.presets import DEFAULTS, Preset
from train.sweep import Options

pytestmark = pytest.mark.filterwarnings("ignore")  # Optuna's and tqdm's experimental parts


def options(tmp_path, **changes):
    asked = Options(out=tmp_path / "sweep", trials=2, seeds=2, steps=64)
    return replace(asked, **changes)


@pytest.fixture
def costs(monkeypatch):
    """Training replaced by a valley, so that only the search is tested."""
    made = []

    def train_once(asked, preset):
        made.append((asked.out.name, preset))
        return abs(preset.model["learning_rate"] - 1e-3) + asked.seed

    monkeypatch.setattr(sweep, "train_once", train_once)
    return made


def test_every_trial_is_trained_with_every_seed_and_goes_on(tmp_path, costs):
    sweep.sweep(options(tmp_path))
    assert [name for name, _ in costs] == [
        f"trial-{trial}-seed-{seed}" for trial in (0, 1) for seed in (0, 1)
    ]
    best = json.loads((tmp_path / "sweep" / "best.json").read_text())
    assert best["trials"] == 2 and best["value"] == pytest.approx(
        0.5 + min(abs(preset.model["learning_rate"] - 1e-3) for _, preset in costs)
    )
    sweep.sweep(options(tmp_path, trials=3))
    assert len(costs) == 6  # only the third is new


def test_trials_that_a_crash_cut_off_do_not_count(tmp_path, costs):
    sweep.sweep(options(tmp_path))
    sweep.open_study(options(tmp_path)).ask()
    study = sweep.open_study(options(tmp_path))
    states = [trial.state for trial in study.get_trials()]
    assert states.count(optuna.trial.TrialState.FAIL) == 1 and sweep.finished(study) == 2


@pytest.mark.parametrize("algo", DEFAULTS)
def test_suggestions_are_presets(algo, tmp_path):
    trial = optuna.create_study().ask()
    preset = sweep.suggested(trial, options(tmp_path, algo=algo, residual="lq"))
    assert isinstance(preset, Preset) and 0.05 <= preset.residual_scale <= 0.6
    if "n_steps" in preset.model:
        assert preset.lanes * preset.model["n_steps"] % preset.model["batch_size"] == 0


def test_a_real_trial_trains(tmp_path, monkeypatch):
    monkeypatch.setattr(build, "VALIDATION_SEEDS", range(90_000, 90_006))
    quick = DEFAULTS["ppo"].model | {"n_steps": 8, "batch_size": 32, "n_epochs": 1}
    asked = sweep.training(options(tmp_path), 0, 1)
    cost = sweep.train_once(replace(asked, lanes=8), Preset(8, quick, {"net_arch": [8]}))
    assert cost > 0 and (asked.out / "card.json").exists()


@pytest.mark.parametrize("changes", [{"trials": 0}, {"seeds": 0}, {"steps": 0}])
def test_numbers_that_make_no_sense_are_refused(tmp_path, changes):
    with pytest.raises(ValueError, match="must be at least 1"):
        sweep.sweep(options(tmp_path, **changes))


def test_a_database_that_cannot_be_opened_is_one_line(tmp_path):
    with pytest.raises(ValueError, match="cannot open the study at nonsense"):
        sweep.sweep(options(tmp_path, storage="nonsense://x"))
