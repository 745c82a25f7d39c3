"""The leaderboard as text: the terminal's table, and Markdown."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from .board import Board, Row
from .columns import COLUMNS, POLICY, Column, columns_of, pretty, verdict
from .metrics import COST

GAP = 2  # characters between columns
COLOURS = {-1: "green", 1: "red"}
PIPED = 220  # columns where the output is not a terminal


def screen() -> Console:
    """Where tables are printed: as wide as they like unless it is a terminal."""
    console = Console()
    return console if console.is_terminal else Console(width=PIPED)


def show(board: Board, console: Console) -> None:
    """Print a board, in several parts where the terminal is narrow."""
    episodes = max(row["episodes"] for row in board.rows)
    what = f"[bold]{escape(board.task.id)}[/]  {escape(board.scenario)}, {episodes} episodes"
    console.print(f"\n{what}  [dim]{escape(board.task.summary)}{_unit(board)}[/]\n")
    for part in _parts(board, console.width):
        console.print(_table(board, part), "")
    for row in board.rows:
        if row["reason"] is not None:
            console.print(f"[dim]n/a: {escape(row['label'])}: {escape(row['reason'])}[/]")


def markdown(board: Board, made: dict[str, Any]) -> str:
    """A board as a Markdown table with a line that says what it is."""
    columns = [column for column in columns_of(board) if column.short]
    lines = [
        _markdown_line([column.heading(board.task.metrics) for column in columns]),
        "|---|---|" + "---:|" * (len(columns) - 2),
        *(_markdown_line([column.cell(row) for column in columns]) for row in board.rows),
    ]
    first, count = made["seeds"]["first"], max(row["episodes"] or 0 for row in board.rows)
    flown = f"`{board.task.id}`, scenario `{board.scenario}`, seeds {first} to {first + count - 1}"
    reference = next((row["diff_to"] for row in board.rows if row["diff_to"]), None)
    against = f"; ΔJ and better on: against {reference}, seed by seed" if reference else ""
    return "\n".join([*lines, "", f"{flown}{against}{_unit(board)}."])


def _unit(board: Board) -> str:
    unit = pretty(board.task.metrics.get(COST, ""))
    return f"; J, Jc and ΔJ in {unit}" if unit else ""


def _parts(board: Board, width: int) -> list[list[Column]]:
    """The columns in as few parts as fit the width, in their order, the policy before each part."""
    parts: list[list[Column]] = []
    left = 0
    for column in columns_of(board)[1:]:
        needed = _width(column, board) + GAP
        if not parts or needed > left:
            parts.append([])
            left = width - _width(POLICY, board)
        parts[-1].append(column)
        left -= needed
    return parts


def _width(column: Column, board: Board) -> int:
    heading = column.heading(board.task.metrics, "\n").split("\n")
    return max(len(text) for text in (*heading, *(column.cell(row) for row in board.rows)))


def _table(board: Board, columns: Sequence[Column]) -> Table:
    table = Table(box=SIMPLE_HEAD, header_style="bold", padding=(0, GAP - 1, 0, 0), pad_edge=False)
    table.show_edge = False
    for column in (POLICY, *columns):
        justify = "left" if column is POLICY or column is COLUMNS[0] else "right"
        table.add_column(column.heading(board.task.metrics, "\n"), justify=justify, no_wrap=True)
    for above, row in zip((board.rows[0], *board.rows), board.rows, strict=False):
        if row["estimator"] != above["estimator"]:
            table.add_section()
        table.add_row(*(_coloured(column, row) for column in (POLICY, *columns)))
    return table


def _coloured(column: Column, row: Row) -> str:
    text = escape(column.cell(row))
    colour = COLOURS.get(verdict(row)) if column.key == "diff_mean" else None
    return f"[{colour}]{text}[/]" if colour else text


def _markdown_line(cells: Sequence[str]) -> str:
    return "| " + " | ".join(text.replace("|", "\\|") for text in cells) + " |"
