"""Figure 10 of the tracking paper: formation with a circling leader by an adaptive filter.

"In general ... sufficient to keep formation with 15 ft in each axis" is said of some circle; here
flights have dropouts as well. Beside the paper's network in axes of N stand the same in axes along
the leader's course, that network's constant neuron alone (an integrator), a Singer model, no
adaptation but the follower's own turn rate, and the filter that models a_lat.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from visenvs.core.units import FOOT

from . import Row
from ._adapt import BLACKOUT, DESIGNS, MANOEUVRES, design_rows
from ._formation import AXES
from ._pursuit import errors, kept, off_place, times, watch

CASE = "fig10"
SHOWN = ("network", "network_velocity", "integrator", "singer", "own_turn", "a_lat")
BEST, PAPERS = "integrator", "network"
WITHIN = 6.0  # ft on each axis, of the best design
PAPER_WITHIN = 15.0


def rows(episodes: int) -> list[Row]:
    """Losses and errors of every design, in every manoeuvre, and with a blackout of 3 s."""
    out: list[Row] = []
    for manoeuvre, changes in MANOEUVRES.items():
        for design in SHOWN:
            lost, most = bands(design, manoeuvre)
            at = f"{CASE}/{manoeuvre}/{design}"
            out += design_rows(at, design, episodes, changes, most_lost=lost, most=most)
    for design in SHOWN:
        out += design_rows(f"{CASE}/0.1-blackout/{design}", design, episodes, BLACKOUT)
    return out


def bands(design: str, manoeuvre: str) -> tuple[float | None, Any]:
    """Most losses and largest errors accepted."""
    if design == BEST:
        return 0.0, (WITHIN, WITHIN, WITHIN)
    if design == PAPERS and manoeuvre == "0.1":
        return None, (PAPER_WITHIN, PAPER_WITHIN, PAPER_WITHIN)
    return None, None


def plot(folder: Path, episodes: int) -> Path:
    """Tracking errors, and the leader's acceleration, true and told, of the first kept flight."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(12, 8.6), layout="constrained")
    FigureCanvasAgg(figure)
    shown = ("network", "network_velocity", "integrator")
    axes = figure.subplots(3, 3, sharex=True)
    for row, design in zip(axes, shown, strict=True):
        law, settings = DESIGNS[design]
        log = watch("adaptive", law, episodes, **{**settings, **MANOEUVRES["0.1"]})
        one, t = int(np.argmax(kept(log))), times(log)
        for i, axis in enumerate(AXES):
            row[0].plot(t, off_place(log)[:, one, 0, i], label=axis)
            row[1].plot(t, errors(log)[:, one, 0, i], label=axis, lw=0.8)
            row[2].plot(t, log["ahat_L_F"][:, one, 0, i] / FOOT, label=axis)
        row[0].set(ylabel="off the place (ft)", title=f"{settings['estimator']}: tracking")
        row[1].set(ylabel="estimated - true (ft)", title="relative position")
        row[2].set(ylabel="ft/s²", title="leader's acceleration as told")
        for axis in row:
            axis.axvspan(20, 60, color="k", alpha=0.06)
            axis.grid(alpha=0.3)
    for axis in axes[-1]:
        axis.set_xlabel("time (s); shaded: from the leader's report to vision")
    axes[0, 0].legend(fontsize=8)
    file = folder / f"{CASE}.png"
    figure.savefig(file, dpi=110)
    return file
