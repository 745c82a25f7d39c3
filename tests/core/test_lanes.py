"""The loop that every task shares: seeds and episodes, time limit, divergence, rewards, input."""

from __future__ import annotations

import copy
import pickle
from dataclasses import replace

import numba
import numpy as np
import pytest

from tests.toys import toys
from visenvs.core.lanes import Lanes, checked_seeds
from visenvs.core.loop import begin, settle
from visenvs.core.outcome import Outcome
from visenvs.core.registry import load_task

pytestmark = pytest.mark.kernel

with toys():
    CART = load_task("visenvs/Cart-v0")
ENDLESS = CART.scenarios["endless"]  # it never succeeds, so that only the limit can end it
COAST = np.zeros((3, 1), np.float32)


def carts(count=3, config=ENDLESS, **changes):
    lanes = Lanes(CART, replace(config, **changes), count)
    lanes.reset(range(count))
    return lanes


def test_a_lane_is_cut_off_after_exactly_the_longest_number_of_steps():
    lanes = carts(longest=4)
    ended = [lanes.step(COAST) for _ in range(4)]
    assert ended == [0, 0, 0, 3]
    assert (lanes.outcome == Outcome.TIME_LIMIT).all()
    assert lanes.done.all() and lanes.truncated.all()
    assert lanes.results(0)["outcome"] is Outcome.TIME_LIMIT


def test_without_a_limit_a_lane_flies_on():
    lanes = carts()
    assert sum(lanes.step(COAST) for _ in range(50)) == 0
    assert (lanes.records["step"] == 50).all()


def test_an_end_of_its_own_at_the_limit_is_no_time_limit():
    lanes = carts(longest=1, radius=100.0)
    assert lanes.step(COAST) == 3
    assert (lanes.outcome == Outcome.SUCCESS).all() and not lanes.truncated.any()


def test_lanes_that_have_ended_stand_still_and_cost_nothing():
    lanes = carts(longest=1)
    lanes.step(COAST)
    assert (lanes.rewards < 0).all()
    still = lanes.records[["x", "v", "step", "total_cost", "outcome"]].copy()
    assert lanes.step(COAST + 1) == 3
    assert (lanes.records[["x", "v", "step", "total_cost", "outcome"]] == still).all()
    assert (lanes.rewards == 0).all() and (lanes.terms == 0).all()


def test_actions_of_lanes_that_have_ended_are_not_read():
    lanes = carts(longest=2)
    lanes.step(COAST)
    lanes.reset(where=np.array([False, True, False]))
    lanes.step(COAST)
    spoilt = COAST.copy()
    spoilt[[0, 2]] = np.nan
    assert lanes.step(spoilt) == 3
    with pytest.raises(ValueError, match="action of lane 1"):
        lanes.reset(where=np.array([False, True, False]))
        lanes.step(COAST * np.nan)


def test_rewards_are_minus_the_costs_of_this_step_alone():
    lanes = carts()
    lanes.step(COAST + 1)
    x, v = lanes.records["x"], lanes.records["v"]
    assert v == pytest.approx([0.1] * 3)
    assert lanes.terms == pytest.approx(np.stack([-0.1 * x**2, [-0.1] * 3], axis=1))
    assert (lanes.rewards == lanes.terms[:, 0] + lanes.terms[:, 1]).all()


def test_resets_without_seeds_go_on_to_the_next_episode():
    lanes = carts()
    starts = [lanes.records["x"].copy()]
    lanes.reset()
    lanes.step(COAST)
    lanes.reset(where=np.array([True, False, True]))
    assert lanes.records["seed"].tolist() == [0, 1, 2]
    assert lanes.records["episode"].tolist() == [2, 1, 2]
    assert lanes.records["step"].tolist() == [0, 1, 0]
    starts.append(lanes.records["x"].copy())
    assert (starts[0] != starts[1]).all()
    lanes.reset([0, 1, 2])
    assert (lanes.records["x"] == starts[0]).all() and (lanes.records["episode"] == 0).all()


def test_a_partial_reset_leaves_the_other_lanes_alone():
    lanes = carts()
    lanes.step(COAST + 1)
    before, rows = lanes.snapshot(), lanes.rows.copy()
    lanes.reset([9], np.array([False, True, False]))
    assert lanes.records[[0, 2]].tobytes() == before[[0, 2]].tobytes()
    assert (lanes.rows[[0, 2]] == rows[[0, 2]]).all()
    alone = carts(1)
    alone.reset([9])
    assert lanes.records[1] == alone.records[0] and (lanes.rows[1] == alone.rows[0]).all()


