"""Policies by name, by file and by module:factory; who can fly where, and what they decide on."""

from __future__ import annotations

import json
import sys

import numpy as np
import pytest
import torch
from gymnasium import Env
from stable_baselines3 import PPO

from agents.card import digest
from agents.classical import LawPolicy, RandomPolicy, ZeroPolicy
from agents.policy import NotApplicable
from agents.registry import load, load_law, names, shipped
from visenvs.core.config import override
from visenvs.core.lanes import Lanes
from visenvs.core.layout import Choices
from visenvs.core.registry import environment_files, laws, load_task

TASK = load_task("visenvs/Rendezvous-v0")
CONFIG = TASK.scenarios["random"]
TRACKING = load_task("visenvs/Tracking2D-v0")
BEARINGS = load_task("visenvs/BearingsOnly-v0")


@pytest.fixture(scope="module", autouse=True)
def one_thread():
    """Networks of this size are faster without threads."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)


def default(task):
    return next(iter(task.scenarios.values()))


@pytest.mark.parametrize("env", environment_files())
def test_every_name_that_is_shown_loads_and_decides(env):
    task = load_task(env)
    assert len(set(names(task))) == len(names(task))
    assert {"zero", "random", task.reference, *shipped(env)} <= set(names(task))
    for name in names(task):
        entry = load(name, task, default(task))
        assert entry.name == name and entry.summary
        lanes = Lanes(task, entry.config, 3)
        lanes.reset(range(3))
        actions, _ = entry.policy.predict(lanes.rows)
        lanes.step(actions)  # within its box
        assert actions.shape == (3, *task.action.space.shape)
        assert actions.dtype == np.float32 or isinstance(task.action, Choices)


@pytest.mark.parametrize("env", environment_files())
def test_laws_that_are_not_shown_say_what_they_lack(env):
    task = load_task(env)
    for name in set(laws()) - set(names(task)):
        with pytest.raises(NotApplicable, match=rf"^{name} needs .*, which {env} does not give$"):
            load(name, task, default(task))


@pytest.mark.parametrize(
    "law, task, lack",
    [
        ("lq", BEARINGS, "rhat_TV_N, v_V_N, s_x, s_v, actions in units of a_max"),
        ("d-optimal", TASK, "range_hat, vhat_T_L, chol_r, chol_v, v_V_L, turn_max, sigma_bearing"),
        ("straight", TRACKING, "turn_max, actions in units of turn_max"),
    ],
)
def test_what_is_lacking_is_named(law, task, lack):
    with pytest.raises(NotApplicable, match=f"{law} needs {lack}"):
        load(law, task, default(task))


def test_a_law_cannot_fly_on_raw_measurements():
    assert load("lq", TRACKING, TRACKING.scenarios["random"]).information == "belief"
    with pytest.raises(NotApplicable, match="lq needs rhat_TV_N, which visenvs/Tracking2D-v0 does"):
        load("lq", TRACKING, TRACKING.scenarios["raw"])


def test_kinds_and_information_sets():
    found = {name: load(name, TRACKING, default(TRACKING)) for name in names(TRACKING)}
    kinds = {name: (entry.kind, entry.information) for name, entry in found.items()}
    assert kinds["zero"] == kinds["random"] == ("blind", "none")
    assert kinds["lq"] == kinds["nsa"] == ("law", "belief")
    assert kinds["ppo-lq"] == ("residual", "belief")
    assert kinds["recurrent-ppo"] == ("learned", "raw")
    assert found["ppo-lq"].config == default(TRACKING)
    assert found["recurrent-ppo"].config == override(default(TRACKING), {"observation": "raw"})
    assert isinstance(found["zero"].policy, ZeroPolicy)
    assert isinstance(found["random"].policy, RandomPolicy)
    assert isinstance(found["lq"].policy, LawPolicy)


def test_a_model_reads_its_own_rows_whatever_the_scenario_shows():
    raw = TRACKING.scenarios["raw"]
    entry = load("ppo-lq", TRACKING, raw)
    assert (entry.information, entry.config.observation) == ("belief", "belief")
    lanes = Lanes(TRACKING, entry.config, 2)
    lanes.reset([1, 2])
    entry.policy.predict(lanes.rows)


@pytest.mark.parametrize("name", ["nsa-7", "ahead-30", "ahead-2.5", "nsa-3-gs"])
def test_members_of_a_family_load_by_name(name):
    entry = load(name, TRACKING, default(TRACKING))
    assert (entry.name, entry.kind) == (name, "law")
    assert name not in names(TRACKING)


@pytest.mark.parametrize(
    "name, words",
    [
        ("oas", "unknown policy 'oas'; did you mean 'osa'"),
        ("ppolq", "unknown policy 'ppolq'; did you mean 'ppo-lq'"),
        ("xyzzy", r"unknown policy 'xyzzy'\. Known: zero, random, .*lq.*ppo-lq; or the path"),
        ("nsa--1", "unknown policy 'nsa--1'; did you mean 'nsa'"),
        ("ahead-101", "at most 100 percent of what is left; write ahead-100"),
        ("recurrent-ppo", "unknown policy 'recurrent-ppo'"),  # ships for another environment
    ],
)
def test_an_unknown_name_is_told_with_what_there_is(name, words):
    with pytest.raises(ValueError, match=words):
        load(name, TASK, CONFIG)


@pytest.mark.parametrize("name", ["zero", "ppo-lq", "mod:factory", "lqq"])
def test_only_laws_go_under_a_correction(name):
    assert load_law("nsa-5", TASK, CONFIG).law.name == "nsa-5"
    with pytest.raises(ValueError, match=f"unknown law {name!r}.* Known: .*lq"):
        load_law(name, TASK, CONFIG)


# module:factory


MODULE = """
import numpy as np

