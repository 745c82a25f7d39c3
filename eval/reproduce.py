"""The papers' figures beside ours: `python -m eval.reproduce --help`."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Any

import tyro
from rich.console import Console
from rich.progress import track
from rich.table import Column, Table

from visenvs.core.cli import launch
from visenvs.core.config import pick
from visenvs.core.files import check_writable, write_json
from visenvs.core.parallel import Workers, check, completed

from . import tables
from .cases import Row, cases
from .results import meta
from .rollout import public_seeds

PROGRAM = "eval.reproduce"
EPISODES = 100  # of a case that does not say otherwise


@dataclass(frozen=True)
class Options(Workers):
    """What to reproduce."""

    cases: Annotated[tuple[str, ...], tyro.conf.Positional] = ()
    """tables and figures by name; all if none is named"""
    episodes: int | None = None
    """episodes for each figure that has chance in it, on the first public seeds; 100, or what the
    case needs to tell inside a band from outside, if not given"""
    images: bool = False
    """add the rows of cases that are also flown on rendered pictures"""
    json: Path | None = None
    """where to write the rows, after each case that is done"""
    plots: Path | None = None
    """folder for the pictures of the cases that have one"""


def main(options: Options) -> None:
    """Print the papers' figures beside ours, with standard errors and a verdict."""
    if options.episodes is not None:
        public_seeds(options.episodes)
    check(options)
    if options.json is not None:
        check_writable(options.json)
    if options.plots is not None:
        check_writable(options.plots / "any")
    known = cases()
    chosen = list(dict.fromkeys(options.cases or known))
    for name in chosen:
        pick("case", name, known)
    if options.images and not any(hasattr(known[name], "image_rows") for name in chosen):
        raise ValueError(f"--images: none of {', '.join(chosen)} is flown on rendered pictures")
    needed = [options.episodes or getattr(known[name], "EPISODES", EPISODES) for name in chosen]
    seeds = public_seeds(max(needed))
    calls = [
        (name, episodes, options.plots, options.images)
        for name, episodes in zip(chosen, needed, strict=True)
    ]
    made = meta(PROGRAM, seeds)  # before a file of this checkout is written
    done = completed(fly, calls, options)
    found: dict[int, list[Row]] = {}
    screen = Console(stderr=True)
    for index, (rows, picture) in track(done, "flying", len(calls), transient=True, console=screen):
        found[index] = rows
        if options.json is not None:
            keep(options.json, found, made)
        if picture is not None:
            print(f"written: {picture}")
    rows = [row for index in range(len(calls)) for row in found[index]]
    tables.screen().print(table(rows))
    outside = [row.id for row in rows if row.ok is False]
    if outside:
        raise ValueError(f"outside the accepted band: {', '.join(outside)}")


def keep(path: Path, found: dict[int, list[Row]], made: dict[str, Any]) -> None:
    """Write the rows of the cases that are done; a run that is broken off leaves those."""
    rows = [row for _, some in sorted(found.items()) for row in some]
    write_json(path, {"rows": [{**asdict(row), "ok": row.ok} for row in rows], "meta": made})


def fly(
    name: str, episodes: int, plots: Path | None, images: bool = False
) -> tuple[list[Row], Path | None]:
    """The rows of a case, those on rendered pictures too, and its plot if there is a folder."""
    case = cases()[name]
    rows = list(case.rows(episodes))
    if images and hasattr(case, "image_rows"):
        rows += case.image_rows(episodes)
    drawn = plots is not None and hasattr(case, "plot")
    return rows, case.plot(plots, episodes) if drawn else None


def table(rows: list[Row]) -> Table:
    """Paper against ours."""
    out = Table(
        Column("figure", no_wrap=True, overflow="fold"),
        "paper",
        "ours",
        "s.e.",
        "n",
        "accepted",
        "verdict",
    )
    for row in rows:
        band = "" if row.ok is None else f"{_number(row.low, '-inf')} to {_number(row.high, 'inf')}"
        verdict = {True: "[green]ok", False: "[red]outside", None: "reported"}[row.ok]
        error = _number(row.se) if row.se else ""
        out.add_row(row.id, _number(row.paper), _number(row.ours), error, str(row.n), band, verdict)
    return out


def _number(value: float | None, absent: str = "") -> str:
    return absent if value is None else f"{value:.4g}"


if __name__ == "__main__":
    launch(PROGRAM, Options, main)
