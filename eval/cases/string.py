"""A string of five followers: what a disturbance of the leader becomes on its way down the chain.

Not in the papers. The leader weaves 10 ft along its course or across it, each vehicle keeps 60 ft
to the one ahead by its own camera and filter, whose noise (q_a = 10 ft^2/s^3) suits a weave. `gain`
is the amplitude of a vehicle's weave over that of the one ahead, at the leader's frequency, as the
geometric mean over the four hops behind the first follower; `error_gain` that of the RMS error of
spacing, in which noise has its part. With a constant spacing and without the leader's acceleration
these PD gains (0.16, 0.8) have 1.19 at 0.4 rad/s; a headway of 2 s ends that. Across the course,
with the truth told: an offset in the own heading frame is a headway by itself.

In a `turn` the leader rolls from straight flight into 0.1 rad/s at 20 s, all at once; filters let
a_lat drift ten times faster than in a steady turn: with the drift for that (0.04 ft^2/s^5) one
chain in a hundred breaks, where images are missing just then.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from visenvs.core.units import FOOT

from . import Row
from ._formation import Values, figure, root_mean
from ._pursuit import kept, times, watch

CASE = "string"
FOLLOWERS, SPACING, SPEED, REACH = 5, 60 * FOOT, 75 * FOOT, 10 * FOOT
RATES = (0.2, 0.4, 0.8)  # rad/s
SETTLED = 30.0  # s
DESIGNS = {"constant": ("follow", 0.0), "headway": ("follow-headway-2", 2.0)}
MOST_GAIN, GATED = 1.0, (0.4, 0.8)
ASIDE = {"chain": 0.0, "v": 20 * FOOT}  # of the leader
CHAIN: dict[str, Any] = {
    "followers": FOLLOWERS,
    "formation": "chain",
    "speed": (SPEED, SPEED),
    "offset": (SPACING, 0.0, 0.0),
    "step_times": (0.0, 0.0, 0.0),
    "wingspan": 8.75 * FOOT,
    "blackout": (0.0, 0.0),
}
# straight until the second switch, then the other way
ROLL_IN = {"profile": "reverse", "switch": (0.0, 20.0), "turn": (-0.1, -0.1), "t_f": 110.0}
ROLL_IN |= {"q_a": 1.0 * FOOT**2, "q_lat": 0.4 * FOOT**2}


def weaving(rate: float, axis: int, **changes: Any) -> dict[str, Any]:
    """Settings of a leader that weaves along an axis for a whole number of periods."""
    period = 2.0 * math.pi / rate
    reach = [0.0, 0.0, 0.0]
    reach[axis] = REACH
    length = SETTLED + period * math.ceil(60.0 / period)
    noise = {"q_a": 10 * FOOT**2, "sd_lat": 0.0, "q_lat": 0.0}
    weave = {"profile": "weave", "weave": tuple(reach), "weave_rate": (rate, rate), "t_f": length}
    return CHAIN | noise | weave | changes


def amplitudes(log: NDArray[Any], rate: float, axis: int) -> Values:
    """Amplitude of each vehicle's weave at the leader's frequency once it is settled, m, (n, team).

    By least squares of its place with a constant, a slope and a sine.
    """
    settled = times(log) > SETTLED
    late, t = log[settled], times(log)[settled]
    basis = np.stack([np.ones_like(t), t, np.sin(rate * t), np.cos(rate * t)], axis=1)
    places = late["r_V_N"][..., axis]
    parts = np.linalg.lstsq(basis, places.reshape(len(t), -1), rcond=None)[0]
    return np.hypot(parts[2], parts[3]).reshape(places.shape[1:])


def spacing_errors(log: NDArray[Any], axis: int, headway: float) -> Values:
    """RMS of each vehicle's distance from its place, headway included, ft, (n, team)."""
    late = log[times(log) > SETTLED]
    error = late["tracking_error"][..., axis] / FOOT
    if axis == 0:
        error = error - headway * (late["v_V_F"][..., 0] - SPEED) / FOOT
    return root_mean(error**2)


