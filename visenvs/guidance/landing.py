"""Landing in the path of a ground robot, planned anew at every step (IARC section IV).

The plan (`ddp`) ends at rest over the place where the robot will be, and a little ahead (35), as
if the floor lay deeper than it does, so that the aircraft comes to the floor while it still sinks.
The moment of the landing is chosen once and counts down: an aim that is always the same time away
is chased for ever. Until then each look at the robot tells the same place anew, which is why they
are averaged; in the last half second the aim stays where it is.

A landing is a record (`LANDING`); x is the aircraft's position and velocity in N, (6,).
"""

from __future__ import annotations

import math

import numpy as np

from visenvs.core.compile import kernel
from visenvs.guidance.ddp import improve, shift

LANDING = np.dtype([("aim", "f8", (6,)), ("fresh", "f8", (6,)), ("t_go", "f8"), ("begun", "f8")])

AHEAD = 0.65  # of the robot's centre where it will be, m: both radii and a gap
DEEPER = 0.06  # under the floor that the plan ends, m,
SINK = 0.25  # and how fast, m/s
FROZEN = 0.5  # time to go from which the aim stays, s
GAIN = 0.15  # share of a new aim in the average
LEISURE = 1.3  # times the least time from rest to rest under the limits that a landing takes
SPARE = 0.6  # and what it takes beyond that, s


@kernel
def aim_ahead(place, heading, speed, t_go, aim):
    """Write x* (35): position and velocity at the end, (6,).

    Args:
        place, heading: of the robot, estimated: north, east (m, (2,)) and rad.
        speed, t_go: m/s and s.
    """
    reach = speed * t_go + AHEAD
    aim[0], aim[1] = place[0] + reach * math.cos(heading), place[1] + reach * math.sin(heading)
    aim[2], aim[3], aim[4], aim[5] = DEEPER, 0.0, 0.0, SINK


@kernel
def begin(landing, x, place, heading, speed, most, cfg):
    """Choose the moment of the landing, at most `most` s away.

    cfg: record of a DDPConfig.
    """
    t_go, aim = 0.0, landing["aim"]
    for _ in range(3):  # the robot drives on meanwhile
        aim_ahead(place, heading, speed, t_go, aim)
        away = math.sqrt((aim[0] - x[0]) ** 2 + (aim[1] - x[1]) ** 2 + (aim[2] - x[2]) ** 2)
        least = away / cfg["v_max"] + cfg["v_max"] / cfg["a_max"]
        t_go = min(LEISURE * least + SPARE, most)
    landing["t_go"] = math.floor(t_go / cfg["dt"]) * cfg["dt"]
    landing["begun"] = 0.0
    for i in range(6):
        aim[i] = 0.0


@kernel
def land(landing, x, place, heading, speed, cfg, tape):
    """Plan the rest of the landing; tape.u[0] is what to fly now. Counts the time to go down.

    Args: as of `begin`, or with speed 0 where the robot will be at the end; tape: a `ddp.Tape`,
    kept from call to call for its first guess.
    """
    aim, fresh = landing["aim"], landing["fresh"]
    n = max(round(landing["t_go"] / cfg["dt"]), 1)
    aim_ahead(place, heading, speed, landing["t_go"], fresh)
    gain = GAIN if landing["t_go"] >= FROZEN else 0.0
    if landing["begun"] == 0.0:
        landing["begun"], gain = 1.0, 1.0
        tape.u[:] = 0.0
    else:
        shift(n + 1, tape)
    for i in range(6):
        aim[i] += gain * (fresh[i] - aim[i])
    improve(x, aim, n, cfg, tape)
    landing["t_go"] = max(landing["t_go"] - cfg["dt"], 0.0)
