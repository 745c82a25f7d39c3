"""Figure 8 of the tracking paper: a leader's range by bearings alone, with and without a meander.

At t = 10 s the command jumps from [100, 10, 0] to [50, 0, 0] ft; the paper's policy is on from 20
to 60 s. Its "20 ft steady state" without one is a drift here that passes through 20 ft. Boundary
values of its optimal paths are not given: ours lead from 5 ft on one side to 5 ft on the other in
8 s, with omega T = 4, and the sine has the same reach and period: it costs a quarter less and tells
a quarter less. `on` is the same meander without an end. The index (20) counts where the follower
is, while range is told by how it moves beside a straight line. Flights that start with a range too
long by a third come too close at the jump, before any policy is on; those are the losses of all.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from visenvs.core.units import FOOT

from . import Row
from ._formation import figure, root_mean
from ._pursuit import Values, errors, kept, times, watch

CASE = "fig8"
WINDOW = {"meander_window": (20.0, 60.0)}
FOREVER = {"meander_window": (20.0, 1e9)}
FLIGHTS = {
    "none": ("follow", WINDOW),
    "optimal": ("follow-optimal", WINDOW),
    "sine": ("follow-sine", WINDOW),
    "scheduled": ("follow-scheduled", WINDOW),
    "optimal_on": ("follow-optimal", FOREVER),
    "scheduled_on": ("follow-scheduled", FOREVER),
}
LEAST_RATIO, MOST_EFFORT = 20.0, 75.0  # (ft/s^2)^2 s
FEWEST = 10  # flights: of fewer all may lose the leader before anything can be measured


def late_squares(name: str, episodes: int) -> Values:
    """Mean squared error of the estimated X from 60 to 90 s, ft^2, (n,); as long as it flies."""
    law, changes = FLIGHTS[name]
    log = watch("bearing-only", law, episodes, **changes)
    late = errors(log)[times(log) >= 60.0, :, 0, 0]
    return np.nanmean(late[:, ~np.isnan(late[0])] ** 2, axis=0)


def rows(episodes: int) -> list[Row]:
    """Errors of X, standard deviation of the range at 60 s, effort of the manoeuvre, losses."""
    out: list[Row] = []
    episodes = max(episodes, FEWEST)
    for name, (law, changes) in FLIGHTS.items():
        at, log = f"{CASE}/{name}", watch("bearing-only", law, episodes, **changes)
        t, x = times(log), errors(log)[:, :, 0, 0]
        middle = x[np.searchsorted(t, 45.0)]
        middle = middle[~np.isnan(middle)]
        row = figure(f"{at}/X_rms_45s_ft", middle**2, root_mean)
        out.append(Row(row.id, 20.0 if name == "none" else None, row.ours, row.se, row.n))
        out.append(figure(f"{at}/X_rms_60_90s_ft", late_squares(name, episodes), root_mean))
        spread = log["sd_log_range"][np.searchsorted(t, 60.0), :, 0]
        out.append(figure(f"{at}/sd_log_range_60s", spread))
        effort = 0.1 * ((log["a_V_F"][t >= 20.0, :, 0, 1] / FOOT) ** 2).sum(axis=0)
        high = None if name == "none" else MOST_EFFORT
        out.append(figure(f"{at}/effort_ft2_s3", effort, high=high))
        out.append(figure(f"{at}/lost", 1.0 - kept(log).astype(float)))
    none = float(root_mean(late_squares("none", episodes)))
    for name in list(FLIGHTS)[1:]:
        ratio = none / float(root_mean(late_squares(name, episodes)))
        low = LEAST_RATIO if name == "optimal" else None
        out.append(Row(f"{CASE}/{name}/X_rms_none_over_this", None, ratio, 0.0, episodes, low))
    return out


def plot(folder: Path, episodes: int) -> Path:
    """Truth, estimate and command along X and Y, and what is known of the range; one flight."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(12, 7.4), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots(2, 3)
    shown = ("none", "optimal")
    logs = [watch("bearing-only", FLIGHTS[n][0], episodes, **FLIGHTS[n][1]) for n in shown]
    one_kept = int(np.argmax(kept(logs[0]) & kept(logs[1])))
    for row, name, flights in zip(axes, shown, logs, strict=True):
        law, log = FLIGHTS[name][0], flights[:, one_kept, 0]
        t = times(log)
        true = (log["offset_F"] + log["tracking_error"]) / FOOT
        for i in range(2):
            row[i].plot(t, true[:, i], label="true")
            row[i].plot(t, log["rhat_LV_F"][:, i] / FOOT, label="estimated")
            row[i].plot(t, log["offset_F"][:, i] / FOOT, "k:", label="commanded")
            row[i].set(ylabel=f"{'XY'[i]} (ft)", title=f"{law}: {'XY'[i]}")
        row[2].semilogy(t, log["sd_log_range"])
        row[2].set(ylabel="relative s.d. of the range", title="what is known of the range")
        for one in row:
            one.set_xlabel("time (s)")
            one.grid(alpha=0.3)
        row[0].legend(fontsize=8)
    file = folder / f"{CASE}.png"
    figure.savefig(file, dpi=110)
    return file
