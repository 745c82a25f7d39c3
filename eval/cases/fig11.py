"""Figure 11 of the tracking paper: the same without adaptation, where the leader is lost.

The paper concludes that an adaptive element is required. What is required is an acceleration of the
leader for the guidance: with the follower's own turn rate in its place (`own_turn`, see `fig10`),
most flights keep the leader without any adaptation.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from . import Row
from ._adapt import DESIGNS, MANOEUVRES, design_rows
from ._pursuit import errors, times, watch

CASE = "fig11"
LEAST_LOST = 0.5  # at 0.1 rad/s


def rows(episodes: int) -> list[Row]:
    """Losses and errors without adaptation, in every manoeuvre."""
    out: list[Row] = []
    for manoeuvre, changes in MANOEUVRES.items():
        least = LEAST_LOST if manoeuvre == "0.1" else None
        out += design_rows(f"{CASE}/{manoeuvre}/none", "none", episodes, changes, least_lost=least)
    return out


def plot(folder: Path, episodes: int) -> Path:
    """Whether the leader is seen, and the error of the range, of some flights."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10, 6), layout="constrained")
    FigureCanvasAgg(figure)
    seen, error = figure.subplots(2, 1, sharex=True)
    for design, colour in (("none", "C3"), ("network", "C0")):
        law, settings = DESIGNS[design]
        log = watch("adaptive", law, episodes, **{**settings, **MANOEUVRES["0.1"]})[:, :4, 0]
        t = times(log)
        for i in range(log.shape[1]):
            flies = log["flies"][:, i]
            name = settings["estimator"] if i == 0 else None
            share = np.convolve(log["seen"][flies, i], np.ones(20) / 20, "same")
            seen.plot(t[flies], share, colour, lw=0.8)
            error.plot(t, errors(log[:, :, None])[:, i, 0, 0], colour, lw=0.8, label=name)
    seen.set(ylabel="share of images with the leader", title="figure 11: with and without")
    error.set(xlabel="time (s)", ylabel="error of X (ft)")
    error.legend(fontsize=8)
    for axes in (seen, error):
        axes.axvspan(20, 60, color="k", alpha=0.06)
        axes.grid(alpha=0.3)
    file = folder / f"{CASE}.png"
    figure.savefig(file, dpi=110)
    return file
