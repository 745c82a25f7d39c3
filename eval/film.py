"""Film: `python -m eval.film` flies one seed and writes a video or a picture of it."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.progress import track

from agents import registry
from agents.policy import Policy
from visenvs.core.cli import launch
from visenvs.core.config import Config, override, pick
from visenvs.core.files import check_writable, replacing
from visenvs.core.lanes import Lanes, Task
from visenvs.core.registry import load_task

from .rollout import PUBLIC_SEEDS, decide

PROGRAM = "eval.film"
SUFFIXES = (".gif", ".mp4", ".png")
FPS = 25.0  # at most so many pictures a second; a faster film leaves steps out
HOLD = 1.5  # how long a video rests on the end of the episode, s
COLOURS = 255  # in a GIF, which keeps one of its 256 for "as before"
CRF = 20  # H.264's constant rate factor: lower is finer

Frame = NDArray[np.uint8]


@dataclass(frozen=True)
class Options:
    """What to fly and where to write it."""

    env: str
    """Gymnasium id."""
    policy: str
    """Name, model file or module:factory."""
    out: Path
    """File to write: .gif or .mp4 for the whole episode, .png for one moment of it."""
    scenario: str | None = None
    """Named preset; the environment's first if not given."""
    estimator: str | None = None
    """Estimator in the loop; the scenario's if not given."""
    seed: int = PUBLIC_SEEDS[0]
    """Which episode."""
    speed: float = 1.0
    """How many times faster than real time a video runs."""
    at: float | None = None
    """Moment of a .png in seconds from the start; the end if not given."""
    trust: bool = False
    """Run code that comes with a model file. Only for files that you made yourself."""


class Film:
    """The pictures of one episode, each drawn when it is asked for.

    Args:
        records: lane records of the episode from its start to its end, as of `fly`.
        task, config: what was flown.
        steps: which records are shown.
    """

    def __init__(
        self, records: NDArray[Any], task: Task, config: Config, steps: Sequence[int]
    ) -> None:
        module, _, function = task.picture.partition(":")
        self._draw = getattr(import_module(module), function)
        self._records, self._task, self._config = records, task, config
        self._steps = steps

    def __len__(self) -> int:
        return len(self._steps)

    def __getitem__(self, index: int) -> Frame:
        step = self._steps[index]
        return self._draw(self._records[step], self._config, self._task, trail=self._records[:step])


def run(options: Options) -> None:
    """Fly a policy on one seed and write a video (.gif, .mp4) or a picture (.png) of it."""
    _check(options)
    task = load_task(options.env)
    if not task.picture:
        raise ValueError(f"{task.id} has no pictures to film")
    config = pick("scenario", options.scenario or next(iter(task.scenarios)), task.scenarios)
    if options.estimator is not None:
        config = override(config, {"estimator": options.estimator})
    entry = registry.load(options.policy, task, config, options.trust)
    records = fly(entry.policy, task, entry.config, options.seed)
    last, dt = len(records) - 1, vars(config)["dt"]
    with replacing(options.out) as path:
        if path.suffix == ".png":
            moment = last if options.at is None else min(round(options.at / dt), last)
            write_png(path, Film(records, task, config, [moment])[0])
        else:
            fps = options.speed / dt
            stride = math.ceil(fps / FPS)
            film = Film(records, task, config, [*range(0, last, stride), last])
            write = write_gif if path.suffix == ".gif" else write_mp4
            write(path, film, fps / stride)
    Console().print(f"written: {options.out}", soft_wrap=True, highlight=False)


def fly(policy: Policy, task: Task, config: Config, seed: int) -> NDArray[Any]:
    """Lane records of one episode from start to end, (steps + 1,), or (steps + 1, n) of a team."""
    lanes = Lanes(task, config, task.team(config))
    lanes.reset([seed])
    records, state, start = [lanes.snapshot()], None, np.ones(lanes.count, bool)
    while not lanes.over[0]:
        actions, state = decide(policy, lanes.rows, state, start)
        lanes.step(actions)
        records.append(lanes.snapshot())
        start = np.zeros(lanes.count, bool)
    return np.concatenate(records) if lanes.team == 1 else np.stack(records)


def write_gif(path: Path, film: Film, fps: float) -> None:
    """Write a GIF that repeats for ever, with one palette, so that still parts stay still."""
    from PIL import Image

    samples = [film[i] for i in {0, len(film) // 4, len(film) // 2, len(film) - 1}]
    sheet = Image.fromarray(np.vstack(samples))
    palette = sheet.quantize(COLOURS, Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE)

    def reduced(frame: Frame) -> Image.Image:
        return Image.fromarray(frame).quantize(palette=palette, dither=Image.Dither.NONE)

    rest = (reduced(film[i]) for i in _watched(range(1, len(film))))
    durations = [round(1000 / fps)] * (len(film) - 1) + [round(1000 * HOLD)]
    reduced(film[0]).save(
        path, format="GIF", save_all=True, append_images=rest, duration=durations, loop=0
    )


def write_mp4(path: Path, film: Film, fps: float) -> None:
    """Write an H.264 video."""
    try:
        from imageio_ffmpeg import get_ffmpeg_exe, write_frames

        get_ffmpeg_exe()
    except (ImportError, RuntimeError) as error:
        raise ImportError(
            'an .mp4 needs imageio-ffmpeg: write `pip install "visenvs[video]"`, or `--out` a .gif'
        ) from error
    height, width = film[0].shape[:2]
    settings: dict[str, Any] = {
        "fps": fps,
        "codec": "libx264",
        "quality": None,
        "macro_block_size": 2,
        "ffmpeg_log_level": "error",
        "output_params": ["-crf", str(CRF), "-movflags", "+faststart"],
    }
    writer = write_frames(str(path), (width, height), **settings)
    writer.send(None)
    try:
        steps = [*range(len(film)), *[len(film) - 1] * round(HOLD * fps)]
        for i in _watched(steps):
            writer.send(film[i].tobytes())
    finally:
        writer.close()


def write_png(path: Path, frame: Frame) -> None:
    """Write one picture."""
    from PIL import Image

    Image.fromarray(frame).save(path, format="PNG", optimize=True)


def _check(options: Options) -> None:
    if options.out.suffix not in SUFFIXES:
        raise ValueError(
            f"--out must end in {', '.join(SUFFIXES)}, got {str(options.out)!r}: "
            "write for example `--out flight.gif`"
        )
    if not 0.0 < options.speed < math.inf:
        raise ValueError(f"--speed must be above 0 and finite, got {options.speed}")
    if options.at is not None and (options.out.suffix != ".png" or not options.at >= 0):
        raise ValueError(f"--at is the moment of a .png, 0 s or later, got {options.at}")
    check_writable(options.out)


def _watched(steps: Sequence[int]) -> Iterator[int]:
    return iter(track(steps, "drawing", console=Console(stderr=True), transient=True))


if __name__ == "__main__":
    launch(PROGRAM, Options, run)
