"""What the cases of the IARC paper share: one ground robot by itself, and its settings."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from visenvs.core.config import override, to_record
from visenvs.core.lanes import lane_dtype
from visenvs.dynamics.ground_robot import COLUMNS
from visenvs.envs._herding_config import HerdingConfig

ARENA = lane_dtype([*COLUMNS])
NEVER = 1e3  # period of a timer that does not run out, s


def settings(period: float, **changes: Any) -> NDArray[Any]:
    """One record of the herding task's settings, its tick of that period (s), no reversal due.

    The camera is 80 degrees across, and finds nothing that is not there.
    """
    known = {
        "tick": period,
        "camera_every": period,
        "dt": round(1.0 / period) * period,
        "fov": math.radians(80.0),
        "false_detections": 0.0,
        "period": NEVER,
    }
    return to_record(override(HerdingConfig(), known | changes))


def rms(values: NDArray[np.float64]) -> float:
    """Root mean square."""
    return float(np.sqrt(np.mean(values**2)))
