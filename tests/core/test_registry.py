"""Discovery: being there is being registered."""

import importlib
import pkgutil

import gymnasium as gym
import pytest

import visenvs.envs
import visenvs.guidance
from visenvs.core import registry
from visenvs.core.config import field_types

ENVIRONMENTS = registry.environment_files()


def modules(package):
    return [
        importlib.import_module(f"{package.__name__}.{info.name}")
        for info in pkgutil.iter_modules(package.__path__)
    ]


def test_every_file_in_envs_is_an_environment():
    names = {
        module.__name__
        for module in modules(visenvs.envs)
        if not module.__name__.split(".")[-1].startswith("_")
    }
    assert set(ENVIRONMENTS.values()) == names
    assert "visenvs/Rendezvous-v0" in ENVIRONMENTS


@pytest.mark.parametrize("env_id", ENVIRONMENTS)
def test_the_card_carries_the_id_of_its_file_and_is_known_to_gymnasium(env_id):
    task = registry.load_task(env_id)
    assert task.id == env_id
    assert task is registry.load_task(env_id)
    assert gym.spec(env_id).kwargs == {"env_id": env_id}


@pytest.mark.parametrize("env_id", ENVIRONMENTS)
def test_costs_metrics_and_row_are_fields_of_the_lane(env_id):
    task = registry.load_task(env_id)
    lane = set(task.lane.names)
    assert lane.issuperset(task.costs)
    assert lane.issuperset(task.metrics)
    assert lane.issuperset(task.observation.names)
    assert len({type(config) for config in task.scenarios.values()}) == 1


def test_every_law_is_found_under_a_name_of_its_own():
    cards = [law for module in modules(visenvs.guidance) for law in getattr(module, "LAWS", ())]
    assert registry.laws() == {law.name: law for law in cards}
    assert len(registry.laws()) == len(cards)
    assert {"pn", "lq", "osa"} <= set(registry.laws())


def test_laws_of_the_rendezvous_read_what_it_gives():
    task = registry.load_task("visenvs/Rendezvous-v0")
    for name in ("pn", "lq", "osa"):
        law = registry.laws()[name]
        assert set(law.needs) <= set(task.observation.names)
        assert set(law.settings) <= set(field_types(type(task.scenarios["random"])))


def test_unknown_environments_name_the_nearest():
    with pytest.raises(
        ValueError,
        match=r"unknown environment 'visenvs/Rendezvos-v0'; did you mean 'visenvs/Rendezvous-v0'",
    ):
        registry.load_task("visenvs/Rendezvos-v0")


def test_a_file_without_an_id_is_an_error(tmp_path, monkeypatch):
    (tmp_path / "envs").mkdir()
    (tmp_path / "envs" / "_private.py").write_text("")
    (tmp_path / "envs" / "forgotten.py").write_text("TASK = None\n")
    monkeypatch.setattr(registry, "PACKAGE", tmp_path)
    with pytest.raises(ImportError, match=r"forgotten.py has no line `ENV_ID"):
        registry.environment_files.__wrapped__()
