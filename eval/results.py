"""One file for each policy in a scenario, seed by seed: what the leaderboard is built from."""

from __future__ import annotations

import hashlib
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from visenvs.core.files import read_json, write_json, write_text
from visenvs.core.provenance import provenance

from .metrics import COST, Episodes

RESULTS = Path(__file__).resolve().parent / "results"


@dataclass(frozen=True)
class Result:
    """One policy in one scenario under one estimator, seed by seed.

    Attributes:
        env, scenario, estimator, perception: the task as flown.
        policy: as typed on the command line.
        label: its name in tables.
        summary: what it is, one line.
        information: what it is told: "belief", "raw", "truth" or "none".
        config: the environment's configuration, plain JSON types.
        units: metric name -> unit.
        us_per_decision: CPU time for one row in a batch, microseconds; None if none was timed.
        episodes: what happened on each seed.
    """

    env: str
    scenario: str
    estimator: str
    perception: str
    policy: str
    label: str
    summary: str
    information: str
    config: dict[str, Any]
    units: dict[str, str]
    us_per_decision: float | None
    episodes: Episodes


def meta(program: str, seeds: Sequence[int]) -> dict[str, Any]:
    """What made a file: versions, commit, date, command line and seeds."""
    span = {"first": int(seeds[0]), "last": int(seeds[-1]), "count": len(seeds)}
    return {**provenance(program), "seeds": span}


def replace_block(path: Path, name: str, block: str | None) -> None:
    """Replace a file's text between `<!-- name -->` and `<!-- /name -->`; None only checks."""
    text = path.read_text(encoding="utf-8")
    first, last = f"<!-- {name} -->", f"<!-- /{name} -->"
    if text.count(first) != 1 or text.count(last) != 1 or text.index(first) > text.index(last):
        raise ValueError(
            f"{path} needs one line `{first}` and, below it, one line `{last}`: "
            "add both where the table goes"
        )
    if block is not None:
        head, rest = text.split(first)
        write_text(path, f"{head}{first}\n{block}\n{last}{rest.split(last)[1]}")


def result_path(folder: Path, result: Result) -> Path:
    """Where `save` puts a result: task/scenario/estimator/policy.json, plain characters only."""
    env = result.env.rpartition("/")[2]
    loop = result.estimator if result.perception == "points" else f"{result.estimator}-images"
    return folder / env / result.scenario / loop / f"{_file_name(result.policy)}.json"


def save(result: Result, folder: Path, made: dict[str, Any]) -> Path:
    """Write one result with its per-seed values and `made` (from `meta`); returns the file."""
    path = result_path(folder, result)
    path.parent.mkdir(parents=True, exist_ok=True)
    fields = {name: value for name, value in vars(result).items() if name != "episodes"}
    seeds = {
        "seeds": result.episodes.seeds.tolist(),
        "outcomes": list(result.episodes.outcomes),
        "metrics": {name: values.tolist() for name, values in result.episodes.metrics.items()},
    }
    write_json(path, fields | seeds | {"meta": made})
    return path


def load(path: Path) -> Result:
    """Read what `save` wrote."""
    content = read_json(path)
    try:
        episodes = Episodes(
            seeds=np.array(content.pop("seeds"), np.int64),
            outcomes=tuple(content.pop("outcomes")),
            metrics={
                name: _numbers(name, values) for name, values in content.pop("metrics").items()
            },
        )
        content.pop("meta")
        return Result(**content, episodes=episodes)
    except (KeyError, TypeError, AttributeError) as error:
        raise ValueError(
            f"{path} is not a leaderboard result ({error}); delete it and run again"
        ) from error


def _numbers(name: str, values: list[float | None]) -> NDArray[np.float64]:
    missing = math.inf if name == COST else math.nan
    return np.array([missing if value is None else value for value in values], np.float64)


def _file_name(text: str) -> str:
    name = re.sub(r"[^A-Za-z0-9._-]+", "-", text).strip("-.")
    return name if name == text else f"{name}-{hashlib.sha256(text.encode()).hexdigest()[:8]}"
