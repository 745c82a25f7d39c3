"""How finely a quadrotor's attitude loop has to be integrated."""

from __future__ import annotations

import math
from typing import Any


def require_stable(config: Any, dt: float) -> None:
    """Raise a ValueError for an attitude loop that its integration makes unstable.

    In a part of h s, with x = bandwidth h and z the damping, the error e and the turn u = omega h
    become u' = (1 - 2 z x) u + x^2 e and e' = e - u': stable where x^2 + 4 z x < 4.

    Args:
        config: with bandwidth (rad/s), damping, substeps.
        dt: time of so many substeps, s.
    """
    step, z = config.bandwidth * dt, config.damping
    if step / config.substeps >= 2.0 * (math.hypot(1.0, z) - z):
        least = math.floor(0.5 * step * (math.hypot(1.0, z) + z)) + 1
        raise ValueError(
            f"{type(config).__name__}.substeps={config.substeps}: an attitude loop of "
            f"bandwidth={config.bandwidth:g} rad/s and damping={z:g} is unstable in parts of "
            f"{dt / config.substeps:g} s; write `substeps={least}` or more, or a smaller bandwidth"
        )
