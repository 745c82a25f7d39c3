"""The search for gains: its least point, its pattern, its reach, and what it writes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from agents.card import read_card
from agents.registry import load
from agents.residual import Reading, Residual
from train import search
from train.presets import Preset
from train.vec_env import LaneVecEnv
from visenvs.core.cli import guarded
from visenvs.core.config import override
from visenvs.core.lanes import Task
from visenvs.core.registry import load_task

TASK = load_task("visenvs/Rendezvous-v0")
CONFIG = TASK.scenarios["random"]
BRIEF = override(CONFIG, {"t_f": 1.0})
READS = ("rhat_TV_N", "v_V_N")
TINY = Preset(8, {}, residual_scale=0.2, reads=READS, validation=6)


@pytest.fixture(autouse=True)
def one_thread():
    before = torch.get_num_threads()
    yield
    torch.set_num_threads(before)


def bowl(size, seed=0):
    """A convex quadratic with its least point, a random (size,) within reach."""
    rng = np.random.default_rng(seed)
    A, least = rng.standard_normal((size, size)), 0.2 * rng.standard_normal(size)
    H = A @ A.T / size + 0.2 * np.eye(size)
    return least, lambda x: 2.0 + 0.5 * np.einsum("ni,ij,nj->n", x - least, H, x - least)


def test_the_least_point_of_a_quadratic_is_found_at_once():
    least, cost = bowl(4)
    flown = np.random.default_rng(1).standard_normal((40, 4))
    found, expected = search.least(flown, cost(flown), np.zeros(4), 0.5)
    assert found == pytest.approx(least, abs=1e-9) and expected == pytest.approx(2.0)


def test_no_step_is_longer_than_the_reach_and_a_saddle_is_left_downhill():
    flown, guess = np.random.default_rng(1).standard_normal((60, 3)), np.full((1, 3), 0.1)
    for cost in (
        lambda x: x @ [9.0, 1.0, 0.0] + 0.1 * np.sum(x**2, axis=1),
        lambda x: -np.sum(x**2, axis=1),
    ):
        found, expected = search.least(flown, cost(flown), guess[0], 0.5)
        assert np.linalg.norm(found - guess) == pytest.approx(search.REACH * 0.5, rel=1e-6)
        assert expected == pytest.approx(cost(found[None])[0])
        assert expected < cost(guess)[0] - 0.1


def test_noise_is_averaged_over_all_rounds():
    cost, rng = bowl(4)[1], np.random.default_rng(2)

    def noisy(gains, seeds):
        assert len(gains) == len(seeds)
        seen.extend(seeds)
        return cost(gains) + 0.3 * rng.standard_normal(len(gains))

    seen = []
    found = search.descend(noisy, 4, range(100, 2100), rounds=4)
    assert seen == list(range(100, 2100))  # every seed once
    gap = (cost(found[None]) - 2.0)[0]
    assert gap < 0.1 * (cost(np.zeros((1, 4))) - 2.0)[0]


def told(task: Task = TASK) -> Task:
    return Reading(task, READS).task


def test_every_gain_is_the_same_for_all_axes():
    pattern = search.tied(told())
    assert pattern.shape == (3, 3, 3 + 3 + 3)
    assert pattern.sum(axis=0).tolist() == np.hstack([np.eye(3)] * 3).tolist()
    assert (pattern.sum(axis=(1, 2)) == 3).all()


def test_a_policy_of_gains_costs_what_was_said_in_the_search(tmp_path, monkeypatch):
    law = load("lq", TASK, BRIEF).policy
    residual = Residual(law, 0.2, Reading(TASK, READS))
    lanes = LaneVecEnv(TASK, BRIEF, range(5), residual)
    gains = np.array([0.3, -0.2, 0.4])
    matrix = np.tensordot(gains, search.tied(lanes.task), 1)
    model = search.linear_model(lanes, matrix)
    rows = lanes.reset()
    said, _ = model.predict(rows, deterministic=True)
    assert said == pytest.approx(np.clip(rows @ matrix.T, -1.0, 1.0), abs=1e-6)
    cost, steps = search.fly(lanes, np.repeat(matrix[None], 5, 0))
    assert steps == 5 * round(BRIEF.t_f / BRIEF.dt)
    assert cost == pytest.approx(-total(model, lanes), rel=1e-5)


def total(model, lanes):
    """Returns of the first episodes of a model's mean action."""
    rows, returns = lanes.reset(), np.zeros(lanes.num_envs)
    for _ in range(round(BRIEF.t_f / BRIEF.dt)):
        rows, rewards, _, _ = lanes.step(model.predict(rows, deterministic=True)[0])
        returns += rewards
    return returns


def options(out, **changes):
    asked = {"env": TASK.id, "residual": "lq", "rounds": 2, "episodes": 30}
    return search.Options(out=out, **(asked | changes))


def test_what_is_written_loads_and_says_what_it_is(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(search, "preset_for", lambda env, algo: TINY)
    brief = replace(TASK, scenarios={"random": BRIEF})
    monkeypatch.setattr(search, "load_task", lambda env: brief)
    assert guarded(lambda: search.train(options(tmp_path / "run", seed=7))) == 0
    assert "round 2 of 2: cost " in capsys.readouterr().out
    card = read_card(tmp_path / "run" / "model.zip")
    assert card["residual"] == {"law": "lq", "scale": 0.2, "reads": list(READS)}
    assert card["seeds"] == {"training": [7, 66], "validation": [90_000, 90_005]}
    assert card["reached"]["episodes"] == 6 and len(card["gains"]) == 3
    assert card["steps"] == 60 * round(BRIEF.t_f / BRIEF.dt)
    entry = load(str(tmp_path / "run"), TASK, BRIEF)
    assert (entry.kind, entry.summary) == (
        "residual",
        f"search, residual on lq, {card['steps']:,} steps",
    )


@pytest.mark.parametrize(
    "changes, words",
    [
        ({"rounds": 0}, "must be at least 1"),
        ({"seed": -1}, "within 0 to 90000"),
        ({"seed": 89_950}, "within 0 to 90000"),
        ({"residual": "oas"}, "did you mean 'osa'"),
        (
            {"env": "visenvs/Formation-v0", "residual": "follow"},
            "does not say what a residual reads",
        ),
    ],
)
def test_what_cannot_be_searched_is_told_in_one_line(changes, words, tmp_path, monkeypatch, capsys):
    if "env" not in changes:
        monkeypatch.setattr(search, "preset_for", lambda env, algo: TINY)
    assert guarded(lambda: search.train(options(tmp_path / "run", **changes))) == 1
    assert words in capsys.readouterr().err
    assert not (tmp_path / "run").exists()
