from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from agents.classical import LawPolicy, ZeroPolicy
from eval.metrics import COST, Episodes, failure_rate, mean_of, measure, metric, success_rate
from eval.rollout import PUBLIC_SEEDS, rollout
from visenvs.core.outcome import Outcome
from visenvs.core.registry import environment_files, laws, load_task


@pytest.fixture(scope="module")
def task():
    return load_task("visenvs/Rendezvous-v0")


@pytest.fixture(scope="module")
def flown(task):
    config = task.scenarios["random"]
    return rollout(LawPolicy(laws()["lq"], task, config), task, config, PUBLIC_SEEDS[:40])


def test_every_environment_reports_its_cost():
    for env in environment_files():
        assert COST in load_task(env).metrics


def test_the_cost_is_minus_the_return(task, flown):
    np.testing.assert_allclose(measure(flown, task).cost, -flown.returns, rtol=1e-12)


def test_there_is_one_entry_for_each_seed_in_order(task, flown):
    episodes = measure(flown, task)
    np.testing.assert_array_equal(episodes.seeds, PUBLIC_SEEDS[:40])
    assert len(episodes.outcomes) == len(episodes.cost) == 40
    assert set(episodes.metrics) == set(task.metrics)


def test_success_is_what_the_scenario_calls_success(task, flown):
    episodes = measure(flown, task)
    hits = episodes.metrics["miss_distance"] <= task.scenarios["random"].success_radius
    assert 0.0 < np.mean(hits) < 1.0
    assert success_rate(episodes) == np.mean(hits)
    assert failure_rate(episodes) == pytest.approx(1.0 - np.mean(hits))


def test_the_parts_of_the_cost_add_up(task, flown):
    episodes = measure(flown, task)
    parts = mean_of(episodes, "control_cost") + mean_of(episodes, "terminal_cost")
    assert parts == pytest.approx(np.mean(episodes.cost))


def test_without_action_there_is_no_control_cost(task):
    flown = rollout(ZeroPolicy(task), task, task.scenarios["random"], PUBLIC_SEEDS[:3])
    assert mean_of(measure(flown, task), "control_cost") == 0.0


def test_a_diverged_episode_costs_infinity_and_has_no_other_metric(task, flown):
    records = flown.records.copy()
    records["outcome"][7] = Outcome.DIVERGED
    episodes = measure(replace(flown, records=records), task)
    assert episodes.outcomes[7] == "diverged"
    assert episodes.cost[7] == np.inf
    assert np.isfinite(np.delete(episodes.cost, 7)).all()
    others = np.delete(metric(flown.records, "miss_distance"), 7)
    assert mean_of(episodes, "miss_distance") == pytest.approx(np.mean(others))


def test_a_metric_that_nobody_has_is_none():
    nothing = Episodes(np.arange(2), ("miss", "miss"), {"miss_distance": np.full(2, np.nan)})
    assert mean_of(nothing, "miss_distance") is None
    assert mean_of(nothing, "nees_mean") is None