@pytest.mark.parametrize("seeds", [None, []])
def test_a_reset_of_no_lane_does_nothing(seeds):
    lanes = carts()
    lanes.step(COAST + 1)
    before, rows = lanes.snapshot(), lanes.rows.copy()
    lanes.reset(seeds, np.zeros(3, bool))
    assert lanes.records.tobytes() == before.tobytes() and (lanes.rows == rows).all()


def test_bad_costs_diverge_without_a_reward():
    """A NaN that no observation shows still ends the episode."""
    lanes = carts(2)
    lanes.step(COAST[:2])
    lanes.records["cost_control"][0] = np.nan
    settle(*lanes._settle_with)
    assert lanes.outcome.tolist() == [Outcome.DIVERGED, Outcome.RUNNING]
    assert lanes.rewards[0] == 0 and lanes.rewards[1] < 0


def test_the_first_bad_action_is_named_and_nothing_is_touched():
    lanes = carts()
    actions = np.array([[1.0], [1.00001], [np.inf]], np.float32)
    before = lanes.snapshot()
    assert begin(*lanes._begin_with, actions) == 1
    assert lanes.records.tobytes() == before.tobytes()


@pytest.mark.parametrize(
    "view",
    [
        lambda a: a.astype(np.float64),
        lambda a: a.astype(">f4"),
        lambda a: np.repeat(a, 2, axis=0)[::2],
        lambda a: np.asfortranarray(np.hstack([a, a]))[:, :1],
        lambda a: np.broadcast_to(a[:1], a.shape) if (a == a[0]).all() else a,
    ],
    ids=["float64", "big-endian", "strided", "fortran", "read-only"],
)
def test_actions_in_any_memory_layout_fly_the_same_without_compiling_again(view):
    actions = COAST + np.float32(0.5)
    plain, other = carts(), carts()
    plain.step(actions)
    compiled = [] if numba.config.DISABLE_JIT else CART.step_lanes.signatures
    before = len(compiled)
    other.step(view(actions))
    assert plain.records.tobytes() == other.records.tobytes()
    assert len([] if numba.config.DISABLE_JIT else CART.step_lanes.signatures) == before


@pytest.mark.parametrize(
    "seeds", [[1, 2], [1, 2, -3], [1.0, 2.0, 3.0], [2**64, 1, 2], "abc", [True] * 3]
)
def test_bad_seeds_touch_nothing(seeds):
    lanes = carts()
    before = lanes.snapshot()
    with pytest.raises(ValueError, match="expected 3 integer seeds from 0"):
        lanes.reset(seeds)
    assert lanes.records.tobytes() == before.tobytes()


def test_seeds_use_all_64_bits():
    assert checked_seeds([2**64 - 1], 1).tolist() == [2**64 - 1]
    lanes = carts(2)
    lanes.reset([1, 2**63 + 1])
    assert lanes.records["x"][0] != lanes.records["x"][1]


@pytest.mark.parametrize("count", [0, -1])
def test_there_is_at_least_one_lane(count):
    with pytest.raises(ValueError, match="must be at least 1"):
        Lanes(CART, ENDLESS, count)


def test_a_snapshot_of_something_else_is_refused():
    lanes = carts()
    before = lanes.snapshot()
    with pytest.raises(ValueError, match="not of 3 lanes of visenvs/Cart-v0"):
        lanes.restore(carts(2).snapshot())
    with pytest.raises(ValueError, match="not of 3 lanes"):
        lanes.restore(np.zeros(3, load_task("visenvs/Rendezvous-v0").lane))
    assert lanes.records.tobytes() == before.tobytes()


def test_a_snapshot_is_a_copy():
    lanes = carts()
    before = lanes.snapshot()
    lanes.step(COAST + 1)
    assert (before["step"] == 0).all()
    lanes.restore(before)
    before["x"] = 5.0
    assert (lanes.records["x"] != 5.0).all()


@pytest.mark.parametrize(
    "duplicate", [copy.copy, copy.deepcopy, lambda x: pickle.loads(pickle.dumps(x))]
)
def test_a_copy_owns_its_memory(duplicate):
    task = load_task("visenvs/Rendezvous-v0")
    lanes = Lanes(task, task.scenarios["random"], 2)
    lanes.reset([4, 5])
    actions = np.full((2, 3), 0.3, np.float32)
    lanes.step(actions)
    twin = duplicate(lanes)
    assert twin.task is task and twin.config == lanes.config
    assert (twin.rows == lanes.rows).all() and (twin.rewards == lanes.rewards).all()
    lanes.step(actions)
    assert (twin.records["step"] == 1).all()
    twin.step(actions)
    assert twin.records.tobytes() == lanes.records.tobytes()
    assert twin.rows.tobytes() == lanes.rows.tobytes()
