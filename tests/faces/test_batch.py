"""Many lanes as a Gymnasium vector environment: seeds, autoreset, masks, order of calls."""

from __future__ import annotations

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.error import Error, ResetNeeded

from visenvs.faces.batch import LaneVectorEnv
from visenvs.faces.single import LaneEnv

ENV_ID = "visenvs/Rendezvous-v0"
COAST = np.zeros((3, 3), np.float32)


def seeds(envs):
    return envs.snapshot()["seed"].tolist()


def episodes(envs):
    return envs.snapshot()["episode"].tolist()


def mask(*lanes):
    chosen = np.zeros(3, bool)
    chosen[list(lanes)] = True
    return {"reset_mask": chosen}


def test_make_vec_gives_native_lanes():
    envs = gym.make_vec(ENV_ID, 3, scenario="thesis", t_f=15.0)
    assert type(envs) is LaneVectorEnv and envs.num_envs == 3
    assert envs.config.t_f == 15.0 and envs.metadata["render_fps"] == 10
    assert envs.metadata["autoreset_mode"] is gym.vector.AutoresetMode.SAME_STEP


@pytest.mark.parametrize("seed", [40, np.int64(40), [40, 41, 42], (40, 41, 42), np.arange(40, 43)])
def test_lane_i_has_the_seed_plus_i(seed):
    envs = LaneVectorEnv(ENV_ID, 3)
    rows, infos = envs.reset(seed=seed)
    assert seeds(envs) == [40, 41, 42] and episodes(envs) == [0, 0, 0] and infos == {}
    assert (rows[2] == LaneEnv(ENV_ID).reset(seed=42)[0]).all()


def test_resets_without_seeds_go_on():
    envs = LaneVectorEnv(ENV_ID, 3)
    envs.reset(seed=40)
    envs.reset()
    assert seeds(envs) == [40, 41, 42] and episodes(envs) == [1, 1, 1]
    envs.reset(seed=[None, 7, None])
    assert seeds(envs) == [40, 7, 42] and episodes(envs) == [2, 0, 2]


def test_lanes_without_a_seed_draw_different_ones():
    envs = LaneVectorEnv(ENV_ID, 3)
    envs.reset(seed=[None, 7, None])
    drawn = seeds(envs)
    assert drawn[1] == 7 and len(set(drawn)) == 3 and max(drawn) < 2**63
    envs.reset()
    assert seeds(envs) == drawn and episodes(envs) == [1, 1, 1]


@pytest.mark.parametrize(
    "seed, message",
    [
        ([1, 2], r"expected a whole number, or 3 of them.*got \[1, 2\]; write `seed=0`"),
        (1.5, "expected a whole number, or 3 of them.*got 1.5; write `seed=0`"),
        ([1, 2, -3], "integer seeds from 0"),
        ([1, 2, 0.5], "integer seeds from 0"),
        (-1, "greater or equal to zero"),
    ],
)
def test_bad_seeds_touch_nothing(seed, message):
    envs = LaneVectorEnv(ENV_ID, 3)
    envs.reset(seed=40)
    before = envs.snapshot()
    with pytest.raises((ValueError, Error), match=message):
        envs.reset(seed=seed)
    assert (envs.snapshot() == before).all()


def test_seeds_use_all_64_bits():
    envs = LaneVectorEnv(ENV_ID, 3)
    envs.reset(seed=[1, 2**63 + 1, 2**64 - 1])
    assert seeds(envs) == [1, 2**63 + 1, 2**64 - 1]


def test_a_mask_resets_some_lanes():
    envs = LaneVectorEnv(ENV_ID, 3)
    envs.reset(seed=40)
    envs.step(COAST + 1)
    options = mask(1)
    before = envs.snapshot()
    rows, _ = envs.reset(options=options)
    assert options.keys() == {"reset_mask"}
    assert episodes(envs) == [0, 1, 0] and envs.snapshot()["step"].tolist() == [1, 0, 1]
    assert (envs.snapshot()[[0, 2]] == before[[0, 2]]).all()
    assert (rows == envs.lanes.rows).all()
    envs.reset(seed=90, options=mask(0, 2))
    assert seeds(envs) == [90, 41, 92] and episodes(envs) == [0, 1, 0]


@pytest.mark.parametrize(
    "bad", [np.zeros(3, bool), np.ones(2, bool), np.ones(3), np.ones((3, 1), bool)]
)
def test_bad_masks(bad):
    envs = LaneVectorEnv(ENV_ID, 3)
    with pytest.raises(
        ValueError, match=r"(?s)reset_mask must be 3 booleans.*terminated \| truncated"
    ):
        envs.reset(options={"reset_mask": bad})


