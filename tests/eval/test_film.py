from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image, ImageSequence

from agents.registry import load
from eval.film import SPEEDS, Options, run
from visenvs.core.cli import guarded
from visenvs.core.files import replacing
from visenvs.core.registry import load_task
from visenvs.render import film
from visenvs.render.rendezvous import draw

ENV = "visenvs/Rendezvous-v0"
TASK = load_task(ENV)
CONFIG = TASK.scenarios["random"]
FAST = 50.0  # every 20th of 200 steps, at 25 pictures a second


@pytest.fixture(scope="module")
def records():
    return film.fly(load("lq", TASK, CONFIG).policy.predict, TASK, CONFIG, 5)


def test_an_episode_is_kept_from_its_start_to_its_end(records):
    assert records["step"].tolist() == list(range(201))
    assert (records["seed"] == 5).all()
    assert (records["outcome"][:-1] == 0).all() and records["outcome"][-1] != 0


def test_a_png_is_the_picture_of_its_moment(tmp_path, records):
    run(Options(ENV, "lq", tmp_path / "a.png", seed=5, at=7.3))
    expected = draw(records[73], CONFIG, TASK, records[:73])
    np.testing.assert_array_equal(np.asarray(Image.open(tmp_path / "a.png")), expected)


def test_a_gif_runs_through_the_episode_and_rests_on_its_end(tmp_path, records):
    run(Options(ENV, "lq", tmp_path / "a.gif", seed=5, speed=FAST))
    with Image.open(tmp_path / "a.gif") as gif:
        frames = [
            (frame.info["duration"], np.asarray(frame.convert("RGB"), int))
            for frame in ImageSequence.Iterator(gif)
        ]
    assert [duration for duration, _ in frames] == [40] * 10 + [1500]
    for step, (_, frame) in zip(range(0, 201, 20), frames, strict=True):
        difference = np.abs(frame - draw(records[step], CONFIG, TASK, records[:step])).max(axis=2)
        assert np.mean(difference > 16) < 0.003  # what the common palette rounds off


def test_an_mp4_runs_through_the_episode_and_rests_on_its_end(tmp_path):
    ffmpeg = pytest.importorskip("imageio_ffmpeg", reason="needs the extra `video`")
    run(Options(ENV, "lq", tmp_path / "a.mp4", seed=5, speed=FAST))
    frames, seconds = ffmpeg.count_frames_and_secs(str(tmp_path / "a.mp4"))
    assert frames == 11 + round(film.HOLD * film.FPS)
    assert seconds == pytest.approx(frames / film.FPS, abs=0.05)


def test_the_estimator_can_be_the_truth(tmp_path):
    run(Options(ENV, "lq", tmp_path / "a.png", seed=5, at=0.0, estimator="truth"))
    run(Options(ENV, "lq", tmp_path / "b.png", seed=5, at=0.0))
    assert (tmp_path / "a.png").read_bytes() != (tmp_path / "b.png").read_bytes()


@pytest.mark.parametrize(
    ("wrong", "told"),
    [
        ({"env": "visenvs/Rendezvou-v0"}, "did you mean 'visenvs/Rendezvous-v0'"),
        ({"policy": "osaa"}, "did you mean 'osa'"),
        ({"scenario": "thesi"}, "did you mean 'thesis'"),
        ({"estimator": "ukf"}, "estimator"),
        ({"out": Path("a.avi")}, ".gif, .mp4, .png"),
        ({"out": Path("no/such/folder/a.gif")}, "no folder"),
        ({"seed": -1}, "seed"),
        ({"speed": 0.0}, "--speed must lie in [0.01, 1e+06], got 0"),
        ({"speed": 1e-9}, "got 1e-09"),
        ({"speed": 1e308}, "got 1e+308"),
        ({"speed": float("nan")}, "got nan"),
        ({"at": 1.0}, "--at"),
        ({"policy": "tests_no_such_module:make"}, "tests_no_such_module"),
    ],
)
def test_a_mistake_is_one_line_and_leaves_no_file(tmp_path, monkeypatch, capsys, wrong, told):
    monkeypatch.chdir(tmp_path)
    options = Options(**{"env": ENV, "policy": "lq", "out": Path("a.gif"), **wrong})
    assert guarded(lambda: run(options)) == 1
    error = capsys.readouterr().err
    assert told in error and error.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("speed", SPEEDS)
def test_the_slowest_and_the_fastest_film_can_be_written(tmp_path, speed):
    """Of the task with the longest steps, whose pictures rest longest."""
    task = load_task("visenvs/BearingsOnly-v0")
    config = next(iter(task.scenarios.values()))
    records = film.fly(load("zero", task, config).policy.predict, task, config, 5)[:8]
    film.write(tmp_path / "a.gif", records, task, config, speed)
    with Image.open(tmp_path / "a.gif") as gif:
        first = next(ImageSequence.Iterator(gif)).info["duration"]
    assert first == pytest.approx(1000 * config.dt / speed if speed < 1 else 40, rel=0.05)


def test_a_policy_that_fails_is_one_line_and_leaves_no_file(tmp_path, monkeypatch, capsys):
    (tmp_path / "broken.py").write_text("def make(task, config):\n    return object()\n")
    monkeypatch.syspath_prepend(tmp_path)
    out = tmp_path / "films"
    out.mkdir()
    assert guarded(lambda: run(Options(ENV, "broken:make", out / "a.gif"))) == 1
    assert "predict" in capsys.readouterr().err
    assert list(out.iterdir()) == []


def test_without_ffmpeg_the_error_says_what_to_install(tmp_path, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    assert guarded(lambda: run(Options(ENV, "lq", tmp_path / "a.mp4"))) == 1
    assert 'pip install "visenvs[video]"' in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("error", [KeyboardInterrupt, OSError])
def test_a_film_cut_short_leaves_the_older_file(tmp_path, error):
    target = tmp_path / "a.gif"
    target.write_bytes(b"older")
    with pytest.raises(error), replacing(target) as path:
        path.write_bytes(b"half")
        raise error
    assert target.read_bytes() == b"older"
    assert list(tmp_path.iterdir()) == [target]
