"""The ground robots of IARC Mission 7: the official firmware's state machine, on wheels that grip.

A robot drives straight at constant speed. Every 20 s it reverses in place, every 5 s it swerves for
a moment, a bump of its front bumper reverses it, a touch on its top turns it by 45 degrees. Which
goes first is the firmware's order of checks:

    RUN      touch, the 20 s timer, the 5 s timer, bump
    NOISE    touch, end, bump
    REVERSE  touch, end (a bump is ignored)
    TOUCH    end, bump

The timer of the reversals runs on through bumps and touches and is looked at in RUN only, so that
all robots, started at once, reverse together. `bump_restarts_timer` is the other reading, that of
two teams' simulators. Turns are clockwise, and end when their time is over, not when an angle is
reached; between two changes of mode the motion is exact (straight lines, arcs, spins in place).

All robots, then the obstacle robots, share arrays: row k < ROBOTS is a robot, the rest obstacles.
"""

from __future__ import annotations

import math

from visenvs.core.compile import kernel
from visenvs.core.noise import uniform

ROBOTS, OBSTACLES = 10, 4
CIRCLES = ROBOTS + OBSTACLES
RUN, NOISE, REVERSE, TOUCH = 0, 1, 2, 3  # modes
ABSENT, ACTIVE, GOALED, REMOVED = 0, 1, 2, 3  # fates
PRESSED = 0.005  # gap that a bumper closes, m
WHEELS = 0  # noise stream: wheel offsets
OFFSETS = 32  # the wheel offset is one of -32, ..., 31 thirty-seconds of the largest

COLUMNS = [
    ("t", "f8"), ("tick", "i8"),  # s, and in ticks
    ("r_R_N", "f8", (CIRCLES, 2)), ("heading", "f8", (CIRCLES,)),  # truth, m and rad
    ("fate", "i8", (CIRCLES,)),
    ("mode", "i8", (ROBOTS,)), ("mode_t", "f8", (ROBOTS,)),  # mode, and when it began, s
    ("noise_t", "f8", (ROBOTS,)), ("reversal_t", "f8", (ROBOTS,)),  # last swerve, last reversal, s
    ("swerve", "f8", (ROBOTS,)),  # turn rate of the swerve, rad/s
    ("bumped", "i8", (CIRCLES,)), ("tapped", "i8", (ROBOTS,)),  # bumper pressed, top touched
    ("met", "i8", (ROBOTS,)),  # 1 + the aircraft on the ground that the front bumper meets, or 0
    ("touched", "i8", (ROBOTS,)),  # 1 where an aircraft has turned it
]  # fmt: skip


@kernel
def turn_rate(arena, k, cfg):
    """Turn rate of robot k in its present mode, clockwise positive, rad/s."""
    mode = arena["mode"][k]
    if mode == RUN:
        return 0.0
    if mode == NOISE:
        return arena["swerve"][k]
    return math.pi / cfg["spin_time"]


@kernel
def mode_end(arena, k, cfg):
    """When robot k leaves its present mode if nothing touches it, s."""
    mode, began = arena["mode"][k], arena["mode_t"][k]
    if mode == RUN:
        return min(arena["reversal_t"][k] + cfg["period"], arena["noise_t"][k] + cfg["noise_every"])
    if mode == NOISE:
        return began + cfg["noise_time"]
    if mode == REVERSE:
        return began + cfg["spin_time"]
    return began + 0.25 * cfg["spin_time"]


@kernel
def enter(arena, k, mode, t):
    """Robot k changes its mode at time t."""
    arena["mode"][k] = mode
    arena["mode_t"][k] = t


@kernel
def swerve_rate(arena, k, cfg):
    """Draw the turn rate of a swerve: a whole number of steps, at most `noise_max` in its time."""
    u = uniform(arena["seed"], arena["episode"], WHEELS, arena["tick"], k)
    offset = math.floor(2 * OFFSETS * u) - OFFSETS
    return offset / OFFSETS * cfg["noise_max"] / cfg["noise_time"]


