"""Moving pictures for the page: a policy's median and its worst episode, flown once more."""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from importlib import import_module

import numpy as np
from rich.console import Console
from rich.progress import track

from agents import registry
from visenvs.core.config import Config, field_types, override

from .board import Board, Row, is_reference
from .film import FILM
from .results import Result
from .rollout import decide


@dataclass(frozen=True)
class Clip:
    """One episode.

    Attributes:
        label: of the policy.
        kind: "median" or "worst" by its cost among the seeds of the policy.
        seed, cost, outcome: of the episode; the cost in the task's unit, SI.
        source: a data URI of an animated WebP.
    """

    label: str
    kind: str
    seed: int
    cost: float
    outcome: str
    source: str


def clips(boards: Sequence[Board], trust: bool) -> list[list[Clip]]:
    """For each board the clips of its best policy and of its reference."""
    screen = Console(stderr=True)
    flights = [(i, *line) for i, board in enumerate(boards) for line in shown(board)]
    out: list[list[Clip]] = [[] for _ in boards]
    for i, row, result in track(flights, "drawing", console=screen, transient=True):
        out[i] += _clips(boards[i], row, result, trust)
    return out


def shown(board: Board) -> list[tuple[Row, Result]]:
    """The first row of a board, and the reference's where that is another; none without pictures.

    Rows of policies that see nothing are no flights to look at.
    """
    lines = [
        (row, result)
        for row, result in zip(board.rows, board.results, strict=True)
        if result is not None and row["information"] != "none"
    ]
    if not board.task.picture:
        return []
    return lines[:1] + [line for line in lines[1:] if is_reference(line[0])]


def _clips(board: Board, row: Row, result: Result, trust: bool) -> list[Clip]:
    film, task = import_module(FILM), board.task
    entry = registry.load(result.policy, task, _config(board, result), trust)
    episodes = result.episodes
    order = np.argsort(episodes.cost, kind="stable")
    out: list[Clip] = []
    for kind, i in ("median", order[(len(order) - 1) // 2]), ("worst", order[-1]):
        seed = int(episodes.seeds[i])
        records = film.fly(partial(decide, entry.policy), task, entry.config, seed)
        data = b64encode(film.clip(records, task, entry.config)).decode("ascii")
        cost, source = float(episodes.cost[i]), f"data:image/webp;base64,{data}"
        out.append(Clip(row["label"], kind, seed, cost, episodes.outcomes[i], source))
    return out


def _config(board: Board, result: Result) -> Config:
    """What was flown, from the words that the result keeps."""
    config = board.task.scenarios[board.scenario]
    known = field_types(type(config))
    asked = {"estimator": result.estimator, "perception": result.perception}
    return override(config, {name: value for name, value in asked.items() if name in known})
