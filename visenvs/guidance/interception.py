"""Where a ground robot will be, and when and where an aircraft can meet it.

A track tells place, heading, whether the robot spins, and the phase of its 20 s clock. From these
the way ahead is straight lines and half turns; swerves and bumps are not foreseen. Everything here
works on a record with the fields of the herding row, be it a belief or the environment's own.
"""

from __future__ import annotations

import math

from visenvs.core.compile import kernel

BLOCK, TAP = 0, 1  # services: land in front and be bumped; touch the top
POSE = 5  # numbers of a pose: north, east (m), heading (rad), phase (s), 1 where it drives
LEAD = 0.4  # between touchdown and the bump that is aimed at, s
SETTLE = 0.7  # of the position control at the end of a flight, s
CLOSE = 0.5  # the length in which that takes most of its time, m


@kernel
def pose_now(row, i, pose):
    """Write the pose of track i as it is believed now."""
    pose[0], pose[1] = row["track_r_N"][2 * i], row["track_r_N"][2 * i + 1]
    pose[2] = math.atan2(row["track_sin"][i], row["track_cos"][i])
    pose[3] = row["track_phase"][i]
    pose[4] = 0.0 if row["track_p_spin"][i] > 0.5 else 1.0


@kernel
def advance(pose, duration, cfg):
    """Move a pose ahead by a duration (s) as the firmware would without swerves and bumps.

    A spin that the clock does not explain is taken to be half over.

    Args:
        pose: (POSE,), changed in place.
        cfg: record with speed, spin_time, period.
    """
    left, rate = duration, math.pi / cfg["spin_time"]
    if pose[4] == 0.0:
        rest = cfg["spin_time"] - pose[3] if pose[3] < cfg["spin_time"] else 0.5 * cfg["spin_time"]
        spin = min(left, rest)
        pose[2] += rate * spin
        pose[3] += spin
        left -= spin
        if left <= 0.0:
            return
        pose[4] = 1.0
    while left > 0.0:
        run = min(left, max(cfg["period"] - pose[3], 0.0))
        pose[0] += cfg["speed"] * run * math.cos(pose[2])
        pose[1] += cfg["speed"] * run * math.sin(pose[2])
        pose[3] += run
        left -= run
        if left > 0.0:
            spin = min(left, cfg["spin_time"])
            pose[2] += rate * spin
            pose[3] = spin
            pose[4] = 1.0 if spin >= cfg["spin_time"] else 0.0
            left -= spin


@kernel
def flight_time(distance, cfg):
    """Time of a level flight from rest to rest, good to some tenths of a second, s.

    Args:
        distance: m.
        cfg: record with v_max, a_max.
    """
    return distance / cfg["v_max"] + SETTLE * (1.0 - math.exp(-distance / CLOSE))


@kernel
def descent_time(height, kind, cfg):
    """Time from a height (m) to the ground, or to a robot's top, s."""
    floor = cfg["top_height"] if kind == TAP else 0.0
    return max(height - floor, 0.0) / cfg["v_descent"]


@kernel
def aim_at(row, i, kind, ahead, cfg, pose, aim):
    """Write where to come down `ahead` seconds from now, and the robot's pose then.

    Args:
        row: record with the track fields.
        pose, aim: receive the pose (POSE,) and the point in N, m, (2,).
        cfg: record with the robots' and the aircraft's size, speed, spin_time and period.
    """
    pose_now(row, i, pose)
    advance(pose, ahead, cfg)
    aim[0], aim[1] = pose[0], pose[1]
    if kind == BLOCK:
        gap = cfg["robot_radius"] + cfg["aircraft_radius"] + LEAD * cfg["speed"]
        aim[0] += gap * math.cos(pose[2])
        aim[1] += gap * math.sin(pose[2])


@kernel
def meet(row, i, kind, delay, cfg, pose, aim):
    """When an aircraft can come down on or before robot i: time from now, s.

    Args:
        row: record with the track fields, `r_V_N` and `height`.
        kind: BLOCK or TAP.
        delay: to come so much later than possible, s.
        pose: receives the robot's pose when the aircraft comes down, (POSE,).
        aim: receives where to come down, N, m, (2,).
        cfg: record with the settings that `aim_at`, `flight_time` and `descent_time` read.
    """
    soonest = descent_time(row["height"], kind, cfg) + delay
    ahead, later = soonest, soonest
    for _ in range(5):
        ahead = later
        aim_at(row, i, kind, ahead, cfg, pose, aim)
        away = math.hypot(aim[0] - row["r_V_N"][0], aim[1] - row["r_V_N"][1])
        later = soonest + flight_time(away, cfg)
    return ahead
