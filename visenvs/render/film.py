"""Films and pictures of one episode."""

from __future__ import annotations

import io
import math
from collections.abc import Callable, Iterator, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from visenvs.core.config import Config
from visenvs.core.files import replacing
from visenvs.core.lanes import Lanes, Task

SUFFIXES = (".gif", ".mp4", ".png")
FPS = 25.0  # at most so many pictures a second; a faster film leaves steps out
HOLD = 1.5  # how long a video rests on the end of the episode, s
COLOURS = 255  # in a GIF, which keeps one of its 256 for "as before"
CRF = 20  # H.264's constant rate factor: lower is finer
SHOTS, SHOT = 60, 0.1  # pictures of a clip, and how long each is shown, s
CLIP_WIDTH, CLIP_QUALITY = 480, 60  # pixels; WebP's quality of 100

Frame = NDArray[np.uint8]


def fly(
    predict: Callable[..., tuple[Any, Any]], task: Task, config: Config, seed: int
) -> NDArray[Any]:
    """Lane records of one episode from start to end, (steps + 1,), or (steps + 1, n) of a team.

    Args:
        predict: of a policy: observations, memory and which rows begin, to actions and memory.
        task, config: what is flown.
        seed: which episode.
    """
    lanes = Lanes(task, config, task.team(config))
    lanes.reset([seed])
    records, state, start = [lanes.snapshot()], None, np.ones(lanes.count, bool)
    while not lanes.over[0]:
        actions, state = predict(lanes.rows, state, start)
        lanes.step(np.asarray(actions))
        records.append(lanes.snapshot())
        start = np.zeros(lanes.count, bool)
    return np.concatenate(records) if lanes.team == 1 else np.stack(records)


def write(
    path: Path,
    records: NDArray[Any],
    task: Task,
    config: Config,
    speed: float = 1.0,
    at: float | None = None,
) -> None:
    """Write a video of an episode, or a picture of one moment, whole or not at all.

    Args:
        path: .gif or .mp4 for the whole episode, .png for one moment.
        records: of the episode, from `fly`.
        task, config: what was flown.
        speed: how many times faster than real time a video runs.
        at: moment of a .png, s; the end if None.
    """
    if not task.picture:
        raise ValueError(f"{task.id} has no pictures to film")
    last, dt = len(records) - 1, vars(config)["dt"]
    with replacing(path) as temporary:
        if path.suffix == ".png":
            moment = last if at is None else min(round(at / dt), last)
            write_png(temporary, Film(records, task, config, [moment])[0])
        else:
            fps = speed / dt
            stride = math.ceil(fps / FPS)
            film = Film(records, task, config, [*range(0, last, stride), last])
            (write_gif if path.suffix == ".gif" else write_mp4)(temporary, film, fps / stride)


def check_suffix(path: Path) -> None:
    """A ValueError for a file that is no film."""
    if path.suffix not in SUFFIXES:
        raise ValueError(
            f"a film's name must end in {', '.join(SUFFIXES)}, got {str(path)!r}: "
            "write for example `flight.gif`"
        )


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


def clip(records: NDArray[Any], task: Task, config: Config) -> bytes:
    """A small moving picture of a whole episode in six seconds, an animated WebP of about 200 kB.

    Args:
        records: of the episode, from `fly`.
        task, config: what was flown.
    """
    from PIL import Image

    last = len(records) - 1
    steps = sorted({round(k * last / (SHOTS - 1)) for k in range(SHOTS)})
    film = Film(records, task, config, steps)
    height, width = film[0].shape[:2]
    size = CLIP_WIDTH, round(CLIP_WIDTH * height / width)

    def reduced(frame: Frame) -> Image.Image:
        return Image.fromarray(frame).resize(size, Image.Resampling.BOX)

    out = io.BytesIO()
    reduced(film[0]).save(
        out,
        format="WEBP",
        save_all=True,
        append_images=(reduced(film[i]) for i in range(1, len(film))),
        duration=[round(1000 * SHOT)] * (len(film) - 1) + [round(1000 * HOLD)],
        loop=0,
        quality=CLIP_QUALITY,
    )
    return out.getvalue()


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


def _watched(steps: Sequence[int]) -> Iterator[int]:
    from rich.console import Console
    from rich.progress import track

    return iter(track(steps, "drawing", console=Console(stderr=True), transient=True))