def per_hop(values: Values) -> Values:
    """Geometric mean over the hops of last over first, (n,)."""
    return (values[:, -1] / values[:, 0]) ** (1.0 / (values.shape[1] - 1))


def along_rows(rate: float, design: str, episodes: int) -> list[Row]:
    """Losses, and of the others gain and growth of the spacing error, with filters in the loop."""
    law, headway = DESIGNS[design]
    at, log = f"{CASE}/along/{rate}/{design}", watch("straight", law, episodes, **weaving(rate, 0))
    good = kept(log)
    out = [figure(f"{at}/lost", 1.0 - good.astype(float))]
    if good.any():
        errors = spacing_errors(log[:, good], 0, headway)
        high = MOST_GAIN if design == "headway" and rate in GATED else None
        out.append(figure(f"{at}/gain", per_hop(amplitudes(log[:, good], rate, 0)), high=high))
        out.append(figure(f"{at}/error_gain", per_hop(errors)))
        out.append(figure(f"{at}/last_error_ft", errors[:, -1]))
    return out


def across_rows(rate: float) -> list[Row]:
    """Gains across the course of the two frames of the offset, with the truth told: no chance."""
    out: list[Row] = []
    for frame in ("heading", "inertial"):
        told = {"estimator": "truth", "offset_frame": frame}
        log = watch("straight", "follow", 1, **weaving(rate, 1, **told))
        out.append(figure(f"{CASE}/across/{rate}/{frame}/gain", per_hop(amplitudes(log, rate, 1))))
    return out


def turn_rows(shape: str, design: str, episodes: int, **changes: Any) -> list[Row]:
    """Losses in a turn, and how far from their places first and last follower get."""
    turn = CHAIN | ROLL_IN | {"formation": shape}
    turn["offset"] = (SPACING, ASIDE[shape], 0.0)
    log = watch("gtmax", DESIGNS[design][0], episodes, **(turn | changes))
    at = "/".join([CASE, "turn", shape, design, *changes.values()])
    lost, gated = 1.0 - kept(log).astype(float), (shape, design) == ("chain", "headway")
    out = [figure(f"{at}/lost", lost, high=0.0 if gated else None)]
    if lost.all():
        return out
    for k, name in ((0, "first"), (-1, "last")):
        off = np.abs(log["tracking_error"][:, kept(log), k]).max(axis=0) / FOOT
        out += [figure(f"{at}/{name}_{axis}_max_ft", off[:, i]) for i, axis in enumerate("XY")]
    return out


def rows(episodes: int) -> list[Row]:
    """Gains along and across the course; who keeps up in a turn."""
    out: list[Row] = []
    for rate in RATES:
        for design in DESIGNS:
            out += along_rows(rate, design, episodes)
        out += across_rows(rate)
    for shape in ASIDE:
        for design in DESIGNS:
            out += turn_rows(shape, design, episodes)
    return out + turn_rows("v", "constant", episodes, offset_frame="inertial")


def plot(folder: Path, episodes: int) -> Path:
    """Places of the vehicles about their mean motion, with and without headway; one flight."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11, 6), layout="constrained")
    FigureCanvasAgg(figure)
    for axes, (name, (law, _)) in zip(figure.subplots(2, 1), DESIGNS.items(), strict=True):
        log = watch("straight", law, episodes, **weaving(0.4, 0))
        one, t = int(np.argmax(kept(log))), times(log)
        leader = REACH * (1.0 - np.cos(0.4 * t)) / FOOT
        axes.plot(t, leader, "k", label="leader")
        for k in range(FOLLOWERS):
            places = log["r_V_N"][:, one, k, 0] - SPEED * t + (k + 1) * SPACING
            axes.plot(t, places / FOOT, f"C{k}", label=f"follower {k}")
        axes.set(ylabel="ahead of the mean (ft)", title=f"{law} ({name}), 0.4 rad/s")
        axes.grid(alpha=0.3)
        axes.legend(fontsize=8, ncols=6)
        axes.set_xlabel("time (s)")
    file = folder / f"{CASE}.png"
    figure.savefig(file, dpi=110)
    return file
