"""Throughput as ratios measured in one run: `python -m eval.benchmark`; docs/benchmark.md says how."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from rich.console import Console
from rich.table import Column, Table

from visenvs.core.cli import launch
from visenvs.core.config import pick
from visenvs.core.files import check_writable, write_json
from visenvs.core.provenance import provenance

from .benchmarks import Budget, Row, groups

PROGRAM = "eval.benchmark"
PIPED = 120  # columns where the output is not a terminal


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
    """Measure the chosen groups one after the other, print and write their rows."""
    known = groups()
    chosen = {name: pick("group", name, known) for name in options.only or known}
    if options.json is not None:
        check_writable(options.json)
    progress = Console(stderr=True)
    rows: dict[str, list[Row]] = {}
    seen: set[str] = set()
    for name, group in chosen.items():
        progress.print(f"measuring {name}", highlight=False)
        rows[name] = [row for row in group.rows(budget) if row.id not in seen]
        seen |= {row.id for row in rows[name]}
    console = Console()
    if not console.is_terminal:
        console = Console(width=PIPED)
    console.print(table(rows))
    for name, group in chosen.items():
        console.print(f"{name} wants {group.WANTS}", highlight=False)
    if options.json is not None:
        content = [asdict(row) for group in rows.values() for row in group]
        write_json(options.json, {"rows": content, "meta": provenance(PROGRAM)})


def table(groups: dict[str, list[Row]]) -> Table:
    """All rows, group by group."""
    right = [Column(name, justify="right", no_wrap=True) for name in ("value", "ratio")]
    out = Table(Column("figure", no_wrap=True), right[0], "unit", "compared with", right[1])
    for rows in groups.values():
        _add(out, rows)
        out.add_section()
    return out


def _add(out: Table, rows: Sequence[Row]) -> None:
    for row in rows:
        value = f"{float(f'{row.value:.3g}'):,.0f}"
        ratio = "" if row.ratio is None else f"{row.ratio:.3g}"
        out.add_row(row.id, value, row.unit, row.reference or "", ratio)


if __name__ == "__main__":
    launch(PROGRAM, Options, run)
