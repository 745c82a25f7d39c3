from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from eval.metrics import Episodes
from eval.results import Result, load, meta, replace_block, result_path, save


@pytest.fixture
def result():
    episodes = Episodes(
        seeds=np.array([100_000, 100_001, 100_002]),
        outcomes=("success", "miss", "diverged"),
        metrics={
            "total_cost": np.array([0.1, 1 / 3, np.inf]),
            "miss_distance": np.array([1e-300, 2.0, np.nan]),
        },
    )
    return Result(
        env="visenvs/Rendezvous-v0",
        scenario="random",
        estimator="ekf",
        perception="points",
        policy="lq",
        label="lq",
        summary="a law",
        information="belief",
        config={"dt": 0.1, "camera": "gimbal", "target": [1.0, 2.0]},
        units={"total_cost": "m^2/s^3", "miss_distance": "m"},
        us_per_decision=0.25,
        episodes=episodes,
    )


def test_what_is_saved_is_read_back_to_the_last_bit(result, tmp_path):
    again = load(save(result, tmp_path, {}))
    assert replace(again, episodes=result.episodes) == result
    assert again.episodes.outcomes == result.episodes.outcomes
    np.testing.assert_array_equal(again.episodes.seeds, result.episodes.seeds)
    for name, values in result.episodes.metrics.items():
        np.testing.assert_array_equal(again.episodes.metrics[name], values)


def test_the_file_is_strict_json_and_says_what_made_it(result, tmp_path):
    path = save(result, tmp_path, meta("eval.leaderboard", range(100_000, 100_003)))
    content = json.loads(path.read_text(), parse_constant=pytest.fail)
    assert content["metrics"]["total_cost"] == [0.1, 1 / 3, None]
    assert content["meta"]["seeds"] == {"first": 100_000, "last": 100_002, "count": 3}
    assert {"versions", "commit", "date", "command"} < set(content["meta"])


def test_nothing_but_the_file_is_left(result, tmp_path):
    path = save(result, tmp_path, {})
    assert [p for p in tmp_path.rglob("*") if p.is_file()] == [path]


@pytest.mark.parametrize("one, other", [("runs/a/model.zip", "runs-a-model.zip"), ("a:b", "a-b")])
def test_different_policies_never_share_a_file(result, tmp_path, one, other):
    paths = [result_path(tmp_path, replace(result, policy=name)) for name in (one, other)]
    assert paths[0] != paths[1]
    assert paths[0].parent == paths[1].parent == tmp_path / "Rendezvous-v0" / "random" / "ekf"


@pytest.mark.parametrize("policy", ["../../../up.zip", "/etc/model.zip", "..", "a\nb"])
def test_no_policy_name_leads_out_of_the_folder(result, tmp_path, policy):
    path = result_path(tmp_path, replace(result, policy=policy))
    assert path.resolve().parent == (tmp_path / "Rendezvous-v0" / "random" / "ekf").resolve()


@pytest.mark.parametrize(
    "text", ["", "{", "[1, 2]", '{"env": "x"}', '{"seeds": [], "outcomes": 3}']
)
def test_a_foreign_file_is_refused_with_its_name(tmp_path, text):
    path = tmp_path / "foreign.json"
    path.write_text(text)
    with pytest.raises(ValueError, match=r"foreign\.json is not"):
        load(path)


def test_a_block_is_replaced_and_nothing_else(tmp_path):
    path = tmp_path / "README.md"
    path.write_text("# before\n<!-- table -->\nold\n<!-- /table -->\nafter\n")
    replace_block(path, "table", "| new |")
    assert path.read_text() == "# before\n<!-- table -->\n| new |\n<!-- /table -->\nafter\n"
    replace_block(path, "table", "| newer |")
    assert path.read_text() == "# before\n<!-- table -->\n| newer |\n<!-- /table -->\nafter\n"


@pytest.mark.parametrize(
    "text",
    [
        "no marker",
        "<!-- table -->",
        "<!-- /table --><!-- table -->",
        "<!-- table --><!-- /table --><!-- table --><!-- /table -->",
    ],
)
def test_a_file_without_one_clear_block_is_left_alone(tmp_path, text):
    path = tmp_path / "README.md"
    path.write_text(text)
    with pytest.raises(ValueError, match="needs one line `<!-- table -->`"):
        replace_block(path, "table", "new")
    assert path.read_text() == text
