"""Navigation by an IMU and floor landmarks on rendered pictures (IARC, the BTEKF): how far off.

About 1 m/s, 2 m up, four moving robots in the picture, IMU at 100 Hz with half the noise that the
filter is told, pictures at 10 Hz, a laser altimeter of 0.02 m. `tilted` looks 60 deg down. The
paper gives no figures of its own.
"""

from __future__ import annotations

import numpy as np

from . import Row
from ._flights import fly
from ._pictures import rms

CASE = "vio"
RATE, FLIGHTS = 10, 3


def rows(episodes: int) -> list[Row]:
    """Errors of position (m) and heading (deg) over a minute, over ten, tilted, and unaided."""
    flights = min(episodes, FLIGHTS)
    out = minute("nadir", "nadir", True, flights, 0.06)
    out += minute("tilted", "tilted", True, 1, None)
    out += minute("no-altimeter", "nadir", False, 1, None)
    long = fly(0, 600.0, RATE, "nadir")
    at = f"{CASE}/nadir/600s"
    off = np.linalg.norm(long.position, axis=1)
    out.append(Row(f"{at}/position_rms_m", None, rms(off), 0.0, 1, high=0.12))
    out.append(Row(f"{at}/heading_rms_deg", None, float(np.degrees(rms(long.heading))), 0.0, 1))
    out.append(Row(f"{at}/end_error_share", None, float(off[-1] / long.travelled), 0.0, 1))
    return out


def minute(name: str, camera: str, altimeter: bool, flights: int, most: float | None) -> list[Row]:
    """Mean over flights of a minute."""
    flown = [fly(seed, 60.0, RATE, camera, altimeter) for seed in range(flights)]
    at = f"{CASE}/{name}/60s"
    offs = [np.linalg.norm(drift.position, axis=1) for drift in flown]
    position = float(np.mean([rms(off) for off in offs]))
    heading = float(np.mean([np.degrees(rms(drift.heading)) for drift in flown]))
    ends = float(np.mean([off[-1] / d.travelled for off, d in zip(offs, flown, strict=True)]))
    used = float(np.mean([drift.used for drift in flown]))
    return [
        Row(f"{at}/position_rms_m", None, position, 0.0, flights, high=most),
        Row(f"{at}/heading_rms_deg", None, heading, 0.0, flights),
        Row(f"{at}/end_error_share", None, ends, 0.0, flights),
        Row(f"{at}/landmarks_used", None, used, 0.0, flights),
    ]
