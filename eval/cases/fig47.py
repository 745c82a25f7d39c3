"""Figures 47 and 48 of the thesis: what looking ahead costs and gains, and how it is flown.

Looking 5 steps ahead costs more than looking 2: within half a second there is no way to earn the
range but hard pushes, and none of them is seen to be undone again.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from agents.registry import load
from visenvs.core.files import replacing
from visenvs.core.lanes import Lanes
from visenvs.core.units import FOOT

from ..rollout import PUBLIC_SEEDS
from . import Row, standard_error, table2, table4
from ._tracking import costs, scene

CASE = "fig47"
AHEAD = (0, 1, 2, 5, 10, 20, 30, 50, 70, 100)  # steps
SHARES = (0, 1, 2, 5, 10, 20, 40, 60, 80, 100)  # percent of the steps that are left
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

    figure = Figure(figsize=(12, 7.4), layout="constrained")
    FigureCanvasAgg(figure)
    (paths, spread), (steps, shares) = figure.subplots(2, 2)
    for n in DRAWN:
        flight = track(f"nsa-{n}")
        paths.plot(*flight["path"].T, label=f"n = {n}")
        spread.semilogy(flight["time"], flight["deviation"], label=f"n = {n}")
    paths.plot(100, 0, "k*", label="target")
    paths.set(xlabel="x (ft)", ylabel="y (ft)", title="trajectories, one seed")
    for axes, family, ahead, paper in (
        (steps, "nsa", AHEAD, table2.PAPER),
        (shares, "ahead", SHARES, table4.PAPER),
    ):
        for colour, part in enumerate(("Jf", "Jc", "J")):
            means = [costs(f"{family}-{n}", episodes)[part].mean() for n in ahead]
            published = [cost[part] for cost in paper.values()]
            axes.semilogy(ahead, means, f"C{colour}.-", label=part)
            axes.semilogy(list(paper), published, f"C{colour}x", label=f"{part}, thesis")
        axes.set(ylabel="mean cost (ft²/s³)", title=f"cost, {episodes} flights")
    steps.set_xlabel("steps ahead, n")
    shares.set_xlabel("share of the steps left, p (%)")
    spread.set(
        xlabel="time (s)", ylabel="s.d. of the abscissa (ft)", title="what is known of the range"
    )
    for axes in (paths, spread, steps, shares):
        axes.legend(fontsize=8)
        axes.grid(alpha=0.3)
    file = folder / f"{CASE}.png"
    with replacing(file) as temporary:
        figure.savefig(temporary, dpi=110)
    return file
