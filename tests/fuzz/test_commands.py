"""Whatever is typed after a command, it ends with an exit code and a word, never a traceback."""

from __future__ import annotations

import math

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from eval import film, leaderboard, results
from visenvs.core.cli import launch

TYPED = st.text(st.characters(exclude_characters="/\0", exclude_categories=["Cs"]), max_size=12)
VALUES = TYPED | st.sampled_from(["visenvs/Tracking2D-v0", "lq", "random", "-1", "nan", "1e999"])
LEADERBOARD = ("scenario", "episodes", "estimator", "perception", "reference", "json", "workers")
FILM = ("scenario", "estimator", "seed", "speed", "at")
NUMBERS = st.floats().map(repr)  # from 5e-324 to 1.8e308, nan and inf


def typed(names):
    return st.dictionaries(st.sampled_from(names), VALUES | NUMBERS, max_size=3).map(
        lambda given: [f"--{name}={value}" for name, value in given.items()]
    )


def written(out, records, task, config, speed, at):
    """What of `film.write` a speed can break, without drawing."""
    assert 1.0 <= 1000 * vars(config)["dt"] / speed <= 655_350 or speed > 1
    assert math.isfinite(speed / vars(config)["dt"])


@pytest.fixture
def command(monkeypatch, tmp_path, capsys):
    """Run a program on words: its exit code; code 1 is one line."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(results, "RESULTS", tmp_path / "results")
    monkeypatch.setattr(leaderboard, "make_boards", lambda *_: [])  # nobody flies
    monkeypatch.setattr(film.import_module(film.FILM), "fly", lambda *_: [])
    monkeypatch.setattr(film.import_module(film.FILM), "write", written)

    def command(program, words):
        monkeypatch.setattr("sys.argv", [program.PROGRAM, *words])
        with pytest.raises(SystemExit) as left:
            launch(program.PROGRAM, program.Options, program.run)
        told = capsys.readouterr()
        assert left.value.code in (0, 1, 2)
        assert (left.value.code == 0) == (told.err == "")
        if left.value.code == 1:
            assert told.err.startswith("error: ") and told.err.count("\n") == 1
        return left.value.code

    return command


FUZZ = settings(max_examples=50, suppress_health_check=[HealthCheck.function_scoped_fixture])


@FUZZ
@given(words=typed(LEADERBOARD), policies=VALUES)
def test_leaderboard(command, words, policies):
    command(leaderboard, ["--env=visenvs/Tracking2D-v0", f"--policies={policies}", *words])


@FUZZ
@given(words=typed(FILM), env=VALUES, policy=VALUES, out=TYPED)
def test_film(command, words, env, policy, out):
    command(film, [f"--env={env}", f"--policy={policy}", f"--out={out}.png", *words])


@FUZZ
@given(words=st.lists(TYPED, max_size=4))
@pytest.mark.parametrize("program", [leaderboard, film])
def test_words_that_are_no_options(command, program, words):
    assert command(program, ["--env", "no", *words]) != 0


def test_what_is_right_ends_well(command):
    assert command(leaderboard, ["--env=visenvs/Tracking2D-v0", "--policies=lq"]) == 0
