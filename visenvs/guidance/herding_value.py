"""The chance that one robot gets over the goal line, if every so often somebody serves it well.

V(n, k, north, east, heading) by backward induction over the robot's 20 s clock: n whole periods are
left after this one, and k counts the parts of the drive between two reversals. In every part the
robot drives on, swerves a little, and with a small chance is served: left alone, blocked or tapped,
whichever is best. That the other robots want service too is in this chance alone (a mean field).
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from visenvs.core.compile import kernel

CELLS = 40  # of the arena, each axis
HEADINGS = 24
PARTS = 18  # of the drive between two reversals
PERIODS = 16  # that are told apart; more time left than that changes nothing
SERVICE_RATE = 0.02  # of one robot by one aircraft, 1/s
HALF, EIGHTH = HEADINGS // 2, HEADINGS // 8  # turns, in headings
KEY = (
    "side", "speed", "period", "spin_time", "noise_every", "noise_max", "aircraft",
    "bump_restarts_timer", "services",
)  # fmt: skip

_tables: dict[bytes, NDArray[np.float32]] = {}


def value_table(settings: NDArray[Any]) -> NDArray[np.float32]:
    """The table of a configuration's record (1,), made once: (periods + 1, parts, x, y, heads)."""
    key = b"".join(settings[name].tobytes() for name in KEY)
    if key not in _tables:
        V = np.zeros((PERIODS + 1, PARTS, CELLS + 1, CELLS + 1, HEADINGS), np.float32)
        edges(V)
        fill(V, settings)
        _tables[key] = V
    return _tables[key]


@kernel
def edges(V):
    """Write what it is worth to be on the lines: 1 on the goal line, 0 on the others."""
    V[:, :, CELLS, :, :] = 1.0


@kernel
def fill(V, settings):
    """Backward induction from no time left; `settings` as in `value_table`."""
    cfg = settings[0]
    part = (cfg["period"] - cfg["spin_time"]) / PARTS
    spread = (cfg["noise_max"] * HEADINGS / (2.0 * math.pi)) ** 2 / 3.0
    drift = 0.5 * spread * part / cfg["noise_every"]  # chance to swerve by one heading, either side
    served = 1.0 - math.exp(-SERVICE_RATE * cfg["aircraft"] * part)
    driven = np.zeros(HEADINGS)
    for n in range(1, PERIODS + 1):
        for k in range(PARTS - 1, -1, -1):
            for i in range(1, CELLS):
                for j in range(1, CELLS):
                    for h in range(HEADINGS):
                        driven[h] = after_drive(V, n, k, i, j, h, part, cfg)
                    for h in range(HEADINGS):
                        aside = driven[(h + 1) % HEADINGS] + driven[h - 1]
                        alone = (1.0 - 2.0 * drift) * driven[h] + drift * aside
                        best = max(alone, after_turn(V, n, k, i, j, h, HALF, part, cfg))
                        if cfg["services"] != BLOCK_ONLY:
                            best = max(best, after_turn(V, n, k, i, j, h, EIGHTH, part, cfg))
                        V[n, k, i, j, h] = (1.0 - served) * alone + served * best


BLOCK_ONLY = 0  # code of services="block"


@kernel
def after_drive(V, n, k, i, j, h, part, cfg):
    """Value one part later, at the place that is reached straight ahead."""
    angle = 2.0 * math.pi * h / HEADINGS
    step = cfg["speed"] * part * CELLS / cfg["side"]
    x, y = i + step * math.cos(angle), j + step * math.sin(angle)
    if k == PARTS - 1:
        return at_place(V[n - 1, 0], x, y, (h + HALF) % HEADINGS)
    return at_place(V[n, k + 1], x, y, h)


@kernel
def after_turn(V, n, k, i, j, h, turn, part, cfg):
    """Value after a service that turns by a number of headings, at grid places and headings."""
    g = (h + turn) % HEADINGS
    if turn == HALF and cfg["bump_restarts_timer"]:
        return V[n - 1, 0, i, j, g]
    later = k + cfg["spin_time"] * turn / HALF / part
    low = int(later)
    share = later - low
    return (1.0 - share) * later_part(V, n, low, i, j, g) + share * later_part(
        V, n, low + 1, i, j, g
    )


@kernel
def later_part(V, n, k, i, j, h):
    """V at a part that may lie beyond the reversal."""
    if k < PARTS:
        return V[n, k, i, j, h]
    return V[n - 1, 0, i, j, (h + HALF) % HEADINGS]


@kernel
def at_place(table, x, y, h):
    """Bilinear in the place (cells from the south-west corner), 1 or 0 beyond the lines."""
    if x >= CELLS and 0.0 <= y <= CELLS:
        return 1.0
    if x <= 0.0 or y <= 0.0 or y >= CELLS or x >= CELLS:
        return 0.0
    i, j = int(x), int(y)
    a, b = x - i, y - j
    south = (1.0 - b) * table[i, j, h] + b * table[i, j + 1, h]
    north = (1.0 - b) * table[i + 1, j, h] + b * table[i + 1, j + 1, h]
    return (1.0 - a) * south + a * north


@kernel
def at_pose(table, x, y, heading):
    """`at_place`, linear in the heading (rad)."""
    turn = (heading / (2.0 * math.pi) % 1.0) * HEADINGS
    h = int(turn)
    share = turn - h
    one = at_place(table, x, y, h % HEADINGS)
    return (1.0 - share) * one + share * at_place(table, x, y, (h + 1) % HEADINGS)


@kernel
def value(V, north, east, heading, phase, left, cfg):
    """Chance that a robot that drives gets over the goal line.

    Args:
        V: table.
        north, east, heading: m, rad.
        phase: of its clock, s.
        left: time left, s.
        cfg: record with side, period, spin_time.
    """
    if left <= 0.0:
        return 0.0
    x = (north / cfg["side"] + 0.5) * CELLS
    y = (east / cfg["side"] + 0.5) * CELLS
    part = (cfg["period"] - cfg["spin_time"]) / PARTS
    n = int((left - (cfg["period"] - phase)) / cfg["period"] + 1.5)
    n = min(max(n, 1), PERIODS)
    later = max((phase - cfg["spin_time"]) / part, 0.0)
    if later >= PARTS:
        return at_pose(V[n - 1, 0], x, y, heading + math.pi)
    k = int(later)
    share = later - k
    now = at_pose(V[n, k], x, y, heading)
    if k == PARTS - 1:
        return (1.0 - share) * now + share * at_pose(V[n - 1, 0], x, y, heading + math.pi)
    return (1.0 - share) * now + share * at_pose(V[n, k + 1], x, y, heading)
