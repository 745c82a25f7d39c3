"""Laws as policies: row to command to action, memory row by row, batches as single rows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from agents.classical import LawPolicy, RandomPolicy, ZeroPolicy
from agents.registry import load, names
from visenvs.core.lanes import Lanes
from visenvs.core.layout import Choices
from visenvs.core.registry import environment_files, find_law, load_task

TASK = load_task("visenvs/Rendezvous-v0")
CONFIG = TASK.scenarios["random"]
TRACKING = load_task("visenvs/Tracking2D-v0")
BRIEF = replace(TRACKING.scenarios["random"], t_f=2.0)
FLYING = [
    (env, name)
    for env in environment_files()
    for name in names(load_task(env))
    if find_law(name) is not None
]


def lanes_of(task, config, count=6, steps=3):
    """Lanes some steps into their episodes, pushed about at random."""
    lanes = Lanes(task, config, count)
    lanes.reset(range(count))
    rng = np.random.default_rng(1)
    for _ in range(steps):
        pushes = rng.uniform(-0.5, 0.5, (count, task.action.size)).astype(np.float32)
        lanes.step(np.zeros(count) if isinstance(task.action, Choices) else pushes)
    return lanes


def aiming(X, V, T, a_max):
    """PN as a policy, a row for it, and the action by hand: 3 (X / T^2 - V / T) / a_max."""
    values = {field.name: np.zeros(field.size) for field in TASK.observation.fields}
    values |= {"rhat_TV_N": np.asarray(X, float), "v_V_N": np.asarray(V, float)}
    values |= {"t_go": T, "seen": 1.0}
    command = 3.0 * (np.asarray(X) / T - np.asarray(V)) / T
    law = LawPolicy(find_law("pn"), TASK, replace(CONFIG, a_max=a_max))
    return law, TASK.observation.pack(values)[None], command / a_max


def test_a_command_is_told_over_the_longest_one():
    law, row, expected = aiming([40.0, -8.0, 2.0], [3.0, 1.0, 0.0], 10.0, a_max=5.0)
    assert np.linalg.norm(expected) < 1.0
    action, memory = law.predict(row)
    assert action[0] == pytest.approx(expected, rel=1e-5)
    assert memory is None and action.dtype == np.float32


def test_a_longer_command_keeps_its_direction():
    law, row, expected = aiming([40.0, -80.0, 20.0], [-3.0, 10.0, 0.0], 4.0, a_max=2.0)
    assert np.abs(expected).min() > 1.0  # axis by axis would give corners
    action, _ = law.predict(row)
    assert np.linalg.norm(action) == pytest.approx(1.0, abs=1e-6)
    assert action[0] == pytest.approx(expected / np.linalg.norm(expected), rel=1e-5)


def test_no_command_is_no_action():
    law, row, _ = aiming([0.0] * 3, [0.0] * 3, 4.0, a_max=2.0)
    assert law.predict(row)[0].tolist() == [[0.0] * 3]


@pytest.mark.parametrize("env, name", FLYING)
def test_a_batch_is_its_rows_one_by_one(env, name):
    task = load_task(env)
    config = next(iter(task.scenarios.values()))
    policy = load(name, task, config).policy
    rows = lanes_of(task, config).rows
    batch, memory = policy.predict(rows)
    apart = [policy.predict(row[None]) for row in rows]
    assert np.array_equal(batch, np.concatenate([action for action, _ in apart]))
    fields = () if isinstance(task.action, Choices) else task.action.fields
    ends = np.cumsum([field.size for field in fields])
    for part in np.split(batch, ends[:-1], axis=1) if fields else ():  # each has its own limit
        assert np.linalg.norm(part, axis=1).max() <= 1.0 + 1e-6
    if memory is not None:
        assert np.array_equal(memory, np.concatenate([own for _, own in apart]))


@pytest.mark.parametrize("env, name", FLYING)
def test_a_law_leaves_its_rows_alone(env, name):
    task = load_task(env)
    config = next(iter(task.scenarios.values()))
    rows = lanes_of(task, config).rows
    before = rows.copy()
    load(name, task, config).policy.predict(rows)
    assert np.array_equal(rows, before)


def test_a_plan_is_remembered_and_forgotten_row_by_row():
    law = load("nsa", TRACKING, BRIEF).policy
    lanes = lanes_of(TRACKING, BRIEF)
    _, memory = law.predict(lanes.rows)
    assert memory.shape == (6, 2 * 20) and memory.any(axis=1).all()
    lanes.step(np.zeros((6, 2), np.float32))
    begins = np.array([False, True, False, False, True, False])
    _, cold = law.predict(lanes.rows)
    _, warm = law.predict(lanes.rows, memory.copy())
    _, mixed = law.predict(lanes.rows, memory.copy(), begins)
    assert (warm != cold).any(axis=1).all()  # a warm start shows in the last digits of the plan
    assert np.array_equal(mixed, np.where(begins[:, None], cold, warm))
    _, none = law.predict(lanes.rows, memory.copy(), np.zeros(6, bool))
    assert np.array_equal(none, warm)


def test_memory_of_episodes_that_begin_does_not_matter():
    law = load("nsa", TRACKING, BRIEF).policy
    rows = lanes_of(TRACKING, BRIEF, steps=0).rows
    spoilt = np.full((6, 2 * 20), 1e3)
    action, _ = law.predict(rows, spoilt, np.ones(6, bool))
    assert np.array_equal(action, law.predict(rows)[0])


def test_laws_without_memory_hand_back_what_they_were_given():
    law = load("lq", TASK, CONFIG).policy
    rows = lanes_of(TASK, CONFIG).rows
    assert law.predict(rows)[1] is None
    assert law.predict(rows, "kept", np.ones(6, bool))[1] == "kept"


def test_a_law_that_needs_no_field_still_decides_for_every_row():
    task = load_task("visenvs/BearingsOnly-v0")
    config = next(iter(task.scenarios.values()))
    action, _ = load("straight", task, config).policy.predict(lanes_of(task, config).rows)
    assert action.tolist() == [[0.0]] * 6


def test_rows_of_another_layout_are_refused():
    law = load("lq", TASK, CONFIG).policy
    with pytest.raises(ValueError, match=f"has {TASK.observation.size} numbers, got shape"):
        law.predict(lanes_of(TRACKING, BRIEF).rows)


def test_no_action_at_all():
    rows = lanes_of(TASK, CONFIG).rows
    action, state = ZeroPolicy(TASK).predict(rows, "kept")
    assert action.tolist() == [[0.0] * 3] * 6
    assert (action.dtype, state) == (np.float32, "kept")


def test_random_actions_fill_the_box_and_come_again_with_the_seed():
    rows = np.zeros((2000, TASK.observation.size), np.float32)
    one, two, other = (RandomPolicy(TASK, seed) for seed in (0, 0, 1))
    first, memory = one.predict(rows)
    assert np.array_equal(first, two.predict(rows)[0])
    assert (first != other.predict(rows)[0]).any()
    assert (first != one.predict(rows, memory)[0]).any()  # it does not repeat itself
    assert first.dtype == np.float32 and np.abs(first).max() <= 1.0
    assert first.mean() == pytest.approx(0.0, abs=4 * np.sqrt(1 / 3 / first.size))
    assert first.var() == pytest.approx(1 / 3, rel=0.05)