def test_steps_need_an_episode_in_every_lane():
    envs = LaneVectorEnv(ENV_ID, 3, render_mode="rgb_array")
    envs.reset(seed=40, options=mask(0, 2))
    for call in (lambda: envs.step(COAST), envs.snapshot, envs.render):
        with pytest.raises(ResetNeeded, match="no episode has begun in lane 1"):
            call()
    envs.reset(options=mask(1))
    envs.step(COAST)


def test_a_lane_that_ends_begins_anew_in_the_same_step():
    envs = LaneVectorEnv(ENV_ID, 3, t_f=0.3)
    envs.reset(seed=40)
    envs.step(COAST)
    envs.reset(options=mask(1))
    envs.step(COAST)
    rows, rewards, terminated, truncated, infos = envs.step(COAST)
    assert terminated.tolist() == [True, False, True] and not truncated.any()
    assert episodes(envs) == [1, 1, 1] and envs.snapshot()["step"].tolist() == [0, 2, 0]
    assert infos["_final_obs"].tolist() == [True, False, True]
    assert infos["final_obs"][1] is None
    assert envs.layout.unpack(infos["final_obs"][0])["t_go"] == pytest.approx(0.0, abs=1e-6)
    assert envs.layout.unpack(rows)["t_go"] == pytest.approx([0.3, 0.1, 0.3])
    final = infos["final_info"]
    assert final["outcome"].tolist() == ["miss", None, "miss"]
    assert final["metrics"]["total_cost"][0] > 0 and final["metrics"]["total_cost"][1] == 0
    ended = sum(final["reward_terms"][name] for name in ("control", "position", "velocity"))
    running = sum(infos["reward_terms"][name] for name in ("control", "position", "velocity"))
    assert (ended + running == rewards).all()
    assert infos["_reward_terms"].tolist() == [False, True, False]


def test_what_is_returned_is_the_callers_to_keep():
    envs = LaneVectorEnv(ENV_ID, 3, t_f=0.2)
    envs.reset(seed=40)
    kept = [envs.step(COAST + 1) for _ in range(2)]
    copies = [[np.copy(part) for part in step[:4]] for step in kept]
    final = kept[1][4]["final_obs"][0].copy()
    control = kept[0][4]["reward_terms"]["control"].copy()
    envs.step(COAST)
    envs.step(COAST)
    for step, before in zip(kept, copies, strict=True):
        for part, copied in zip(step[:4], before, strict=True):
            assert (part == copied).all()
    assert (kept[1][4]["final_obs"][0] == final).all()
    assert (kept[0][4]["reward_terms"]["control"] == control).all() and (control < 0).all()
    kept[0][0][:] = 7.0
    assert not (envs.lanes.rows == 7.0).any()


def test_every_lane_has_its_picture():
    envs = LaneVectorEnv(ENV_ID, 2, render_mode="rgb_array")
    envs.reset(seed=40)
    one, other = envs.render()
    assert (one != other).any()
    single = LaneEnv(ENV_ID, render_mode="rgb_array")
    single.reset(seed=41)
    assert (single.render() == other).all()


def test_there_is_no_window_of_many_lanes():
    with pytest.raises(ValueError, match=r"unknown render_mode 'human'. .*'rgb_array'$"):
        LaneVectorEnv(ENV_ID, 2, render_mode="human")
    envs = LaneVectorEnv(ENV_ID, 2)
    envs.reset(seed=40)
    with pytest.warns(UserWarning, match="write `gymnasium.make"):
        assert envs.render() is None


def test_gymnasiums_wrappers_fit():
    envs = gym.make_vec(ENV_ID, 3, t_f=0.3)
    envs = gym.wrappers.vector.RecordEpisodeStatistics(envs)
    envs = gym.wrappers.vector.DictInfoToList(envs)
    envs.reset(seed=40)
    rewards = np.zeros(3)
    for _ in range(3):
        _, reward, _, _, infos = envs.step(COAST + 1)
        rewards += reward
    assert [info["episode"]["l"] for info in infos] == [3, 3, 3]
    assert [info["episode"]["r"] for info in infos] == pytest.approx(rewards.tolist())
    assert [info["final_info"]["outcome"] for info in infos] == ["miss"] * 3


def test_there_is_at_least_one_lane():
    with pytest.raises(ValueError, match="at least 1"):
        gym.make_vec(ENV_ID, 0)
