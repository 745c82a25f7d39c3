"""Throughput as ratios measured in one run: `python -m eval.benchmark` (docs/benchmark.md)."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path

from rich.console import Console
from rich.table import Column, Table

from visenvs.core.cli import launch
from visenvs.core.config import pick
from visenvs.core.files import check_writable, write_json

from .benchmarks import SEEDS, Budget, Row, groups
from .results import meta
from .tables import screen

PROGRAM = "eval.benchmark"


@dataclass(frozen=True)
class Options:
    """What to measure."""

    only: tuple[str, ...] = ()
    """groups by name; all if none is named"""
    json: Path | None = None
    """where to write the rows"""


def run(options: Options) -> None:
    """Measure throughput in CPU time, as ratios between sides that take turns in one run."""
    measure(options, Budget())


def measure(options: Options, budget: Budget) -> None:
    """Measure the chosen groups one after the other, print and write their rows.

    A row that an earlier group has measured, with its own reference, is not repeated.
    """
    known = groups()
    asked = {name: pick("group", name, known) for name in options.only or known}
    chosen = {name: group for name, group in known.items() if name in asked}
    if options.json is not None:
        check_writable(options.json)
    progress = Console(stderr=True)
    rows: dict[str, list[Row]] = {}
    seen: set[str] = set()
    for name, group in chosen.items():
        progress.print(f"measuring {name}", highlight=False)
        rows[name] = [row for row in group.rows(budget) if row.id not in seen]
        seen |= {row.id for row in rows[name]}
    console = screen()
    console.print(table(rows))
    for name, group in chosen.items():
        console.print(f"{name} wants: {group.WANTS}", highlight=False, soft_wrap=True)
    if options.json is not None:
        content = [asdict(row) for group in rows.values() for row in group]
        write_json(options.json, {"rows": content, "meta": meta(PROGRAM, SEEDS)})


def table(groups: dict[str, list[Row]]) -> Table:
    """All rows, group by group."""
    value, ratio = (Column(name, justify="right", no_wrap=True) for name in ("value", "ratio"))
    out = Table(Column("figure", no_wrap=True), value, "unit", "compared with", ratio)
    for rows in groups.values():
        for row in rows:
            times = "" if row.ratio is None else f"{row.ratio:.2f}"
            out.add_row(row.id, _rounded(row.value), row.unit, row.reference or "", times)
        out.add_section()
    return out


def _rounded(value: float) -> str:
    """Three digits that count, the rest zeros."""
    rounded = float(f"{value:.3g}")
    return f"{rounded:,.0f}" if abs(rounded) >= 100 else f"{rounded:g}"


if __name__ == "__main__":
    launch(PROGRAM, Options, run)
