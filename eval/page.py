"""The leaderboard as a page: one self-contained HTML file with the table and plots."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import jinja2

from .board import TRUTH, Board, Row, is_reference
from .clips import Clip
from .columns import Column, columns_of, figure, interval, pretty, share, verdict
from .metrics import COST
from .plots import LogAxis, cloud_path, log_axis, spread, step_path
from .results import Result

TEMPLATE = Path(__file__).with_suffix(".html.j2")
HUES = 8  # in the template; the ninth policy begins again
TONES = {-1: "good", 1: "bad"}
Line = tuple[Row, Result]
Styles = dict[str, str]  # policy -> class in the template


def render(
    boards: Sequence[Board], made: dict[str, Any], clips: Sequence[Sequence[Clip]] = ()
) -> str:
    """The whole page.

    Args:
        boards: one for each scenario.
        made: versions, commit, seeds, date and command, from `results.meta`.
        clips: for each board the flights to show, from `clips.clips`; none if left out.
    """
    environment = jinja2.Environment(
        autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    template = environment.from_string(TEMPLATE.read_text(encoding="utf-8"))
    shown = clips or [()] * len(boards)
    sections = [_section(*pair) for pair in zip(boards, shown, strict=True)]
    words = {column.title: column.help for board in boards for column in columns_of(board)}
    kinds = {
        name: sorted({row[name] for section in sections for row in section["rows"]} - {""})
        for name in ("information", "perception")
    }
    return template.render(sections=sections, words=words, made=made, kinds=kinds)


def _section(board: Board, clips: Sequence[Clip]) -> dict[str, Any]:
    every = list(zip(board.rows, board.results, strict=True))
    lines = [(row, result) for row, result in every if result is not None]
    styles, columns = _styles(board), columns_of(board)
    seeing = [line for line in lines if line[0]["information"] != "none"]
    reference = next((line for line in lines if is_reference(line[0])), None)
    return {
        "env": board.task.id,
        "scenario": board.scenario,
        "summary": board.task.summary,
        "episodes": max((len(result.episodes.seeds) for _, result in lines), default=0),
        "unit": pretty(board.task.metrics.get(COST, "")),
        "reference": reference and reference[0]["label"],
        "cards": _cards([row for row, _ in lines]),
        "headings": [(column.heading(board.task.metrics), column.help) for column in columns],
        "rows": [_table_row(columns[1:], row, result, styles) for row, result in every],
        "reasons": [row for row in board.rows if row["reason"] is not None],
        "bars": _bars(lines, styles),
        "curves": _curves(seeing, styles),
        "clouds": _clouds(seeing, reference, styles),
        "config": lines[0][1].config if lines else {},
        "costs": {row["label"]: _costs(result) for row, result in lines},
        "clips": [vars(clip) | {"cost": figure(clip.cost)} for clip in clips],
    }


def _costs(result: Result) -> list[float | None]:
    """Cost of every seed to five figures, for comparisons on the page; None for infinity."""
    costs = result.episodes.cost.tolist()
    return [float(f"{cost:.5g}") if math.isfinite(cost) else None for cost in costs]


def _kind(row: Row) -> dict[str, str]:
    """What the page filters by."""
    return {"information": row["information"] or "", "perception": row["perception"] or ""}


def _styles(board: Board) -> Styles:
    """A hue for each policy that sees anything, the same on the estimate and on the truth."""
    seeing = [row["policy"] for row in board.rows if row["information"] not in (None, "none")]
    return {policy: f"c{i % HUES}" for i, policy in enumerate(dict.fromkeys(seeing))}


def _style(row: Row, styles: Styles) -> str:
    return styles.get(row["policy"], "blind") + (" told" if _is_told(row) else "")


def _is_told(row: Row) -> bool:
    return row["estimator"] == TRUTH


def _table_row(
    columns: Sequence[Column], row: Row, result: Result | None, styles: Styles
) -> dict[str, Any]:
    cells: list[dict[str, Any]] = []
    for column in columns:
        main, _, bounds = column.cell(row).partition(" [")
        tone = TONES.get(verdict(row), "") if column.key == "diff_mean" else ""
        cell = {"main": main, "bounds": bounds and f"[{bounds}", "tone": tone}
        cells.append(cell | {"value": _sortable(row.get(column.key)), "key": column.key})
    return _kind(row) | {
        "label": row["label"],
        "summary": result.summary if result else row["reason"],
        "style": _style(row, styles),
        "told": _is_told(row),
        "cells": cells,
    }


def _sortable(value: str | float | None) -> str:
    """What the page sorts by: a number as JavaScript reads it, a word, or nothing."""
    if value is None or value != value:
        return ""
    return str(value).replace("inf", "Infinity") if isinstance(value, float) else str(value)


def _cards(rows: Sequence[Row]) -> list[dict[str, str]]:
    """Figures that sum the table up: the best policy, its gain, the price of estimation."""
    if not rows:
        return []
    best = rows[0]
    name = best["label"]
    cards = [_card("lowest mean cost", figure(best["cost_mean"]), name, interval(best["cost_ci"]))]
    if best["diff_to"] and not is_reference(best):
        seeds = f"cheaper on {share(best['prob_improvement'])} of seeds"
        gain = f"{name} against {best['diff_to']}"
        cards.append(_card(gain, figure(best["diff_mean"]), interval(best["diff_ci"]), seeds))
    episodes = f"{best['episodes']} episodes"
    cards.append(_card("success", share(best["success_rate"]), name, episodes))
    told = next((row for row in rows if _is_told(row)), best)
    if told is not best:
        cost = figure(told["cost_mean"])
        cards.append(_card("cheapest law told the truth", cost, told["label"]))
    return cards


def _card(title: str, value: str, *notes: str) -> dict[str, str]:
    return {"title": title, "value": value, "note": ", ".join(note for note in notes if note)}


def _bars(lines: Sequence[Line], styles: Styles) -> dict[str, Any]:
    """The interval plot: spread, quartiles and median of the cost, and its mean with interval."""
    spreads = [spread(result.episodes.cost) for _, result in lines]
    means = [value for row, _ in lines for value in (row["cost_mean"], *(row["cost_ci"] or ()))]
    axis = log_axis([*means, *(value for five in spreads for value in five)])
    bars = [_bar(row, five, axis, styles) for (row, _), five in zip(lines, spreads, strict=True)]
    return {"ticks": axis.ticks(), "rows": bars}


def _bar(row: Row, five: tuple[float, ...], axis: LogAxis, styles: Styles) -> dict[str, Any]:
    low, lower, median, upper, high = (float(axis.at(value)) for value in five)
    ends = None if row["cost_ci"] is None else [float(axis.at(end)) for end in row["cost_ci"]]
    texts = [figure(value) for value in five]
    tip = (
        f"mean {figure(row['cost_mean'])} {interval(row['cost_ci'])}, median {texts[2]}, "
        f"middle half {texts[1]} to {texts[3]}, 5th to 95th percentile {texts[0]} to {texts[4]}"
    )
    return _kind(row) | {
        "label": row["label"],
        "style": _style(row, styles),
        "spread": (low, high - low),
        "middle": (lower, upper - lower),
        "median": median,
        "mean": float(axis.at(row["cost_mean"])),
        "interval": ends and (ends[0], ends[1] - ends[0]),
        "text": figure(row["cost_mean"]),
        "tip": tip,
    }


def _curves(lines: Sequence[Line], styles: Styles) -> dict[str, Any]:
    """Share of episodes against cost, a curve for each policy."""
    axis = _shared_axis(lines)
    paths = [
        _kind(row)
        | {
            "label": row["label"],
            "style": _style(row, styles),
            "path": step_path(result.episodes.cost, axis),
        }
        for row, result in lines
    ]
    return {"ticks": axis.ticks(), "paths": paths}


def _clouds(lines: Sequence[Line], reference: Line | None, styles: Styles) -> dict[str, Any]:
    """Cost against the reference's on the same seed, a panel for each policy."""
    shown = [line for line in lines if not is_reference(line[0])]
    if reference is None:
        return {"ticks": [], "panels": []}
    axis = _shared_axis([reference, *shown])
    across = reference[1].episodes.cost
    panels = [
        _kind(row)
        | {
            "label": row["label"],
            "style": _style(row, styles),
            "better": share(row["prob_improvement"]),
            "path": cloud_path(across, result.episodes.cost, axis),
        }
        for row, result in shown
    ]
    return {"ticks": axis.ticks(), "panels": panels}


def _shared_axis(lines: Sequence[Line]) -> LogAxis:
    return log_axis(cost for _, result in lines for cost in result.episodes.cost.tolist())
