from __future__ import annotations

import re
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest

from eval import page
from eval.board import make_board, missing_row, result_row
from eval.clips import Clip
from eval.metrics import Episodes
from eval.plots import BOX, LogAxis, cloud_path, log_axis, spread, step_path, tick_label
from eval.results import Result
from visenvs.core.registry import load_task

MADE = {
    "versions": {"numpy": "2"},
    "commit": None,
    "date": "2026-01-01",
    "command": "python -m eval.leaderboard --policies '<b>'",
    "seeds": {"first": 100_000, "last": 100_049, "count": 50},
}
VOID = {"meta", "link", "br", "hr", "img", "input"}


class Strict(HTMLParser):
    """Fails on tags that do not nest; gathers attributes and text."""

    def __init__(self):
        super().__init__()
        self.open, self.tags, self.links, self.text = [], [], [], ""

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        self.links += [value for name, value in attrs if name in ("src", "href")]
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.text += data


def a_result(policy, cost, information="belief", estimator="ekf"):
    n = len(cost)
    metrics = {"total_cost": cost, "miss_distance": np.ones(n), "control_cost": cost / 2}
    episodes = Episodes(np.arange(n) + 100_000, ("success",) * n, metrics)
    return Result(
        env="visenvs/Rendezvous-v0",
        scenario="random",
        estimator=estimator,
        perception="points",
        policy=policy,
        label=policy,
        summary="a summary",
        information=information,
        config={"dt": 0.1},
        units={},
        us_per_decision=None,
        episodes=episodes,
    )


DOT = (
    "data:image/webp;base64,"
    "UklGRjIAAABXRUJQVlA4ICYAAABwAQCdASoQAAkAB0CWJaACdAFAAAD+xO/Xqlty0b7bd+uiqAAAAA=="
)
CLIP = Clip("osa", "worst", 100_007, 3.25, "out_of_bounds", DOT)


def rendered(*costs_by_policy, clips=()):
    costs = dict(costs_by_policy)
    flown = [
        a_result(name, cost, "none" if name == "zero" else "belief") for name, cost in costs.items()
    ]
    task = load_task("visenvs/Rendezvous-v0")
    lines = [(result_row(task, result, flown[0]), result) for result in flown]
    reason = "needs a <field> that is not there"
    missing = missing_row("visenvs/Rendezvous-v0", "random", "ekf", "points", "blind", reason)
    parser = Strict()
    shown = [clips] if clips else ()
    text = page.render([make_board(task, "random", [*lines, (missing, None)])], MADE, shown)
    parser.feed(text)
    assert parser.open == []
    return text, parser


@pytest.fixture(scope="module")
def costs():
    return np.exp(np.random.default_rng(0).standard_normal(50))


def test_the_page_needs_nothing_from_elsewhere(costs):
    text, parser = rendered(("lq", costs), ("osa", 0.5 * costs))
    assert parser.links == ["data:,", "#visenvs-Rendezvous-v0-random"]
    assert not re.search(r"https?://|@import|url\(", text)


def test_every_policy_has_a_row_a_bar_a_curve_and_a_cloud(costs):
    text, parser = rendered(("lq", costs), ("osa", 0.5 * costs), ("zero", 100 * costs))
    assert text.count('<th scope="row"') == 4  # and the one that cannot fly
    assert text.count('<div class="bar ') == 3
    assert text.count('class="curve ') == 2  # zero sees nothing
    assert text.count('class="dots"') == 1  # lq is the reference
    assert "a summary" in parser.text


def test_models_of_one_name_are_told_apart():
    task, lines = load_task("visenvs/Rendezvous-v0"), []
    for policy, cost in (("a/ppo", 1.0), ("b/ppo", 2.0), ("lq", 3.0)):
        result = replace(a_result(policy, np.full(20, cost)), label=policy.rpartition("/")[2])
        lines.append((result_row(task, result, None), result))
    board = make_board(task, "random", lines)
    assert [row["label"] for row in board.rows] == ["a/ppo", "b/ppo", "lq"]
    text = page.render([board], MADE)
    assert all(f'data-value="{label}"' in text for label in ("a/ppo", "b/ppo", "lq"))


