"""Figures 47 and 48 of the thesis: costs and trajectories of n-step-ahead guidance against n."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from agents.registry import load
from visenvs.core.lanes import Lanes
from visenvs.core.units import FOOT

from ..rollout import PUBLIC_SEEDS
from . import Row, standard_error
from ._tracking import costs, scene

CASE = "fig47"
AHEAD = (0, 1, 2, 5, 10, 20, 30, 50, 70, 100)
DRAWN = (0, 1, 10, 50, 100)


def rows(episodes: int) -> list[Row]:
    """Mean total costs of the exact solution along the curve (the thesis gives a picture)."""
    out: list[Row] = []
    for n in AHEAD:
        cost = costs(f"nsa-{n}", episodes)["J"]
        out.append(Row(f"{CASE}/exact/n={n}/J", None, cost.mean(), standard_error(cost), episodes))
    return out


def track(law: str) -> dict[str, np.ndarray]:
    """One flight on the first public seed: path and deviation of the abscissa (ft), time (s)."""
    task, config = scene()
    policy = load(law, task, config).policy
    lanes = Lanes(task, config, 1)
    lanes.reset([PUBLIC_SEEDS[0]])
    path, deviation, state = [], [], None
    while True:
        record = lanes.records[0]
        path.append(record["r_V_N"] / FOOT)
        deviation.append(np.sqrt(record["P"][0, 0]) / FOOT)
        if lanes.done[0]:
            break
        actions, state = policy.predict(lanes.rows, state)
        lanes.step(actions)
    time = vars(config)["dt"] * np.arange(len(path))
    return {"path": np.array(path), "time": time, "deviation": np.array(deviation)}


def plot(folder: Path, episodes: int) -> Path:
    """Trajectories, cost against n, and the standard deviation of the range; returns the file."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(13, 3.8), layout="constrained")
    FigureCanvasAgg(figure)
    paths, curve, spread = figure.subplots(1, 3)
    for n in DRAWN:
        flight = track(f"nsa-{n}")
        paths.plot(*flight["path"].T, label=f"n = {n}")
        spread.semilogy(flight["time"], flight["deviation"], label=f"n = {n}")
    paths.plot(100, 0, "k*", label="target")
    paths.set(xlabel="x (ft)", ylabel="y (ft)", title="trajectories, one seed")
    for part in ("Jf", "Jc", "J"):
        means = [costs(f"nsa-{n}", episodes)[part].mean() for n in AHEAD]
        curve.semilogy(AHEAD, means, marker="o", label=part)
    curve.set(xlabel="steps ahead, n", ylabel="mean cost (ft²/s³)", title="exact solution")
    spread.set(
        xlabel="time (s)", ylabel="s.d. of the abscissa (ft)", title="what is known of the range"
    )
    for axes in (paths, curve, spread):
        axes.legend(fontsize=8)
        axes.grid(alpha=0.3)
    file = folder / f"{CASE}.png"
    figure.savefig(file, dpi=110)
    return file
