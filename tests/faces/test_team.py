"""The PettingZoo face: its own API tests, determinism, agents that end, and errors that teach."""

import warnings

import numpy as np
import pytest
from gymnasium.error import ResetNeeded

from agents.classical import LawPolicy
from eval.rollout import rollout
from tests.toys import toys
from visenvs import formation_v0
from visenvs.core.config import override
from visenvs.core.registry import find_law, load_task
from visenvs.envs import formation  # before the toys hide it
from visenvs.faces import team
from visenvs.faces.single import LaneEnv

with warnings.catch_warnings():  # it imports a game by a way that it calls old
    warnings.simplefilter("ignore", DeprecationWarning)
    from pettingzoo.test import api_test, parallel_api_test, parallel_seed_test, seed_test

TREES = ((1, "chain"), (2, "chain"), (2, "v"), (5, "chain"), (5, "v"))
trees = pytest.mark.parametrize(("followers", "tree"), TREES)


def flight(followers=2, tree="v", **settings):
    return formation_v0.parallel_env("team", followers=followers, formation=tree, **settings)


def followed(env, law="follow"):
    """The action of a law for every agent that is there."""
    policy = LawPolicy(find_law(law), env.task, env.config)
    actions, _ = policy.predict(env.lanes.rows)
    return {agent: actions[int(agent.removeprefix("follower_"))] for agent in env.agents}


@trees
def test_pettingzoo_finds_nothing_wrong(followers, tree):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        parallel_api_test(flight(followers, tree), num_cycles=1000)


@trees
def test_pettingzoo_finds_nothing_wrong_with_agents_in_turn(followers, tree, capsys):
    env = formation_v0.env("team", followers=followers, formation=tree, t_f=3.0)
    api_test(env, num_cycles=100)


def test_seeds_decide():
    parallel_seed_test(lambda: flight(5), num_cycles=100)
    seed_test(lambda: formation_v0.env("team", followers=2, t_f=3.0), num_cycles=50)


@trees
def test_a_thousand_steps_are_the_same_twice(followers, tree):
    """Bit for bit, also where agents are lost on the way; the second starts from a snapshot."""
    traces = []
    one, other = (flight(followers, tree, t_f=110.0) for _ in range(2))
    one.reset(seed=7)
    other.reset(seed=8)
    other.restore(one.snapshot())
    for env in (one, other):
        trace = []
        for _ in range(1000):
            if env.agents:
                rows, rewards, *ends, _ = env.step(followed(env))
                seen = [rows[agent].tobytes() for agent in rows]
                trace.append([env.agents.copy(), seen, list(rewards.values()), *ends])
        traces.append(trace)
    assert len(traces[0]) == 1000
    assert traces[0] == traces[1]


@pytest.mark.parametrize("tree", ["chain", "v"])
def test_a_follower_more_does_not_change_the_others(tree):
    flown = []
    for followers in (2, 3):
        env = flight(followers, tree)
        env.reset(seed=3)
        rows = []
        for _ in range(200):
            seen = env.step(followed(env))[0]
            rows.append([seen[agent].tobytes() for agent in ("follower_0", "follower_1")])
        flown.append(rows)
    assert flown[0] == flown[1]


def test_one_follower_is_the_single_environment():
    env, single = flight(1), LaneEnv("visenvs/Formation-v0", "team", followers=1)
    rows, infos = env.reset(seed=11)
    row, info = single.reset(seed=11)
    assert infos == {"follower_0": info}
    for _ in range(100):
        assert np.array_equal(rows["follower_0"], row)
        action = followed(env)["follower_0"]
        rows, rewards, ended, cut, infos = env.step({"follower_0": action})
        row, *other, info = single.step(action)
        assert [rewards["follower_0"], ended["follower_0"], cut["follower_0"]] == other
        assert infos["follower_0"] == info


def test_who_is_lost_leaves_and_the_others_fly_on():
    env = flight(2, "chain")
    env.reset(seed=1)
    ended = {}
    while env.agents:
        actions = followed(env)
        if "follower_1" in actions:
            actions["follower_1"] = np.array([0.0, 1.0, 0.0], np.float32)  # turns away for good
        acted = env.agents
        rows, rewards, terminated, truncated, infos = env.step(actions)
        for told in (rows, rewards, terminated, truncated, infos):
            assert list(told) == acted
        for agent in acted:
            assert sum(infos[agent]["reward_terms"].values()) == pytest.approx(rewards[agent])
            assert ("metrics" in infos[agent]) == terminated[agent]
            if terminated[agent]:
                ended[agent] = infos[agent]["outcome"], env.lanes.records["step"].tolist()
        assert env.state().shape == (2 * len(rows[acted[0]]),)
        assert env.state_space.contains(env.state())
    assert ended["follower_1"][0] == "lost"
    assert ended["follower_0"][0] == "success"
    assert ended["follower_1"][1][1] < ended["follower_0"][1][0]
    with pytest.raises(ResetNeeded, match="the episode is over"):
        env.step({})