class Half:
    def __init__(self, task):
        self.size = task.action.size

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        return np.full((len(observation), self.size), 0.5, np.float32), state

def half(task, config):
    assert config.dt == 0.1
    return Half(task)
"""


@pytest.fixture
def module(tmp_path, monkeypatch):
    """Writes a module of the user's own and forgets it afterwards."""
    monkeypatch.syspath_prepend(tmp_path)
    before = set(sys.modules)

    def write(text, name="own_policy_file"):
        (tmp_path / f"{name}.py").write_text(text)
        return name

    yield write
    for name in set(sys.modules) - before:
        if name.startswith("own_policy"):
            del sys.modules[name]


def test_a_factory_gets_the_task_and_the_configuration(module):
    entry = load(f"{module(MODULE)}:half", TRACKING, TRACKING.scenarios["raw"])
    assert (entry.kind, entry.information) == ("custom", "raw")
    actions, _ = entry.policy.predict(np.zeros((4, 7), np.float32))
    assert actions.tolist() == [[0.5, 0.5]] * 4


@pytest.mark.parametrize(
    "text, error",
    [
        ("import no_such_package", "ModuleNotFoundError: No module named 'no_such_package'"),
        ("def half(:", "SyntaxError"),
        ("1 / 0", "ZeroDivisionError: division by zero"),
        ("", "AttributeError: module 'own_policy_file' has no attribute 'half'"),
    ],
)
def test_a_module_that_fails_is_told(module, text, error):
    spec = f"{module(text)}:half"
    words = rf"cannot import '{spec}' \({error}.*; write module:factory, factory\(task, config\)"
    with pytest.raises(ValueError, match=words):
        load(spec, TASK, CONFIG)


def test_a_factory_that_fails_is_told_and_one_that_declines_is_heard(module):
    text = (
        "from agents.policy import NotApplicable\n"
        "def clumsy(task, config): return config.no_such_thing\n"
        "def shy(task, config): raise NotApplicable('needs a map')\n"
    )
    name = module(text)
    with pytest.raises(ValueError, match=f"policy '{name}:clumsy' cannot be made: AttributeError"):
        load(f"{name}:clumsy", TASK, CONFIG)
    with pytest.raises(NotApplicable, match="needs a map"):
        load(f"{name}:shy", TASK, CONFIG)


@pytest.mark.parametrize("spec", ["no_such_module:make", ":make", ".near:make", "agents:"])
def test_a_factory_that_is_not_there_is_told(spec):
    with pytest.raises(ValueError, match=f"cannot import '{spec}'.*write module:factory"):
        load(spec, TASK, CONFIG)


# files


class Still(Env):
    observation_space, action_space = TASK.observation.space, TASK.action.space


@pytest.fixture(scope="module")
def zipped(tmp_path_factory):
    """A model without a card, as SB3 users have it."""
    path = tmp_path_factory.mktemp("users") / "mine.zip"
    settings = {"n_steps": 8, "batch_size": 8, "policy_kwargs": {"net_arch": [4]}, "seed": 1}
    PPO("MlpPolicy", Still(), device="cpu", **settings).save(path)
    return path


def test_a_zip_and_a_folder_are_called_by_their_names(zipped, tmp_path):
    entry = load(str(zipped), TASK, CONFIG)
    assert (entry.name, entry.kind, entry.summary) == ("mine", "learned", "user's own network")
    folder = tmp_path / "swift"
    folder.mkdir()
    (folder / "model.zip").write_bytes(zipped.read_bytes())
    rows = TASK.observation.space.sample()[None]
    for spec in (folder, folder / "model.zip"):
        other = load(str(spec), TASK, CONFIG)
        assert (other.name, other.kind) == ("swift", "learned")
        assert np.array_equal(other.policy.predict(rows)[0], entry.policy.predict(rows)[0])


def test_a_card_for_rows_that_the_environment_does_not_have_is_refused(zipped, tmp_path):
    path = tmp_path / "model.zip"
    path.write_bytes(zipped.read_bytes())
    card = {"information": "raw", "algo": "ppo", "residual": None, "steps": 5}
    (tmp_path / "card.json").write_text(json.dumps(card | {"sha256": digest(path)}))
    with pytest.raises(ValueError, match="RendezvousConfig has no setting 'observation'"):
        load(str(path), TASK, CONFIG)
