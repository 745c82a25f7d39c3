"""Command lines end with an exit code and, when something is wrong, one line."""

import subprocess
import sys
from dataclasses import dataclass

import pytest
import tyro

from visenvs.core.cli import launch


@dataclass(frozen=True)
class Options:
    count: int = 1


def leave(monkeypatch, run, *words):
    """Exit code of a program started with these words."""
    monkeypatch.setattr(sys, "argv", ["toy", *words])
    with pytest.raises(SystemExit) as end:
        launch("eval.toy", Options, run)
    return end.value.code


def raising(error):
    def fail(*_args, **_kwargs):
        raise error

    return fail


def test_the_options_reach_the_program(monkeypatch):
    seen = []
    assert leave(monkeypatch, seen.append, "--count", "3") == 0
    assert leave(monkeypatch, seen.append) == 0
    assert seen == [Options(3), Options()]


@pytest.mark.parametrize(
    "error, code, told",
    [
        (ValueError("two\n lines"), 1, "error: two lines\n"),
        (FileNotFoundError("no a.gif"), 1, "error: no a.gif\n"),
        (ImportError("no rich"), 1, "error: no rich\n"),
        (KeyboardInterrupt(), 130, "interrupted\n"),
        (KeyboardInterrupt("3 of 5 done"), 130, "interrupted: 3 of 5 done\n"),
    ],
)
def test_what_a_user_can_mend_is_one_line(monkeypatch, capsys, error, code, told):
    assert leave(monkeypatch, raising(error)) == code
    assert capsys.readouterr().err == told


def test_a_mistake_of_ours_keeps_its_traceback(monkeypatch):
    monkeypatch.setattr(sys, "argv", ["toy"])
    with pytest.raises(ZeroDivisionError):
        launch("eval.toy", Options, raising(ZeroDivisionError()))


@pytest.mark.parametrize("word, code", [("--help", 0), ("--cuont", 2)])
def test_nothing_runs_on_help_or_on_an_unknown_option(monkeypatch, capsys, word, code):
    assert leave(monkeypatch, raising(AssertionError()), word) == code
    out, err = capsys.readouterr()
    assert "python -m eval.toy" in out + err and "--count" in out + err


def test_ctrl_c_while_the_options_are_read_is_one_line(monkeypatch, capsys):
    monkeypatch.setattr(tyro, "cli", raising(KeyboardInterrupt()))
    assert leave(monkeypatch, raising(AssertionError())) == 130
    assert capsys.readouterr().err == "interrupted\n"


@pytest.mark.parametrize("asked, threads", [(None, 1), ("2", 2)])
def test_pictures_are_drawn_by_one_thread_unless_asked(monkeypatch, asked, threads):
    monkeypatch.delenv("OPENCV_FOR_THREADS_NUM", raising=False)
    if asked:
        monkeypatch.setenv("OPENCV_FOR_THREADS_NUM", asked)
    code = (
        "from dataclasses import make_dataclass\nfrom visenvs.core.cli import launch\n"
        "def run(options):\n    import cv2\n    print(cv2.getNumThreads())\n"
        "launch('toy', make_dataclass('Options', []), run)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert int(done.stdout) == threads


def test_a_missing_option_reader_is_one_line(monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "tyro", None)
    assert leave(monkeypatch, raising(AssertionError())) == 1
    assert "tyro" in capsys.readouterr().err