def test_a_rollout_flies_the_same_episode():
    task = load_task("visenvs/Formation-v0")
    config = override(task.scenarios["team"], {"t_f": 5.0, "followers": 3})
    flown = rollout(LawPolicy(find_law("follow"), task, config), task, config, [21])
    env = flight(3, t_f=5.0)
    env.reset(seed=21)
    total = 0.0
    while env.agents:
        total += sum(env.step(followed(env))[1].values())
    assert flown.returns[0] == pytest.approx(total / 3)


def test_agents_act_in_turn_on_one_snapshot():
    together, turns = flight(2), formation_v0.raw_env("team", followers=2, formation="v")
    together.reset(seed=4)
    turns.reset(seed=4)
    for _ in range(20):
        actions = followed(together)
        rows = together.step(actions)[0]
        for agent in ("follower_0", "follower_1"):
            assert turns.agent_selection == agent
            turns.step(actions[agent])
    assert all(np.array_equal(turns.observe(agent), rows[agent]) for agent in rows)


@pytest.mark.parametrize("followers", [1, 5])
def test_a_team_is_one_picture(followers):
    env = flight(followers, render_mode="rgb_array")
    env.reset(seed=2)
    first = env.render()
    assert first.dtype == np.uint8 and first.ndim == 3 and first.shape[2] == 3
    for _ in range(20):
        env.step(followed(env))
    assert env.render().shape == first.shape
    assert (env.render() != first).any()


def test_errors_tell_what_to_write():
    env = flight(2)
    with pytest.raises(ResetNeeded, match="no episode has begun"):
        env.step({})
    with pytest.raises(ResetNeeded, match="there is nothing to draw"):
        env.render()
    with pytest.raises(ResetNeeded, match="no state to copy"):
        env.snapshot()
    with pytest.raises(ValueError, match=r"got \[-1\]; write `seed=0`"):
        env.reset(seed=-1)
    env.reset(seed=0)
    before = env.snapshot()
    good = followed(env)
    with pytest.raises(
        ValueError, match=r"each of \['follower_0', 'follower_1'\], got \['follower_1'\]; write"
    ):
        env.step({"follower_1": good["follower_1"]})
    with pytest.raises(ValueError, match=r"each of .*, got \[0, 'follower_1'\]; write"):
        env.step({0: good["follower_0"], "follower_1": good["follower_1"]})
    with pytest.raises(ValueError, match=r"each of .*, got list; write"):
        env.step(list(good.values()))
    with pytest.raises(ValueError, match=r"the action of follower_1 has shape \(3,\), got \(2,\)"):
        env.step({**good, "follower_1": np.zeros(2, np.float32)})
    with pytest.raises(ValueError, match="must be finite and within"):
        env.step({**good, "follower_1": np.full(3, np.nan, np.float32)})
    assert env.snapshot().tobytes() == before.tobytes()
    line = (
        r"`import visenvs.formation_v0` and `visenvs.formation_v0.parallel_env\('team', followers=2"
    )
    with pytest.raises(ValueError, match="2 agents fly visenvs/Formation-v0 together.*" + line):
        LaneEnv("visenvs/Formation-v0", "team", followers=2)
    with pytest.raises(ValueError, match=r"write `snapshot = env.snapshot\(\)`"):
        env.restore(None)
    with pytest.raises(ValueError, match="unknown scenario 'teem'; did you mean 'team'"):
        formation_v0.parallel_env("teem")


def test_any_task_with_a_team_can_be_shown():
    assert formation.TASK.team(formation.SCENARIOS["team"]) == 5
    with toys(), warnings.catch_warnings():
        warnings.simplefilter("error")
        env = team.parallel_env("visenvs/Convoy-v0", carts=3)
        assert env.possible_agents == ["agent_0", "agent_1", "agent_2"]
        parallel_api_test(env, num_cycles=100)
        assert str(env) == "convoy_v0"
        with pytest.raises(ValueError, match=r"unknown render_mode 'rgb_array'\. Choices: None"):
            team.parallel_env("visenvs/Convoy-v0", carts=3, render_mode="rgb_array")
        line = r'`visenvs.faces.team.parallel_env\("visenvs/Convoy-v0", carts=3\)`'
        with pytest.raises(ValueError, match=line):
            LaneEnv("visenvs/Convoy-v0", carts=3)
