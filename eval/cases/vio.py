"""Navigation by an IMU and floor landmarks on rendered pictures (IARC, the BTEKF): how far off.

About 1 m/s, 2 m up, four moving robots in the picture, IMU at 100 Hz with half the noise that the
filter is told, pictures at 10 Hz (`5fps`: 5 Hz), a laser altimeter of 0.02 m. `tilted` looks 60 deg
down. The paper gives no figures of its own.

`single` takes the pictures of one flight through the textbook's covariance in single precision too:
after how many it has a negative eigenvalue, and how far its standard deviations of the vehicle are
off those of the factors in double, at most, in parts.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from visenvs.estimation import ud, vio
from visenvs.estimation.navigator import START

from . import Row
from ._flights import Drift, fly
from ._pictures import Values, rms
from .ud import conventional, least_eigenvalue

CASE = "vio"
RATE, FLIGHTS = 10, 3


def rows(episodes: int) -> list[Row]:
    """Errors of position (m) and heading (deg) over one minute and ten, tilted, and unaided.

    For fewer than ten episodes a tenth of the times is flown, for a quick look.
    """
    flights, part = min(episodes, FLIGHTS), 1.0 if episodes >= 10 else 0.1
    return [
        *summary("nadir/1min", [fly(k, 60.0 * part, RATE, "nadir") for k in range(flights)], 0.06),
        *summary(
            "nadir-5fps/1min", [fly(k, 60.0 * part, 5, "nadir") for k in range(flights)], 0.06
        ),
        *summary("nadir/10min", [fly(0, 600.0 * part * part, RATE, "nadir")], 0.12),
        *summary("tilted/1min", [fly(0, 60.0 * part, RATE, "tilted")], None),
        *summary("no-altimeter/1min", [fly(0, 60.0 * part, RATE, "nadir", False)], None),
        *single(60.0 * part),
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


class Textbook:
    """The filter's steps, and beside them the textbook's covariance, in some precision.

    Attributes:
        P: covariance, (STATES, STATES).
        broken: after how many pictures it had a negative eigenvalue.
        gap: largest difference of a standard deviation of the vehicle from the factors', in parts.
    """

    expect, correct = staticmethod(vio.expect), staticmethod(vio.correct)

    def __init__(self, precision: Any = np.float32) -> None:
        self.P = np.eye(vio.STATES, dtype=precision)
        self.P[range(vio.VEHICLE), range(vio.VEHICLE)] = START.repeat(3) ** 2
        self.broken, self.gap = 0, 0.0

    def predict(self, nav: Any, cfg: Any, scratch: Any) -> None:
        """P <- F P F' + G diag(q) G', once what the last picture left has been compared."""
        self.compare(nav)
        n, F = vio.VEHICLE, np.eye(vio.STATES, dtype=self.P.dtype)
        F[:n, :n] = nav["Phi"]
        vio.predict(nav, cfg, scratch)
        G, q = scratch["G"].astype(self.P.dtype), scratch["q"].astype(self.P.dtype)
        self.P = F @ self.P @ F.T
        self.P[:n, :n] += (G * q) @ G.T

    def use(self, rows: Values, variance: float) -> None:
        """Measurements with these slopes, one after the other."""
        for h in rows.astype(self.P.dtype):
            self.P = conventional(self.P, h, self.P.dtype.type(variance))

    def use_height(self, nav: Any, height: float, sigma: float, scratch: Any) -> None:
        """As of `vio`."""
        vio.use_height(nav, height, sigma, scratch)
        self.use(scratch["h"][:1], sigma**2)

    def use_landmark(
        self, nav: Any, j: int, C_CB: Values, seen: Values, cfg: Any, scratch: Any, pixel: Values
    ) -> bool:
        """As of `vio`."""
        used = vio.use_landmark(nav, j, C_CB, seen, cfg, scratch, pixel)
        if used:
            self.use(scratch["h"], cfg["sigma_pixel"] ** 2)
        return used

    def add_landmark(
        self, nav: Any, j: int, C_CB: Values, seen: Values, cfg: Any, scratch: Any, pixel: Values
    ) -> bool:
        """As of `vio`."""
        added = vio.add_landmark(nav, j, C_CB, seen, cfg, scratch, pixel)
        if added:
            k = vio.VEHICLE + 3 * j + np.arange(3)
            self.P[k], self.P[:, k] = 0.0, 0.0
            self.P[k, k] = np.square([vio.ACROSS, vio.ACROSS, vio.UP])
            self.use(scratch["h"], cfg["sigma_pixel"] ** 2)
        return added

    def compare(self, nav: Any) -> None:
        """What has become of the covariance since the last picture."""
        out, n = np.empty((vio.STATES, vio.STATES)), vio.VEHICLE
        ud.covariance(nav["U"], nav["D"], out)
        parts = np.sqrt(np.diag(self.P)[:n] / np.diag(out)[:n])
        self.gap = max(self.gap, float(np.abs(parts - 1.0).max()))
        self.broken += least_eigenvalue(self.P) < 0.0


def single(seconds: float) -> list[Row]:
    """What single precision does to the textbook's covariance along one flight."""
    beside = Textbook()
    n = len(fly(0, seconds, RATE, "nadir", steps=beside).position)
    at = f"{CASE}/single/1min"
    return [
        Row(f"{at}/broken_pictures", None, beside.broken, 0.0, n),
        Row(f"{at}/deviation_gap", None, beside.gap, 0.0, n),
    ]
