"""What the cases of formation flight share: flights, recorded logs, filters replayed on a log.

All figures are in feet, as in the papers; none of them prints a number for these.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from agents.registry import load
from visenvs.core.compile import kernel
from visenvs.core.config import Config, override, to_record
from visenvs.core.lanes import Lanes, Task
from visenvs.core.outcome import SUCCESS
from visenvs.core.registry import load_task
from visenvs.core.units import FOOT
from visenvs.estimation import formation as filters
from visenvs.estimation.ekf import factorise, pack_lower, whiten

from ..rollout import PUBLIC_SEEDS, rollout
from . import Row, standard_error

Values = NDArray[np.float64]
AXES = "XYZ"
LAW = "follow"
SCORED = 200  # steps, 20 s, until estimates are scored

LOG = np.dtype([
    ("outcome", "i8"), ("seen", "f8"), ("heading", "f8"), ("size_told", "f8"), ("range_told", "f8"),
    ("r_V_N", "f8", 3), ("v_V_N", "f8", 3), ("push", "f8", (filters.SUBSTEPS, 3)),
    ("sight", filters.SIGHT), ("leader", filters.LEADER),
    ("rhat_LV_F", "f8", 3), ("vhat_LV_F", "f8", 3), ("ahat_L_F", "f8", 3), ("bhat", "f8"),
])  # fmt: skip
REPLAY = np.dtype([
    ("flies", "f8"), ("e", "f8", 6),  # error of position and velocity in N
    ("nees", "f8"), ("b", "f8"), ("a", "f8", 3),
])  # fmt: skip


def scene(scenario: str, **changes: Any) -> tuple[Task, Config]:
    """A scenario with some settings changed."""
    task = load_task("visenvs/Formation-v0")
    return task, override(task.scenarios[scenario], changes)


@cache
def fly(scenario: str, episodes: int, **changes: Any) -> NDArray[Any]:
    """Final lane records of the first public seeds under the law `follow`."""
    task, config = scene(scenario, **changes)
    return rollout(load(LAW, task, config).policy, task, config, PUBLIC_SEEDS[:episodes]).records


@cache
def record(scenario: str, episodes: int, wave: float = 0.0, **changes: Any) -> NDArray[Any]:
    """The log of whole flights under `follow`, one LOG record per step and seed, (steps + 1, n).

    Args:
        scenario, changes: as of `scene`.
        episodes: flights, on the first public seeds.
        wave: amplitude of a lateral sine of 0.25 rad/s beside the commanded offset, m.
    """
    task, config = scene(scenario, **changes)
    policy = load(LAW, task, config).policy
    lanes = Lanes(task, config, episodes)
    lanes.reset(PUBLIC_SEEDS[:episodes])
    settings: Any = config
    log = np.zeros((round(settings.t_f / settings.dt) + 1, episodes), LOG)
    for k, entry in enumerate(log):
        for name in LOG.names or ():
            entry[name] = lanes.records[name]
        if lanes.done.all():
            return log[: k + 1]
        row = task.observation.unpack(lanes.rows)
        row["offset_F"][:, 1] += wave * np.sin(0.25 * k * settings.dt)
        actions, _ = policy.predict(task.observation.pack(row))
        lanes.step(np.asarray(actions, np.float32))
    raise RuntimeError("a flight did not end at its end")


@kernel
def replay_all(log, config, out):
    """Run the configured filter over every flight of a log (steps, n)."""
    cfg, factor, error = config[0], np.zeros(21), np.zeros(6)
    work, belief = np.zeros(1, filters.SCRATCH), np.zeros(1, filters.BELIEF)
    for i in range(log.shape[1]):
        track = np.zeros(1, filters.TRACK)
        for k in range(log.shape[0]):
            own = log[k, i]
            if own["outcome"] != 0 and k > 0 and log[k - 1, i]["outcome"] != 0:
                break
            if k == 0:
                filters.begin(track[0], own, own["sight"], cfg, work[0])
            else:
                filters.predict(track[0], own, cfg, work[0])
                if own["seen"] > 0.0:
                    filters.update(track[0], own, own["sight"], belief[0], cfg, work[0])
            filters.describe(track[0], own, own["leader"], belief[0], cfg, work[0])
            entry, b = out[k, i], belief[0]
            for j in range(3):
                entry["e"][j] = b["r_LV_N"][j] - own["leader"]["r_N"][j] + own["r_V_N"][j]
                entry["e"][3 + j] = b["v_LV_N"][j] - own["leader"]["v_N"][j] + own["v_V_N"][j]
                entry["a"][j] = b["a_L_N"][j]
            pack_lower(b["C"], factor)
            factorise(factor, 6)
            entry["nees"] = whiten(factor, entry["e"], error)
            entry["b"], entry["flies"] = b["b"], 1.0


def replay(log: NDArray[Any], config: Config) -> NDArray[Any]:
    """REPLAY records of the configuration's filter over a log, (steps, n)."""
    out = np.zeros(log.shape, REPLAY)
    replay_all(log, to_record(config), out)
    return out


