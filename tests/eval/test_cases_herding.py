"""The index of services beside the paper's rule, on a few flights."""

from __future__ import annotations

from eval.cases import iarc_fig7


def test_the_index_goals_more_robots_than_the_rule_where_it_is_judged():
    rows = {row.id.removeprefix("iarc-fig7/index/"): row for row in iarc_fig7.index_rows(4)}
    assert len(rows) == 4 * len(iarc_fig7.INDEX)
    for name, (scenario, changes, least, _) in iarc_fig7.INDEX.items():
        if least is None:
            continue
        by_rule = iarc_fig7.missions("paper-rule", scenario, changes, 4)["goaled"].mean()
        assert rows[f"{name}/goaled"].ours > by_rule + 1.0
    for name in ("paper/truth", "firmware/truth"):
        assert rows[f"{name}/goaled"].ok and rows[f"{name}/success"].ours > 0.5
