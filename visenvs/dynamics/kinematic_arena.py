"""Contacts by geometry, compiled: circles that overlap are pushed apart and feel it at their front.

The same contract as the arena with a physics library (`arena.py`): given where the robots have
driven to, each as if alone, it moves those that touch and sets the bumper switches. Robots that
touch nothing keep every bit of their pose.
"""

from __future__ import annotations

import math

from visenvs.core.compile import kernel
from visenvs.dynamics.ground_robot import ACTIVE, CIRCLES, ROBOTS

SLOP = 1e-6  # circles that overlap by less do not touch, m


@kernel
def feel(arena, k, north, east, pad):
    """Circle k meets something in a direction: its front half plane presses the bumper.

    Args:
        north, east: direction of the contact from the circle's centre, of any length.
        pad: 1 + the aircraft that is met, or 0.
    """
    heading = arena["heading"][k]
    if north * math.cos(heading) + east * math.sin(heading) > 0.0:
        arena["bumped"][k] = 1
        if pad and k < ROBOTS:
            arena["met"][k] = pad


@kernel
def touch(arena, pads, cfg):
    """Find and settle all contacts: each of a pair gives way by half, aircraft do not.

    Args:
        arena: record with `r_R_N`, `heading`, `fate`, `bumped` and `met`, changed in place.
        pads: aircraft, shape (m, 3): north and east (m), 1 where it is solid.
        cfg: record with robot_radius, aircraft_radius.
    """
    r, fate = arena["r_R_N"], arena["fate"]
    reach = 2.0 * cfg["robot_radius"]
    stand = cfg["robot_radius"] + cfg["aircraft_radius"]
    for i in range(CIRCLES):
        if fate[i] != ACTIVE:
            continue
        for j in range(i + 1, CIRCLES):
            north, east = r[j, 0] - r[i, 0], r[j, 1] - r[i, 1]
            if fate[j] == ACTIVE and abs(north) < reach and abs(east) < reach:
                gap = math.sqrt(north * north + east * east)
                if gap < reach - SLOP:
                    feel(arena, i, north, east, 0)
                    feel(arena, j, -north, -east, 0)
                    push = 0.5 * (reach - gap) / max(gap, 1e-9)
                    r[i, 0] -= push * north
                    r[i, 1] -= push * east
                    r[j, 0] += push * north
                    r[j, 1] += push * east
        for m in range(pads.shape[0]):
            north, east = pads[m, 0] - r[i, 0], pads[m, 1] - r[i, 1]
            gap = math.sqrt(north * north + east * east)
            if pads[m, 2] != 0.0 and gap < stand - SLOP:
                feel(arena, i, north, east, m + 1)
                push = (stand - gap) / max(gap, 1e-9)
                r[i, 0] -= push * north
                r[i, 1] -= push * east


@kernel
def crowded(arena, pads, near, cfg):
    """How many circles are within reach of another or of a solid aircraft; none: nothing touches.

    Args:
        near: receives 1 for each of them, shape (CIRCLES,).
        arena, pads, cfg: as in `touch`.
    """
    r, fate = arena["r_R_N"], arena["fate"]
    reach = 2.0 * cfg["robot_radius"]
    stand = cfg["robot_radius"] + cfg["aircraft_radius"]
    near[:] = 0
    for i in range(CIRCLES):
        if fate[i] != ACTIVE:
            continue
        for j in range(i + 1, CIRCLES):
            north, east = abs(r[j, 0] - r[i, 0]), abs(r[j, 1] - r[i, 1])
            if fate[j] != ACTIVE or north >= reach or east >= reach:
                continue
            if math.sqrt(north * north + east * east) < reach - SLOP:
                near[i] = near[j] = 1
        for m in range(pads.shape[0]):
            north, east = pads[m, 0] - r[i, 0], pads[m, 1] - r[i, 1]
            if pads[m, 2] != 0.0 and math.sqrt(north * north + east * east) < stand - SLOP:
                near[i] = 1
    return near.sum()