def in_heading(log: NDArray[Any], vectors: Values) -> Values:
    """Vectors in N, (steps, n, 3), in each follower's heading frame."""
    c, s = np.cos(log["heading"]), np.sin(log["heading"])
    x, y, z = np.moveaxis(vectors, -1, 0)
    return np.stack([c * x + s * y, c * y - s * x, z], axis=-1)


def errors(log: NDArray[Any]) -> Values:
    """Error of the estimated relative position that was flown on, in F, ft, (steps, n, 3)."""
    true = in_heading(log, log["leader"]["r_N"] - log["r_V_N"])
    return (log["rhat_LV_F"] - true) / FOOT


def root_mean(values: Values, axis: int = 0) -> Values:
    """Square root of the mean."""
    return np.sqrt(values.mean(axis=axis))


def kept(records: NDArray[Any]) -> NDArray[Any]:
    """Those flights that kept their leader to the end."""
    return records[records["outcome"] == SUCCESS]


def figure(
    at: str,
    values: Values,
    statistic: Callable[..., Values] = np.mean,
    low: float | None = None,
    high: float | None = None,
) -> Row:
    """A figure of one value per flight; NaN where there is none."""
    if not len(values):
        return Row(at, None, float("nan"), 0.0, 0, low, high)
    ours, error = float(statistic(values, axis=0)), standard_error(values, statistic)
    return Row(at, None, ours, error, len(values), low, high)


def rmse_rows(
    at: str, records: NDArray[Any], most: tuple[float | None, ...] = (None, None, None)
) -> list[Row]:
    """RMSE of position and velocity in F over the kept flights, ft and ft/s."""
    flown, out = kept(records), []
    for i, (axis, high) in enumerate(zip(AXES, most, strict=True)):
        squares = flown["square_r"][:, i] / FOOT**2
        out.append(figure(f"{at}/{axis}_ft", squares, root_mean, high=high))
    for i, axis in enumerate(AXES):
        squares = flown["square_v"][:, i] / FOOT**2
        out.append(figure(f"{at}/V{axis}_ft_s", squares, root_mean))
    return out


def lost_row(
    at: str, records: NDArray[Any], low: float | None = None, high: float | None = None
) -> Row:
    """Share of flights that did not keep their leader."""
    return figure(f"{at}/lost", (records["outcome"] != SUCCESS).astype(float), np.mean, low, high)


