"""The UKF paper's filter against extended ones, every one on the same recorded logs.

The follower weaves by 5 ft across the offset. `tuned` has the sensor's own noise in the filter and
no noise on the leader; `frozen` takes the wingspan as known. `consistent` gives the leader exactly
the noise that the filters assume, so that NEES must be 6.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from scipy import stats

from visenvs.core.units import FOOT

from . import Row
from ._formation import (
    AXES,
    SCORED,
    compare_plot,
    figure,
    in_heading,
    record,
    replay,
    root_mean,
    scene,
)

CASE = "ukf"
FILTERS = ("ukf", "cartesian", "ekf-natural", "ekf-log", "ekf")
WAVE = 5 * FOOT
FROZEN: dict[str, Any] = {"sd_size": 0.0}
# a lateral acceleration that wanders as q_lat says, and the white one of q_a; none up or down
CONSISTENT: dict[str, Any] = {
    "profile": "random",
    "turn": (0.0, 0.0),
    "t_f": 60.0,
    "leader_q_a": 0.1 * FOOT**2,
    "leader_q_lat": 0.04 * FOOT**2,
    "leader_sd_lat": 3 * FOOT,
    "sd_lat": 3 * FOOT,
    "sd_up": 0.0,
    "q_up": 0.0,
    "size_error": 0.02,
}


def rows(episodes: int) -> list[Row]:
    """RMSE and NEES of each filter, the ratio of the two nine-state ones, and consistency."""
    out: list[Row] = []
    for scenario in ("gtyak", "gtmax"):
        for name, changes in (("tuned", {}), ("frozen", FROZEN)):
            out += compare(f"{CASE}/{scenario}/{name}", scenario, changes, episodes)
    return out + consistency(episodes)


def compare(at: str, scenario: str, changes: dict[str, Any], episodes: int) -> list[Row]:
    """All filters on one log, flown with perfect information."""
    log = record(scenario, episodes, wave=WAVE, estimator="truth")
    out: list[Row] = []
    roots: dict[str, float] = {}
    limit = 0.70 if scenario == "gtyak" and changes is FROZEN else None
    for filter_ in FILTERS:
        again = replay(log, scene(scenario, estimator=filter_, **changes)[1])
        late, flies = again[SCORED:], again["flies"][SCORED:] > 0
        e = in_heading(log, again["e"][..., :3])[SCORED:] / FOOT
        for i, axis in enumerate(AXES):
            squares = np.mean(e[..., i] ** 2, axis=0, where=flies)
            high = limit if i == 0 else None
            out.append(figure(f"{at}/{filter_}/{axis}_ft", squares, root_mean, high=high))
        roots[filter_] = float(np.sqrt(np.mean(e**2, where=flies[..., None])))
        out.append(figure(f"{at}/{filter_}/nees", np.mean(late["nees"], axis=0, where=flies)))
    ratio = roots["ukf"] / roots["cartesian"]
    return [*out, Row(f"{at}/ukf_over_cartesian", None, ratio, 0.0, episodes, 0.95, 1.05)]


def consistency(episodes: int) -> list[Row]:
    """NEES of position and velocity after 20 s and at the end, inside its 95 % bounds for two."""
    # guided by a filter: a guide that knew the truth would tell the leader's noise
    log = record("gtyak", episodes, wave=WAVE, estimator="ekf", **CONSISTENT)
    out: list[Row] = []
    for filter_ in FILTERS:
        again = replay(log, scene("gtyak", estimator=filter_, **CONSISTENT)[1])
        for k in (SCORED, len(log) - 1):
            flies = again["flies"][k] > 0
            n = 6 * int(flies.sum())
            low, high = stats.chi2.ppf([0.025, 0.975], n) / (n / 6)
            band = (float(low), float(high)) if filter_ in ("ukf", "cartesian") else (None, None)
            at = f"{CASE}/consistent/{filter_}/nees_{k // 10}s"
            out.append(figure(at, again["nees"][k][flies], np.mean, *band))
    return out


def plot(folder: Path, episodes: int) -> Path:
    """Truth against estimate, unscented beside extended."""
    return compare_plot(folder, "gtyak", ("ukf", "cartesian"), CASE)
