"""An aircraft that flies level at one height, lands and climbs: position control with limits.

Level flight is a point mass under the paper's position control (IARC section V: PID, at most
2.13 m/s and 3.05 m/s^2 in any direction). Without wind and drag its integral has nothing to do and
is left out. Up and down it moves at one speed each. What has no perfect control of its velocity
follows the same commands by the accelerations here.
"""

from __future__ import annotations

import math

from visenvs.core.compile import kernel
from visenvs.dynamics.point_mass import move, saturate

STIFFNESS = 9.0  # of the position control, 1/s^2
DAMPING = 6.0  # 1/s; critical: 2 sqrt(STIFFNESS)
SINK_GAIN = 8.0  # of the loop that holds the speed of a descent or a climb, 1/s,
HEIGHT_GAIN = 4.0  # and of the one around it that ends them, 1/s


@kernel
def steer(v, a, aim, r, cfg):
    """Acceleration (m/s^2) of the position control towards a point at rest, written to `a`.

    Args:
        v, r, aim: velocity, position and the point, N, (2,), m and m/s.
        cfg: record with v_max, a_max.
    """
    limit = cfg["v_max"] * DAMPING / STIFFNESS  # an error that asks for the largest speed
    north, east = aim[0] - r[0], aim[1] - r[1]
    away = math.sqrt(north * north + east * east)
    gain = STIFFNESS * (limit / away if away > limit else 1.0)
    a[0], a[1] = gain * north - DAMPING * v[0], gain * east - DAMPING * v[1]
    saturate(a, cfg["a_max"], a)


@kernel
def glide(r, v, a, aim, cfg):
    """Fly level towards a point for one tick; `a` is scratch (2,)."""
    steer(v, a, aim, r, cfg)
    move(r, v, a, cfg["tick"])


@kernel
def follow_velocity(r, v, a, command, cfg):
    """Fly level towards a commanded velocity (N, m/s) for one tick; `a` is scratch (2,)."""
    for i in range(2):
        a[i] = (command[i] - v[i]) / cfg["tick"]
    saturate(a, cfg["a_max"], a)
    move(r, v, a, cfg["tick"])


@kernel
def approach_velocity(v, a, command, share, cfg):
    """Acceleration (m/s^2) towards a share of a velocity (N, m/s), written to `a`."""
    for i in range(2):
        a[i] = DAMPING * (share * command[i] - v[i])
    saturate(a, cfg["a_max"], a)


@kernel
def sink_acceleration(height, sink, goal, cfg):
    """Acceleration down (m/s^2) on the way to a height `goal` (m); sink: speed down, m/s."""
    wanted = min(max(HEIGHT_GAIN * (height - goal), -cfg["v_climb"]), cfg["v_descent"])
    return SINK_GAIN * (wanted - sink)


@kernel
def descend_or_climb(height, goal, cfg):
    """Height (m) one tick later on the way to a height `goal`."""
    if goal > height:
        return min(height + cfg["v_climb"] * cfg["tick"], goal)
    return max(height - cfg["v_descent"] * cfg["tick"], goal)
