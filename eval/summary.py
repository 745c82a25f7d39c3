"""The leaderboard in one short table: for each environment its best law and its best network."""

from __future__ import annotations

from collections.abc import Sequence

from agents.registry import BLIND
from visenvs.core.registry import find_law

from .board import TRUTH, Board, Row
from .columns import figure, interval, pretty, share
from .metrics import COST
from .results import Result
from .stats import compare

HEAD = (
    "| environment | best law | J [95 %] | success | best learned | J [95 %] | success "
    "| ΔJ to that law [95 %] |"
)
Line = tuple[Row, Result]


def summary(boards: Sequence[Board]) -> str:
    """Markdown table of all boards; policies told the truth do not count."""
    lines = [HEAD, "|---|---|---:|---:|---|---:|---:|---:|"]
    return "\n".join([*lines, *(_line(board) for board in boards)])


def _line(board: Board) -> str:
    flown: list[Line] = [
        (row, result)
        for row, result in zip(board.rows, board.results, strict=True)
        if result is not None and row["estimator"] != TRUTH and row["policy"] not in BLIND
    ]
    law = next((line for line in flown if find_law(line[0]["policy"]) is not None), None)
    learned = next((line for line in flown if find_law(line[0]["policy"]) is None), None)
    unit = pretty(board.task.metrics.get(COST, ""))
    name = f"`{board.task.id.removeprefix('visenvs/')}` {board.scenario}"
    cells = [f"{name} ({unit})" if unit else name, *_policy(law), *_policy(learned)]
    return f"| {' | '.join([*cells, _difference(learned, law)])} |"


def _policy(line: Line | None) -> tuple[str, str, str]:
    if line is None:
        return "-", "", ""
    row = line[0]
    cost = f"{figure(row['cost_mean'])} {interval(row['cost_ci'])}".strip()
    return f"`{row['label']}`", cost, share(row["success_rate"])


def _difference(learned: Line | None, law: Line | None) -> str:
    if learned is None or law is None:
        return ""
    found = compare(learned[1].episodes.cost, law[1].episodes.cost)
    return f"{figure(found.mean)} {interval(found.interval)}".strip()
