"""Obstacle avoidance with six obstacles in sight, a filter for each; resets included."""

from __future__ import annotations

from typing import Any

from . import Budget, Row, faces, race, row

GROUP = "avoidance"
WANTS = (
    "at least 40,000 steps per CPU second with 1 environment, "
    "400,000 lane-steps with 1024 native lanes"
)
ENV_ID = "visenvs/Avoidance-v0"
SIX: dict[str, Any] = {
    "scene": "fixed",
    "obstacles": 6,
    "obstacle_x": (40.0, 65.0, 90.0, 115.0, 140.0, 165.0),
    "obstacle_y": (4.0, -3.0, 2.0, -4.0, 3.0, -2.0),
    "obstacle_z": (-2.0, 3.0, -4.0, 1.0, -3.0, 2.0),
    "radius": (8.0,) * 6,
}


def rows(budget: Budget) -> list[Row]:
    """The single face, then the native vector face."""
    single, vector = f"{GROUP}/single", f"{GROUP}/vector/1024"
    one = race({single: faces.single(ENV_ID, **SIX)}, budget)
    many = race({vector: faces.vector(ENV_ID, 1024, **SIX)}, budget)
    return [row(single, faces.UNIT, one), row(vector, faces.UNIT, many)]
