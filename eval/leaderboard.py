"""`python -m eval.leaderboard`: laws and learned policies, flown on the same public seeds.

Every policy meets the same targets, noise and dropouts, so that differences are paired by seed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import Progress, track

from visenvs.core.cli import launch
from visenvs.core.files import check_writable, write_json, write_text
from visenvs.core.parallel import Workers, check
from visenvs.core.registry import environment_files

from . import clips, page, results, tables
from .board import Board, Row, make_board, missing_row, result_row
from .jobs import Job, Scene, fly, plan_scene
from .rollout import public_seeds, shards
from .summary import summary

PROGRAM = "eval.leaderboard"
BLOCK, SUMMARY = "leaderboard", "summary"  # the markers in Markdown files


@dataclass(frozen=True)
class Options(Workers):
    """What to fly, how often, and where to write it."""

    env: str | None = None
    """Gymnasium id; if not given, every environment in which all that is asked for can fly."""
    scenario: str | None = None
    """Named preset; the environment's first if not given."""
    policies: str | None = None
    """Names, model files or module:factory, separated by commas; the shipped ones if not given."""
    episodes: int | None = None
    """How many of the public seeds to fly, from the first on; what the environment says, 1000 or
    fewer where episodes are long, if not given."""
    estimator: str | None = None
    """Estimator of every policy; if not given, the scenario's, and the laws again on the truth."""
    perception: str | None = None
    """How pictures become measurements (points or images); the scenario's if not given."""
    reference: str | None = None
    """Policy that the others are compared with; each environment's own reference if not given."""
    json: Path | None = None
    """Write the rows here."""
    html: Path | None = None
    """Write a page with the table and plots here: one file that needs no network."""
    clips: bool = False
    """Put flights into the page, of the best policy and of the reference: their median and their
    worst episode. That makes it about 1 MB larger for each environment."""
    summary: Path | None = None
    """The same for <!-- summary --> with the best law and network of each environment."""
    markdown: Path | None = None
    """Replace the block between <!-- leaderboard --> and <!-- /leaderboard --> in this file."""
    trust: bool = False
    """Run code that comes with a model file. Only for files that you made yourself."""


def run(options: Options) -> None:
    """Fly guidance laws and learned policies on the same public seeds, and compare them."""
    if options.episodes is not None:
        public_seeds(options.episodes)
    check(options)
    names = None if options.policies is None else _split(options.policies)
    _check_outputs(options)
    scenes = _scenes(options, names)
    most = max(options.episodes or scene.task.episodes for scene in scenes)
    made = results.meta(PROGRAM, public_seeds(most))
    boards = make_boards(scenes, made, options)
    written = _write(options, boards, made)
    console = tables.screen()
    for board in boards:
        tables.show(board, console)
    for path in written:
        console.print(f"written: {path}", soft_wrap=True, highlight=False)


def _scenes(options: Options, names: Sequence[str] | None) -> list[Scene]:
    """The scenes asked for: without an environment, all in which everything asked for can fly."""
    asked = (options.scenario, options.estimator, names, options.reference)
    envs = [options.env] if options.env else list(environment_files())
    scenes: list[Scene] = []
    errors: list[ValueError] = []
    for env in envs:
        try:
            scene = plan_scene(env, *asked, options.trust, options.perception)
        except ValueError as error:
            errors.append(error)
            continue
        if (
            options.env
            or names is None
            or all(job.entry for job in scene.jobs if not job.told_truth)
        ):
            scenes.append(scene)
    if errors and (not scenes or not any((*asked, options.perception))):
        raise errors[0]
    if not scenes:
        raise ValueError(f"no environment can be flown by all of {options.policies}; write --env")
    return scenes


def make_boards(scenes: Sequence[Scene], made: dict[str, Any], options: Options) -> list[Board]:
    """Fly all scenes, keep one file for each policy, and build the boards from those files."""
    jobs = [job for scene in scenes for job in (*scene.jobs, *scene.asides.values())]
    screen = Console(stderr=True)
    with Progress(console=screen, transient=True, disable=not screen.is_terminal) as progress:
        able = {
            job: public_seeds(options.episodes or job.task.episodes)
            for job in jobs
            if job.entry is not None
        }
        bar = progress.add_task("flying", total=sum(len(shards(seeds)) for seeds in able.values()))

        def finished(job: Job) -> None:
            progress.update(bar, description=f"flying {job}", advance=1)

        files = fly(able, results.RESULTS, made, finished, options, options.trust)
        return [
            _board(scene, files)
            for scene in track(scenes, "statistics", console=screen, transient=True)
        ]


def _board(scene: Scene, files: dict[Job, Path]) -> Board:
    flown = {job: results.load(files[job]) for job in scene.jobs if job in files}
    reference = next(
        (result for result in flown.values() if result.policy == scene.reference), None
    )
    lines: list[tuple[Row, results.Result | None]] = []
    for job in scene.jobs:
        if job in flown:
            aside = scene.asides.get(job)
            beside = results.load(files[aside]) if aside in files else None
            lines.append((result_row(scene.task, flown[job], reference, beside), flown[job]))
        else:
            row = missing_row(
                scene.task.id, scene.scenario, job.estimator, job.perception, job.policy, job.reason
            )
            lines.append((row, None))
    return make_board(scene.task, scene.scenario, lines)


def _split(policies: str) -> list[str]:
    names = [name.strip() for name in policies.split(",")]
    if not all(names):
        raise ValueError(
            f"--policies expects names with single commas between them, got {policies!r}: "
            "write `--policies lq,osa`"
        )
    return names


def _check_outputs(options: Options) -> None:
    """Fail on outputs that cannot be written before the long work starts."""
    if options.clips and options.html is None:
        raise ValueError("--clips are part of a page; write --html page.html too")
    results.RESULTS.mkdir(parents=True, exist_ok=True)
    for path in (results.RESULTS / "trial.json", *_outputs(options)):
        if path is not None:
            check_writable(path)
    for name, path in (BLOCK, options.markdown), (SUMMARY, options.summary):
        if path is not None:
            results.replace_block(path, name, None)


def _outputs(options: Options) -> tuple[Path | None, ...]:
    return options.json, options.html, options.markdown, options.summary


def _write(options: Options, boards: Sequence[Board], made: dict[str, Any]) -> list[Path]:
    if options.json is not None:
        rows = [row for board in boards for row in board.rows]
        write_json(options.json, {"rows": rows, "meta": made})
    if options.html is not None:
        films = clips.clips(boards, options.trust) if options.clips else ()
        write_text(options.html, page.render(boards, made, films))
    if options.markdown is not None:
        block = "\n\n".join(tables.markdown(board, made) for board in boards)
        results.replace_block(options.markdown, BLOCK, block)
    if options.summary is not None:
        results.replace_block(options.summary, SUMMARY, summary(boards))
    return [path for path in _outputs(options) if path is not None]


if __name__ == "__main__":
    launch(PROGRAM, Options, run)
