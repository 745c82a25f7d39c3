"""Figure 7 of the IARC paper: how many robots are goaled, removed and left after ten minutes.

The paper says that 24.5 % of its 1000 runs succeeded, and shows histograms. It does not say what a
robot that heads for the goal line is, nor whether a bump restarts the robots' 20 s clock, nor how
long a landing takes. Read here: the robot nearest to the goal line among those with cos(heading) <=
-threshold is blocked; perfect information; landings from 2 m at 1 m/s; four obstacles. Both
readings of the clock are flown: under `restart` the figure is in reach, under `firmware`, which is
the official robots', all robots reverse together and the rule turns back those that were about to
turn. Contacts are by geometry, which tests hold against pymunk's.

`index` shows what the rule leaves: the index of services, with perfect information and with the
camera, in the official mission (from 3 m, and from 2 m) and in the paper's. Its bands are lower
ends of what an independent simulator gave. They are meant for 100 flights or more, and more than
300 are not flown. With the camera in the paper's mission that simulator had 0.68 and 7.0 robots,
which our tracks do not reach: reported only.
"""

from __future__ import annotations

import math
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from agents.registry import load
from visenvs.core.config import override
from visenvs.core.registry import load_task

from ..rollout import PUBLIC_SEEDS, rollout
from . import Row, standard_error

CASE = "iarc-fig7"
EPISODES = 1000  # bands are some standard errors wide then
PAPER = 0.245
THRESHOLDS = (0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6)
COUNTS = ("goaled", "removed", "remained")
CHUNK = 250  # seeds at once
INDEX_FLIGHTS = 300  # at most
# scenario, what differs, least share of successes, least mean of robots goaled
Flown = tuple[str, dict[str, Any], float | None, float | None]
INDEX: dict[str, Flown] = {
    "paper/truth": ("paper", {"estimator": "truth"}, 0.936, 8.2),
    "firmware/truth": ("firmware", {"estimator": "truth"}, 0.99, 9.7),
    "paper-3m/camera": ("paper", {"estimator": "camera", "cruise": 3.0}, None, None),
    "firmware/camera": ("firmware", {"estimator": "camera"}, 0.68, 7.0),
    "firmware-hard/camera": ("firmware-hard", {"estimator": "camera"}, 0.31, 5.6),
}


@cache
def fly(law: str, restart: int, episodes: int) -> NDArray[Any]:
    """Final lane records of a law under a reading of the clock, on the first public seeds."""
    changes = {"estimator": "truth", "bump_restarts_timer": restart}
    return missions(law, "paper", changes, episodes)


def missions(law: str, scenario: str, changes: dict[str, Any], episodes: int) -> NDArray[Any]:
    """Final lane records of a law in a changed scenario, on the first public seeds."""
    task = load_task("visenvs/Herding-v0")
    config = override(task.scenarios[scenario], {"arena": "kinematic", **changes})
    policy = load(law, task, config).policy
    parts = [PUBLIC_SEEDS[i : min(i + CHUNK, episodes)] for i in range(0, episodes, CHUNK)]
    return np.concatenate([rollout(policy, task, config, part).records for part in parts])


def success(records: NDArray[Any]) -> NDArray[np.bool_]:
    """Which runs brought seven robots over the goal line."""
    return records["goaled"] >= 7


def wilson(share: float, n: int) -> tuple[float, float]:
    """95 % interval of a share (Wilson 1927)."""
    z = 1.96
    middle = (share + z * z / (2 * n)) / (1 + z * z / n)
    half = z / (1 + z * z / n) * math.sqrt(share * (1 - share) / n + z * z / (4 * n * n))
    return middle - half, middle + half


def row(name: str, values: NDArray[Any], paper: float | None = None, **band: float | None) -> Row:
    """The mean of a figure of every run."""
    ours = values.astype(float)
    return Row(f"{CASE}/{name}", paper, float(ours.mean()), standard_error(ours), len(ours), **band)


def rows(episodes: int) -> list[Row]:
    """P(>= 7 goaled) and mean counts: doing nothing, and the rule over thresholds and clocks."""
    idle = fly("zero", 0, episodes)
    out = [row("nothing/success", success(idle), high=0.005)]
    out += [row(f"nothing/{count}", idle[count]) for count in COUNTS]
    covering = 0
    for threshold in THRESHOLDS:
        flown = fly(f"paper-rule-{threshold:g}", 1, episodes)
        at = f"restart/threshold=-{threshold:g}"
        low, high = wilson(float(success(flown).mean()), episodes)
        covering += low <= PAPER <= high
        out.append(row(f"{at}/success", success(flown), PAPER, low=0.11, high=0.42))
        out += [row(f"{at}/{count}", flown[count]) for count in COUNTS]
    out.append(
        Row(f"{CASE}/restart/thresholds_covering", None, covering, 0.0, len(THRESHOLDS), low=1)
    )
    for threshold in THRESHOLDS:
        flown = fly(f"paper-rule-{threshold:g}", 0, episodes)
        at = f"firmware/threshold=-{threshold:g}"
        out.append(row(f"{at}/success", success(flown), PAPER, high=0.02))
        out.append(row(f"{at}/goaled", flown["goaled"]))
    return out + index_rows(min(episodes, INDEX_FLIGHTS))


def index_rows(episodes: int) -> list[Row]:
    """P(>= 7 goaled), P(all ten), mean count and median time of the seventh, of the index."""
    out: list[Row] = []
    for name, (scenario, changes, least, robots) in INDEX.items():
        found, at = missions("index", scenario, changes, episodes), f"index/{name}"
        out.append(row(f"{at}/success", success(found), low=least))
        out.append(row(f"{at}/all_ten", found["goaled"] == 10))
        out.append(row(f"{at}/goaled", found["goaled"], low=robots))
        seventh, error = found["t_success"], standard_error(found["t_success"], np.median)
        middle = float(np.median(seventh))
        out.append(Row(f"{CASE}/{at}/seventh_s_median", None, middle, error, episodes))
    return out


def plot(folder: Path, episodes: int) -> Path:
    """The paper's histograms under both readings, and success over the threshold."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(12, 7), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots(2, 3)
    for line, (name, restart) in enumerate((("restart", 1), ("firmware", 0))):
        records = fly("paper-rule-0.4", restart, episodes)
        for panel, count in zip(axes[:, line], ("goaled", "removed"), strict=True):
            share = np.bincount(records[count].astype(int), minlength=11) / len(records)
            panel.bar(range(11), share, color=f"C{line}")
            panel.set(xlabel=count, ylabel="share of runs", title=f"{name}, threshold -0.4")
        rates = [success(fly(f"paper-rule-{t:g}", restart, episodes)).mean() for t in THRESHOLDS]
        axes[0, 2].plot([-t for t in THRESHOLDS], rates, f"C{line}.-", label=name)
    axes[0, 2].axhline(PAPER, color="k", ls="--", label="paper")
    axes[0, 2].set(xlabel="threshold of cos(heading)", ylabel="share of runs with 7 goaled")
    axes[0, 2].legend()
    left = fly("paper-rule-0.4", 1, episodes)["remained"].astype(int)
    axes[1, 2].bar(range(11), np.bincount(left, minlength=11) / len(left), color="C0")
    axes[1, 2].set(xlabel="remained", ylabel="share of runs", title="restart, threshold -0.4")
    file = folder / f"{CASE}.png"
    figure.savefig(file, dpi=110)
    return file
