from __future__ import annotations

import io
from base64 import b64decode

import numpy as np
import pytest
from PIL import Image

from eval import leaderboard, results
from eval.board import make_board, result_row
from eval.clips import clips, shown
from eval.leaderboard import Options
from tests.eval.test_page import a_result
from visenvs.core.cli import guarded
from visenvs.core.registry import load_task
from visenvs.render import film

TASK = load_task("visenvs/Rendezvous-v0")
COSTS = np.array([3.0, 1.0, np.inf, 2.0, 5.0])


def a_board(*costs_by_policy):
    costs = dict(costs_by_policy)
    flown = [
        a_result(name, cost, "none" if name == "zero" else "belief") for name, cost in costs.items()
    ]
    lines = [(result_row(TASK, result, flown[0]), result) for result in flown]
    return make_board(TASK, "random", lines)


def test_the_best_and_the_reference_are_shown_and_nobody_blind():
    costs = np.array([3.0, 1.0, 4.0])
    board = a_board(("lq", costs), ("osa", costs / 2), ("pn", costs / 1.5), ("zero", costs / 9))
    assert [row["policy"] for row, _ in shown(board)] == ["osa", "lq"]
    assert [row["policy"] for row, _ in shown(a_board(("lq", costs)))] == ["lq"]


def test_the_median_and_the_worst_episode_are_flown_once_more(monkeypatch):
    monkeypatch.setattr(film, "SHOTS", 4)
    ((median, worst),) = clips([a_board(("lq", COSTS))], trust=False)
    assert (median.kind, median.seed, median.cost) == ("median", 100_000, 3.0)
    assert (worst.kind, worst.seed, worst.cost) == ("worst", 100_002, np.inf)
    prefix = "data:image/webp;base64,"
    assert worst.source.startswith(prefix)
    picture = Image.open(io.BytesIO(b64decode(worst.source.removeprefix(prefix))))
    assert (picture.n_frames, picture.width) == (4, film.CLIP_WIDTH)


def test_a_page_with_clips_holds_them(tmp_path, monkeypatch):
    monkeypatch.setattr(results, "RESULTS", tmp_path / "results")
    monkeypatch.setattr(film, "SHOTS", 3)
    page = tmp_path / "page.html"
    options = Options(env=TASK.id, policies="lq,osa", episodes=3, html=page, clips=True)
    assert guarded(lambda: leaderboard.run(options)) == 0
    assert page.read_text(encoding="utf-8").count("data:image/webp") in (2, 4)


def test_clips_without_a_page_are_refused(capsys):
    options = Options(env=TASK.id, policies="lq", episodes=1, clips=True)
    assert guarded(lambda: leaderboard.run(options)) == 1
    assert "--html" in capsys.readouterr().err


@pytest.mark.parametrize("name", ["rendezvou", ""])
def test_an_unknown_picture_is_one_line(name, tmp_path, capsys):
    from eval import gallery

    assert guarded(lambda: gallery.run(gallery.Options(tmp_path, (name,)))) == 1
    assert "unknown picture" in capsys.readouterr().err


def test_every_environment_has_a_moving_picture():
    from eval.gallery import DOCS, FLIGHTS
    from visenvs.core.registry import environment_files

    assert {flight.env for flight in FLIGHTS.values()} == set(environment_files())
    assert all((DOCS / f"{name}.webp").exists() for name in FLIGHTS)