def circling_rows(case: str, a_lat: float, most: tuple[float, ...], episodes: int) -> list[Row]:
    """A circling leader: with everything, with each part left out, and with other camera models.

    Args:
        case: scenario, and first part of the rows' names.
        a_lat: what the filter's lateral acceleration must converge to, ft/s^2.
        most: largest accepted RMSE of X, Y and Z, ft.
    """
    out: list[Row] = []
    for filter_ in ("ekf", "ekf-log", "ekf-natural"):
        flown = fly(case, episodes, estimator=filter_)
        best = filter_ == "ekf"
        out += rmse_rows(f"{case}/{filter_}", flown, most if best else (None, None, None))
        mean = kept(flown)["a_lat_mean"] / FOOT
        band = (a_lat - 0.1, a_lat + 0.1)
        out.append(figure(f"{case}/{filter_}/a_lat_ft_s2", mean, np.mean, *band))
        out.append(lost_row(f"{case}/{filter_}", flown, high=0.0 if best else None))
    for q in (1.0, 10.0, 100.0):
        out += without_a_lat(case, q, episodes)
    blind = fly(case, episodes, wings="none", range_bias=0.2)
    x_error = np.sqrt(kept(blind)["square_r"][:, 0]) / FOOT
    out.append(figure(f"{case}/no-alpha/X_ft", x_error**2, root_mean, low=10.0))
    out.append(lost_row(f"{case}/no-alpha", blind))
    for wings in ("points", "flat"):
        bias = kept(fly(case, episodes, wings=wings))["bias_r"][:, 0] / FOOT
        out.append(figure(f"{case}/wings={wings}/X_bias_ft", bias))
    told = kept(fly(case, episodes, size_bias=0.05))["bias_r"][:, 0] / FOOT
    return [*out, figure(f"{case}/b0+5%/X_bias_ft", told)]


def without_a_lat(case: str, q: float, episodes: int) -> list[Row]:
    """Losses without the lateral acceleration, and the filter's own errors behind a true guide."""
    changes = {"sd_lat": 0.0, "q_lat": 0.0, "q_a": q * FOOT**2}
    at = f"{case}/no-a_lat/q_a={q:g}"
    log = record(case, episodes, estimator="truth")
    again = replay(log, scene(case, **changes)[1])
    late = in_heading(log, again["e"][..., :3])[SCORED:] / FOOT
    flies = again["flies"][SCORED:] > 0
    rows = [lost_row(at, fly(case, episodes, **changes))]
    for i, axis in enumerate(AXES):
        squares = np.mean(late[..., i] ** 2, axis=0, where=flies)
        rows.append(figure(f"{at}/filter-only/{axis}_ft", squares, root_mean))
    return rows


def compare_plot(
    folder: Path, scenario: str, estimators: tuple[str, ...], case: str | None = None
) -> Path:
    """Relative position and leader's acceleration, true and estimated, on the first public seed."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    page = Figure(figsize=(12, 9), layout="constrained")
    FigureCanvasAgg(page)
    panels = page.subplots(4, 2)
    for column, estimator in enumerate(estimators):
        log = record(scenario, 1, estimator=estimator)
        time = 0.1 * np.arange(len(log))
        truth = in_heading(log, log["leader"]["r_N"] - log["r_V_N"])[:, 0] / FOOT
        hat, a = log["rhat_LV_F"][:, 0] / FOOT, log["ahat_L_F"][:, 0, 1] / FOOT
        true_a = in_heading(log, log["leader"]["a_N"])[:, 0, 1] / FOOT
        pairs = [*zip(truth.T, hat.T, strict=True), (true_a, a)]
        names = [*(f"{axis} (ft)" for axis in AXES), "leader's a, right (ft/s²)"]
        for axes, name, (real, guess) in zip(panels[:, column], names, pairs, strict=True):
            axes.plot(time, real, "C2", label="true")
            axes.plot(time, guess, "C0", lw=0.8, label="estimated")
            axes.set(ylabel=name)
            axes.grid(alpha=0.3)
        panels[0, column].set(title=f"{scenario}, estimator {estimator}")
        panels[-1, column].set(xlabel="time (s)")
    panels[0, 0].legend(fontsize=8)
    file = folder / f"{case or scenario}.png"
    page.savefig(file, dpi=110)
    return file
