"""Findings that are no track's: candidates, and what they turn out to be.

A single finding may be nothing, and a robot long out of sight may be in many places. So what fits
no track in sight is followed by itself; found often enough, it is given to the track out of sight
that it fits best, by place and by velocity. Candidates are kept in a bank (`robot_track`).
"""

from __future__ import annotations

import math

from visenvs.core.compile import kernel
from visenvs.core.frames import wrap_angle
from visenvs.estimation.association import assign
from visenvs.estimation.robot_track import (
    ANY_HEADING,
    CANDIDATES,
    FINISHED,
    NONE,
    TRACKED,
    moving,
    place,
    variance_at,
)
from visenvs.estimation.slope import SIGHTS, course, push, velocity
from visenvs.estimation.whereabouts import HEADING, LEFT, PHASE, density

ALONE = 60.0  # price of a candidate that is no track's: more than of any that is
OFFSET = 10.0  # makes prices positive
OUT_OF_SIGHT = 0.45  # age at which a track is guessed at, s
NEAR = 0.3  # how far a candidate may be found from where it was, m
SURE = 4  # sights after which a candidate is something
PATIENCE = 4  # misses in a row that end it
ANYWHERE = 5e-5  # density of a robot that is nowhere near where it was guessed to be, 1/m^2,
UNKNOWN = 2.5e-3  # of one of which nothing is known,
RETURNED = 1e-6  # and of one that was thought to have left the arena
GUESSED = 0.4  # standard deviation of a guessed heading, rad


@kernel
def follow(bank, seen, count, choice):
    """Keep the candidates with the findings that are no track's, which begin new ones.

    Args:
        choice: of each finding, below 0 for no track's; changed where a candidate takes it.
    """
    taken = bank["status"].shape[0]
    for c in range(CANDIDATES):
        filled = int(bank["c_filled"][c])
        if filled == 0:
            continue
        last, nearest, best = bank["c_sights"][c, filled - 1], NEAR, -1
        for i in range(count):
            away = math.hypot(seen[i, 0] - last[1], seen[i, 1] - last[2])
            if choice[i] < 0 and away < nearest:
                nearest, best = away, i
        if best < 0:
            bank["c_missed"][c] += 1.0
            bank["c_filled"][c] = 0.0 if bank["c_missed"][c] >= PATIENCE else filled
            continue
        choice[best], bank["c_missed"][c] = taken, 0.0
        bank["c_filled"][c] = push(bank["c_sights"][c], filled, bank["t"], seen[best])
    for i in range(count):
        for c in range(CANDIDATES):
            if choice[i] < 0 and bank["c_filled"][c] == 0.0:
                bank["c_filled"][c] = push(bank["c_sights"][c], 0, bank["t"], seen[i])
                bank["c_missed"][c], choice[i] = 0.0, taken


@kernel
def settle(bank, pose, cfg, work):
    """Give the candidates found often enough to the tracks that they are most likely of.

    Every robot has a track, so each of them is of one that is out of sight. Pose: of the camera.
    """
    for c in range(CANDIDATES):
        filled = int(bank["c_filled"][c])
        for j in range(bank["status"].shape[0]):
            work["c_ztest"][c, j] = math.inf
            if filled >= SURE and (bank["status"][j] != TRACKED or bank["away"][j] > 0.0):
                likely, _ = likelihood(bank, j, c, variance_of(bank, c, pose, cfg), cfg)
                work["c_ztest"][c, j] = OFFSET - 2.0 * math.log(likely)
    assign(work["c_ztest"], CANDIDATES, ALONE, work["c_choice"], work["c_assign"])
    for c in range(CANDIDATES):
        if work["c_choice"][c] >= 0:
            find_again(bank, work["c_choice"][c], c, variance_of(bank, c, pose, cfg), cfg)


@kernel
def variance_of(bank, c, pose, cfg):
    """Variance of a sight of candidate c, as assumed where it was last, m^2."""
    return variance_at(pose, bank["c_sights"][c, int(bank["c_filled"][c]) - 1, 1:], cfg)


@kernel
def likelihood(bank, j, c, variance, cfg):
    """How likely candidate c is for track j, 1/m^2, and the guess that speaks for it, or -1."""
    if bank["status"][j] == NONE:
        return UNKNOWN, -1
    if bank["status"][j] == FINISHED:
        return RETURNED, -1
    filled = int(bank["c_filled"][c])
    north, east, spread = velocity(bank["c_sights"][c], filled)
    last = bank["c_sights"][c, filled - 1, 1:]
    value, guess = density(bank, j, last, north, east, variance / spread, cfg)
    return value + ANYWHERE, guess if value > ANYWHERE else -1


@kernel
def find_again(bank, j, c, variance, cfg):
    """Make candidate c track j: by the guess that speaks for it, else by its course alone.

    Without a guess it must have been seen for long enough to tell its course, or that it spins.
    """
    filled, sights = int(bank["c_filled"][c]), bank["c_sights"][c]
    heading, speed, deviation = course(sights, filled, variance)
    goes, guess = moving(speed, deviation, cfg), likelihood(bank, j, c, variance, cfg)[1]
    if guess < 0 and not goes and filled < SIGHTS:
        return
    sd, left = deviation / max(speed, 1e-3), 0.0
    if guess >= 0:
        g = bank["guesses"][j, guess]
        left, bank["phase"][j] = g[LEFT], g[PHASE]
        guessed = g[HEADING] - math.pi * left / cfg["spin_time"]
        off = wrap_angle(heading - guessed)
        share = GUESSED**2 / (GUESSED**2 + sd * sd)
        if left > 0.0 or (abs(off) > 0.5 * math.pi and not goes):
            share = 0.0
        heading, sd = wrap_angle(guessed + share * off), GUESSED * math.sqrt(1.0 - share)
        if abs(off) > 0.5 * math.pi and goes:
            heading, sd, left = wrap_angle(guessed + off), deviation / speed, 0.0
    elif not goes:
        left, sd = 0.5 * cfg["spin_time"], ANY_HEADING
    last = sights[filled - 1]
    place(bank, j, last[1], last[2], heading, math.sqrt(variance), sd)
    if left > 0.0:
        bank["spun"][j], bank["turn"][j] = cfg["spin_time"] - left, cfg["spin_time"]
        bank["p_spin"][j] = 0.9
    for i in range(filled):
        bank["sights"][j, i, :] = sights[i, :]
    bank["filled"][j], bank["c_filled"][c] = filled, 0.0