@kernel
def reverse_on_bump(arena, k, cfg, t):
    """The bumper's half turn; whether the 20 s timer notices is a question of rules."""
    enter(arena, k, REVERSE, t)
    if cfg["bump_restarts_timer"]:
        arena["reversal_t"][k] = t


@kernel
def switch(arena, k, cfg, t, touch, bump):
    """One pass of the firmware's loop for robot k at time t: at most one change of mode."""
    mode = arena["mode"][k]
    over = t >= mode_end(arena, k, cfg)
    if touch and mode != TOUCH:
        enter(arena, k, TOUCH, t)
    elif mode == RUN:
        if t >= arena["reversal_t"][k] + cfg["period"]:
            arena["reversal_t"][k] = t
            enter(arena, k, REVERSE, t)
        elif over:
            arena["noise_t"][k] = t
            arena["swerve"][k] = swerve_rate(arena, k, cfg)
            enter(arena, k, NOISE, t)
        elif bump:
            reverse_on_bump(arena, k, cfg, t)
    elif over:
        enter(arena, k, RUN, t)
    elif bump and mode != REVERSE:
        reverse_on_bump(arena, k, cfg, t)


@kernel
def roll(arena, k, rate, speed, dt):
    """Move circle k along an arc for dt s; exact."""
    half = 0.5 * rate * dt
    chord = speed * dt * (math.sin(half) / half if half != 0.0 else 1.0)
    middle = arena["heading"][k] + half
    arena["r_R_N"][k, 0] += chord * math.cos(middle)
    arena["r_R_N"][k, 1] += chord * math.sin(middle)
    arena["heading"][k] += rate * dt


@kernel
def drive_robot(arena, k, cfg):
    """Robot k for one tick, as if alone: what its switches say, then every change on its way."""
    t, end = arena["t"], arena["t"] + cfg["tick"]
    switch(arena, k, cfg, t, arena["tapped"][k] != 0, arena["bumped"][k] != 0)
    while t < end:
        stop = min(max(mode_end(arena, k, cfg), t), end)
        driving = arena["mode"][k] == RUN or arena["mode"][k] == NOISE
        roll(arena, k, turn_rate(arena, k, cfg), cfg["speed"] if driving else 0.0, stop - t)
        t = stop
        if t < end:
            switch(arena, k, cfg, t, False, False)


@kernel
def blocked(arena, k, cfg):
    """Whether the bumper of circle k is pressed, or touches another circle."""
    r, heading = arena["r_R_N"], arena["heading"][k]
    ahead, right = math.cos(heading), math.sin(heading)
    for j in range(CIRCLES):
        if j != k and arena["fate"][j] == ACTIVE:
            north, east = r[j, 0] - r[k, 0], r[j, 1] - r[k, 1]
            reach = 2.0 * cfg["robot_radius"] + PRESSED
            close = north * north + east * east < reach * reach
            if close and north * ahead + east * right > 0.0:
                return True
    return arena["bumped"][k] != 0


@kernel
def drive_all(arena, cfg):
    """All robots and obstacles for one tick, each as if alone; clears the switches they have read.

    Obstacles circle the centre clockwise and stand while their bumper is pressed.
    """
    for k in range(CIRCLES):
        if arena["fate"][k] == ACTIVE:
            if k < ROBOTS:
                drive_robot(arena, k, cfg)
            elif not blocked(arena, k, cfg):
                roll(arena, k, cfg["speed"] / cfg["obstacle_circle"], cfg["speed"], cfg["tick"])
        arena["bumped"][k] = 0
        if k < ROBOTS:
            arena["tapped"][k] = arena["met"][k] = 0


@kernel
def spinning(arena, k):
    """Whether robot k turns in place."""
    return arena["mode"][k] == REVERSE or arena["mode"][k] == TOUCH
