"""The columns of the leaderboard and how their numbers are written, for every kind of table."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from .board import FAR, TAIL, Board, Row, far_end, is_reference
from .metrics import COST, MISS

NOTHING = "-"


def figure(value: float | None) -> str:
    """A number to three significant figures, as people read it: 65,200, 405, 8.51, 0.00013."""
    if value is None or math.isnan(value):
        return NOTHING
    if math.isinf(value):
        return "∞" if value > 0 else "-∞"
    rounded = float(f"{value:.3g}")
    size = abs(rounded)
    if size == 0.0:
        return "0"
    if size >= 1e7 or size < 1e-2:
        return f"{value:.2g}"
    if size >= 100:
        return f"{rounded:,.0f}"
    return f"{rounded:.{2 - math.floor(math.log10(size))}f}"


def share(value: float | None) -> str:
    """A share in percent."""
    return NOTHING if value is None else f"{100.0 * value:.1f} %"


def interval(bounds: Sequence[float] | None) -> str:
    """`[low, high]`, or nothing."""
    return "" if bounds is None else f"[{figure(bounds[0])}, {figure(bounds[1])}]"


@dataclass(frozen=True)
class Column:
    """One column.

    Attributes:
        title: heading, short.
        key: of the row; what is sorted by.
        help: what it is, one sentence.
        metric: whose unit it has, or "". That of the costs stands once beside the table.
        write: row -> text.
        short: whether the short table (README) has it.
    """

    title: str
    key: str
    help: str
    metric: str
    write: Callable[[Row], str]
    short: bool

    def cell(self, row: Row) -> str:
        """Text of a row's cell; `n/a` beside the name of a policy that cannot fly here."""
        return "n/a" if row["reason"] is not None and self is not POLICY else self.write(row)

    def heading(self, units: Mapping[str, str], gap: str = " ") -> str:
        """Title, and the unit unless it is that of the costs."""
        unit = "" if self.metric == COST else pretty(units.get(self.metric, ""))
        return f"{self.title}{gap}({unit})" if unit else self.title


def pretty(unit: str) -> str:
    """A unit with raised powers: m^2/s^3 becomes m²/s³."""
    return unit.replace("^2", "²").replace("^3", "³")


def verdict(row: Row) -> int:
    """-1 where the difference's interval lies below 0 (better), 1 above, 0 where it holds 0."""
    low, high = row["diff_ci"] or (0.0, 0.0)
    return -1 if high < 0 else int(low > 0)


def _column(
    title: str,
    key: str,
    help: str,
    metric: str = "",
    write: Callable[[float | None], str] = figure,
    short: bool = False,
) -> Column:
    """A column that writes the one number at `key`."""
    return Column(title, key, help, metric, lambda row: write(row[key]), short)


def _with_interval(key: str, bounds: str) -> Callable[[Row], str]:
    return lambda row: f"{figure(row[key])} {interval(row[bounds])}".strip()


def _unless_reference(text: str, write: Callable[[Row], str]) -> Callable[[Row], str]:
    return lambda row: text if is_reference(row) else write(row)


POLICY = Column(
    "policy",
    "label",
    "A guidance law or a learned policy; (truth): the truth stands in for the estimate.",
    metric="",
    write=lambda row: row["label"],
    short=True,
)
COLUMNS = (
    Column(
        "sees",
        "information",
        "What the policy is told: the filter's belief, raw measurements, the truth, or nothing.",
        metric="",
        write=lambda row: row["information"],
        short=True,
    ),
    Column(
        "J mean [95 %]",
        "cost_mean",
        "Mean of the task's published cost, with its bootstrap interval. Lower is better.",
        metric=COST,
        write=_with_interval("cost_mean", "cost_ci"),
        short=True,
    ),
    _column("median", "cost_median", "Half of the episodes cost less.", COST, short=True),
    _column("IQM", "cost_iqm", "Interquartile mean: mean cost of the middle half.", COST),
    _column(
        f"p{TAIL:.0f}",
        "cost_p95",
        f"{TAIL:.0f} % of the episodes cost no more: the tail.",
        COST,
        short=True,
    ),
    _column("success", "success_rate", "Share of episodes with success.", write=share, short=True),
    _column("failures", "failure_rate", "Share of episodes with any other end.", write=share),
    _column("miss", "miss_mean", "Mean error of the position at the end.", MISS, short=True),
    _column("Jc", "effort_mean", "Mean cost of control, a part of J.", COST),
    _column(
        "NEES",
        "nees_mean",
        "Normalised estimation error squared, mean over time and episodes; for a consistent "
        "filter it is the number of estimated states.",
    ),
    Column(
        "ΔJ [95 %]",
        "diff_mean",
        "Mean difference to the reference law on the same seeds. Negative is better.",
        metric=COST,
        write=_unless_reference("reference", _with_interval("diff_mean", "diff_ci")),
        short=True,
    ),
    Column(
        "better on",
        "prob_improvement",
        "Share of seeds on which it costs less than the reference, ties counted half: the "
        "probability of improvement, paired.",
        metric="",
        write=_unless_reference("", lambda row: share(row["prob_improvement"])),
        short=True,
    ),
    _column("µs", "us_per_decision", "CPU time for one decision in a large batch, microseconds."),
)


def columns_of(board: Board) -> tuple[Column, ...]:
    """The policy, the usual columns, and those that the task asks for."""
    extra: list[Column] = []
    limit = board.task.lost_above
    if math.isfinite(limit):
        help = "Share of episodes that cost more than this: the heavy tail."
        extra.append(_column(f"J > {figure(limit)}", "lost_rate", help, write=share))
    if any(row["aside_mean"] is not None for row in board.rows):
        help = (
            f"Mean cost of the laws in the scenario {board.task.aside}, for comparison with its "
            "paper. It ranks nobody: who remembers its one target has no need to look."
        )
        extra.append(_column(f"J in {board.task.aside}", "aside_mean", help, COST))
    for name in board.task.shown:
        words = name.removesuffix("_mean").replace("_", " ")
        tail = f"Its {FAR:.0f}th percentile over the episodes."
        extra += [
            _column(words, name, f"Mean {words}, over time and episodes.", name),
            _column(f"its p{FAR:.0f}", far_end(name), tail, name),
        ]
    return (POLICY, *COLUMNS, *extra)
