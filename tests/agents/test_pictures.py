"""Policies that see pictures: trained in the same command, loaded as plainly as the others."""

import json
import shutil
from dataclasses import replace

import numpy as np
import pytest
from gymnasium import Env
from stable_baselines3 import PPO

from agents.loading import load_network
from agents.registry import load
from eval.rollout import PUBLIC_SEEDS, rollout
from train import sb3
from train.presets import PICTURES, PRESETS, Tutoring, preset_for
from visenvs.core.config import override
from visenvs.core.lanes import Lanes
from visenvs.core.outcome import SUCCESS
from visenvs.core.registry import load_task

pytestmark = pytest.mark.filterwarnings("ignore::tqdm.TqdmExperimentalWarning")

ID = "visenvs/Avoidance-v0"
TASK = load_task(ID)
CONFIG = TASK.scenarios["random"]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """One round of tutoring and one of PPO, a few hundred pictures each."""
    out = tmp_path_factory.mktemp("pixels")
    preset = preset_for(ID, "ppo", pictures=True)
    short = {"n_steps": 10, "batch_size": 20, "n_epochs": 1}
    preset = replace(
        preset,
        lanes=4,
        validation=2,
        model=preset.model | short,
        tutoring=Tutoring(10, 20, 2, draws=60, handover=2),
        settings=preset.settings | {"dt": 0.5},
    )
    sb3.train(
        sb3.Options(out=out, env=ID, observation="pixels", steps=160, tutor=3, seed=1), preset
    )
    return out


def test_the_card_says_what_it_sees_and_how_it_learnt(folder):
    card = json.loads((folder / "card.json").read_text())
    width = PICTURES[ID, "ppo"].pictures
    assert (card["information"], card["policy"]["pictures"]) == ("pixels", width)
    assert card["curve"][0][0] == 0
    assert (folder / "model.zip").stat().st_size < 2e6


def test_it_flies_as_its_network_says_and_trusts_nobody(folder):
    entry = load(str(folder), TASK, CONFIG)
    assert (entry.information, entry.config.observation) == ("pixels", "pixels")
    lanes = Lanes(TASK, entry.config, 2)
    lanes.reset([5, 6])
    actions, state = entry.policy.predict(lanes.rows)
    trusted = load_network(folder / "model.zip", lanes.task, trust=True)
    again, _ = trusted.predict(lanes.rows, deterministic=True)
    assert state is None
    assert np.array_equal(actions, np.clip(again, -1.0, 1.0))
    lanes.step(actions)


def test_pictures_of_another_size_are_refused(folder):
    other = TASK.under(override(CONFIG, {"observation": "pixels", "frame": 64}))
    with pytest.raises(ValueError, match=r"the weights do not fit ppo on visenvs/Avoidance-v0"):
        load_network(folder / "model.zip", other)


@pytest.mark.parametrize("trust", [False, True])
def test_pictures_without_a_card_are_told_which_setting_fits(folder, trust, tmp_path):
    path = shutil.copy(folder / "model.zip", tmp_path)
    with pytest.raises(
        ValueError, match=r'--observation pixels`.* Python with observation="pixels'
    ):
        load(str(path), TASK, CONFIG, trust)
    entry = load(str(path), TASK, override(CONFIG, {"observation": "pixels"}), trust)
    assert entry.information == "pixels"


def test_a_network_for_rows_is_told_which_setting_fits(tmp_path):
    views = {name: TASK.under(override(CONFIG, {"observation": name})) for name in TASK.views}
    told, cones = views["told"], views["cones"]
    env = Env()
    env.observation_space, env.action_space = told.space, told.action.space
    PPO("MlpPolicy", env, n_steps=8, batch_size=8, device="cpu").save(tmp_path / "model.zip")
    pixels = TASK.under(override(CONFIG, {"observation": "pixels"}))
    for other in (cones, pixels):
        with pytest.raises(ValueError, match=r"train.sb3 --env .* --observation told`"):
            load_network(tmp_path / "model.zip", other)


def test_presets_of_pictures_and_of_rows_differ():
    assert preset_for(ID, "ppo", pictures=True) is PICTURES[ID, "ppo"]
    assert preset_for(ID, "ppo") is PRESETS[ID, "ppo"]


def test_what_ships_avoids_by_pixels_alone():
    """Most flights succeed, where doing nothing and a network that has learnt nothing never do."""
    coarse = override(CONFIG, {"dt": 0.2, "estimator": "truth"})
    costs = {}
    for name in ("ppo-pixels", "zero"):
        entry = load(name, TASK, coarse)
        flown = rollout(entry.policy, TASK, entry.config, PUBLIC_SEEDS[:40])
        costs[name] = -flown.returns
        wins = np.mean(flown.records["outcome"] == SUCCESS)
        assert wins >= 0.9 if name == "ppo-pixels" else wins == 0.0
    assert np.median(costs["ppo-pixels"]) < 0.02 * np.median(costs["zero"])
