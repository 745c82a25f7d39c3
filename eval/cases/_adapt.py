"""What figures 10 and 11 of the tracking paper share: a leader on a circle that nobody models.

The leader circles at 75 ft/s, the follower keeps [60, 15, 10] ft, and between 20 and 60 s the
leader's own report gives way to the estimate. Scored from 80 s on, as the paper's figure is from
when only vision is used. Losses count over the whole flight.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from visenvs.core.units import FOOT

from . import Row
from ._formation import AXES, figure, root_mean
from ._pursuit import Values, errors, kept, off_place, times, watch

LAW = "follow-firm"
SCORED_FROM = 80.0  # s
NETWORK = {"adapt_gain": 0.1, "adapt_decay": 0.1 / FOOT}
# by name: law, estimator and its settings
DESIGNS: dict[str, tuple[str, dict[str, Any]]] = {
    "none": (LAW, {"estimator": "kf"}),
    "network": (LAW, {"estimator": "kf-nn", **NETWORK}),
    "network_velocity": (LAW, {"estimator": "kf-nn-velocity", **NETWORK}),
    "integrator": (LAW, {"estimator": "kf-integrator"}),
    "singer": (LAW, {"estimator": "kf-singer"}),
    "own_turn": ("follow-firm-ff", {"estimator": "kf", "q_velocity": 10 * FOOT**2}),
    "a_lat": (LAW, {"estimator": "ekf"}),
}
MANOEUVRES: dict[str, dict[str, Any]] = {
    "0.05": {"turn": (0.05, 0.05)},
    "0.1": {"turn": (0.1, 0.1)},
    "0.15": {"turn": (0.15, 0.15)},
    "reversal": {"profile": "reverse", "switch": (110.0, 130.0)},
}
BLACKOUT = {"blackout": (90.0, 3.0)}
Most = tuple[float, float, float]


def design_rows(
    at: str,
    design: str,
    episodes: int,
    changes: dict[str, Any],
    most_lost: float | None = None,
    least_lost: float | None = None,
    most: Most | None = None,
) -> list[Row]:
    """Who was lost, tracking errors of those who were not, and errors of their estimates, ft.

    Args:
        most: largest tracking errors accepted on each axis, in the mean over flights. The largest
            of all flights is under `worst`.
    """
    law, settings = DESIGNS[design]
    log = watch("adaptive", law, episodes, **{**settings, **changes})
    late, good = times(log) >= SCORED_FROM, kept(log)
    lost = 1.0 - good.astype(float)
    out = [figure(f"{at}/lost", lost, low=least_lost, high=most_lost)]
    if not good.any():
        return out
    off, error = off_place(log)[late][:, good, 0], errors(log)[late][:, good, 0]
    for i, axis in enumerate(AXES):
        high = None if most is None else most[i]
        out.append(figure(f"{at}/{axis}_max_ft", largest(off[..., i]), high=high))
    out.append(figure(f"{at}/worst_ft", largest(off).max(axis=1), np.max))
    for name, values in (("track", off), ("estimate", error)):
        squares = (values**2).sum(axis=2).mean(axis=0)
        out.append(figure(f"{at}/{name}_rms_ft", squares, root_mean))
    return out


def largest(values: Values) -> Values:
    """Largest absolute value in time."""
    return np.abs(values).max(axis=0)