def test_a_clip_says_what_it_shows(costs):
    _, parser = rendered(("lq", costs), ("osa", 0.5 * costs), clips=[CLIP])
    assert DOT in parser.links
    assert "osa worst: J 3.25, out of bounds seed 100007" in " ".join(parser.text.split())


def test_what_users_type_is_never_markup(costs):
    text, parser = rendered(("lq", costs), ("<script>alert(1)</script>", costs))
    assert "<script>alert" not in text
    assert "<script>alert(1)</script>" in parser.text
    assert "needs a <field> that is not there" in parser.text
    assert parser.tags.count("script") == 2  # the data and the code


def test_diverged_episodes_and_free_ones_still_make_a_page(costs):
    broken = np.where(np.arange(50) < 5, np.inf, costs)
    text, parser = rendered(("lq", costs), ("osa", broken), ("pn", np.zeros(50)))
    assert "∞" in parser.text
    assert not re.search(r"\bnan\b|\binf\b", text)
    assert 'data-value="Infinity"' in text


def test_a_board_on_which_nobody_can_fly_is_a_table_without_plots():
    text, parser = rendered_without_flights()
    assert "n/a" in parser.text
    assert 'class="plot"' not in text


def rendered_without_flights():
    task = load_task("visenvs/Rendezvous-v0")
    row = missing_row("visenvs/Rendezvous-v0", "random", "ekf", "points", "blind", "no camera")
    parser = Strict()
    text = page.render([make_board(task, "random", [(row, None)])], MADE)
    parser.feed(text)
    return text, parser


def test_a_logarithmic_axis_spaces_decades_evenly():
    axis = LogAxis(0.1, 1000.0)
    np.testing.assert_allclose(
        axis.at(np.array([0.1, 1.0, 10.0, 100.0, 1000.0])), range(0, 101, 25)
    )
    np.testing.assert_allclose(axis.at(np.array([0.0, np.inf])), [0.0, 100.0])
    assert [label for _, label in axis.ticks()] == ["0.1", "1", "10", "100", "1k"]


@pytest.mark.parametrize(
    "values, ends",
    [
        ([0.3, 40.0], (0.2, 50.0)),
        ([1.0, 1000.0], (1.0, 1000.0)),
        ([7.0], (5.0, 10.0)),
        ([2.0], (2.0, 20.0)),
        ([0.0, np.inf], (0.1, 1.0)),
    ],
)
def test_an_axis_ends_on_round_values_around_the_data(values, ends):
    axis = log_axis(values)
    assert (axis.low, axis.high) == pytest.approx(ends)


def test_every_axis_has_ticks_to_read():
    for low in 10.0 ** np.arange(-6, 6):
        for span in (2.0, 5.0, 10.0, 300.0, 1e9):
            places = [place for place, _ in LogAxis(low, low * span).ticks()]
            assert 2 <= len(places) <= 10
            assert places == sorted(places)
            assert -0.1 <= places[0] <= places[-1] <= 100.1


@pytest.mark.parametrize(
    "value, label", [(0.001, "0.001"), (0.5, "0.5"), (20.0, "20"), (5e3, "5k"), (1e6, "1M")]
)
def test_tick_labels(value, label):
    assert tick_label(value) == label


def test_the_staircase_goes_from_none_to_all():
    path = step_path(np.array([10.0, 1.0, 10.0, 100.0]), LogAxis(1.0, 100.0))
    assert path == f"M0 {BOX}H0V750H500V250H1000V0H{BOX}"


def test_dots_lie_at_the_costs_of_their_seed():
    path = cloud_path(np.array([1.0, 100.0, 1.0]), np.array([10.0, 1.0, 10.0]), LogAxis(1.0, 100.0))
    assert path == "M0 500h0M1000 1000h0"


def test_the_spread_is_the_percentiles():
    assert spread(np.arange(1.0, 101.0)) == (5.0, 25.0, 50.5, 75.0, 95.0)
