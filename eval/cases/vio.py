"""Navigation by an IMU and floor landmarks on rendered pictures (IARC, the BTEKF): how far off.

About 1 m/s, 2 m up, four moving robots in the picture, IMU at 100 Hz with half the noise that the
filter is told, pictures at 10 Hz, a laser altimeter of 0.02 m. `tilted` looks 60 deg down. The
paper gives no figures of its own.
"""

from __future__ import annotations

import numpy as np

from . import Row
from ._flights import Drift, fly
from ._pictures import rms

CASE = "vio"
RATE, FLIGHTS = 10, 3


def rows(episodes: int) -> list[Row]:
    """Errors of position (m) and heading (deg) over one minute and ten, tilted, and unaided.

    For fewer than ten episodes a tenth of the times is flown, for a quick look.
    """
    flights, part = min(episodes, FLIGHTS), 1.0 if episodes >= 10 else 0.1
    return [
        *summary("nadir/1min", [fly(k, 60.0 * part, RATE, "nadir") for k in range(flights)], 0.06),
        *summary("nadir/10min", [fly(0, 600.0 * part * part, RATE, "nadir")], 0.12),
        *summary("tilted/1min", [fly(0, 60.0 * part, RATE, "tilted")], None),
        *summary("no-altimeter/1min", [fly(0, 60.0 * part, RATE, "nadir", False)], None),
    ]


def summary(name: str, flown: list[Drift], most: float | None) -> list[Row]:
    """Means over flights; n counts pictures."""
    at, n = f"{CASE}/{name}", sum(len(drift.position) for drift in flown)
    offs = [np.linalg.norm(drift.position, axis=1) for drift in flown]
    position = float(np.mean([rms(off) for off in offs]))
    heading = float(np.mean([np.degrees(rms(drift.heading)) for drift in flown]))
    ends = float(np.mean([off[-1] / d.travelled for off, d in zip(offs, flown, strict=True)]))
    used = float(np.mean([drift.used for drift in flown]))
    return [
        Row(f"{at}/position_rms_m", None, position, 0.0, n, high=most),
        Row(f"{at}/heading_rms_deg", None, heading, 0.0, n),
        Row(f"{at}/end_error_share", None, ends, 0.0, n),
        Row(f"{at}/landmarks_used", None, used, 0.0, n),
    ]
