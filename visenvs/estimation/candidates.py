"""Findings that are no track's: candidates, and what they turn out to be.

A single finding may be nothing, and the gate of a track long out of sight is wide. So what fits no
track in sight is followed by itself; found often enough, it is given to the track out of sight that
it fits best, by place and by velocity, or it makes a track anew. Candidates are kept in a bank
(`robot_track.bank_dtype`).
"""

from __future__ import annotations

import math

from visenvs.core.compile import kernel
from visenvs.core.frames import wrap_angle
from visenvs.estimation import mmae
from visenvs.estimation.association import assign
from visenvs.estimation.mmae import NEVER, STRAIGHT
from visenvs.estimation.robot_track import (
    ANY_HEADING,
    CANDIDATES,
    NONE,
    TRACKED,
    absorb,
    fit,
    moving,
    place,
    turn_to,
)
from visenvs.estimation.slope import SIGHTS, course, push, velocity

ALONE = 60.0  # price of a finding that is no track's: more than of any that is
OUT_OF_SIGHT = 0.45  # age at which a track goes on by what its robot should be doing, s
NEAR = 0.3  # how far a candidate may be found from where it was, m
SURE, HITS = 4, 5  # sights after which a candidate is something, and after which a track
PATIENCE = 4  # misses in a row that end it
TURNED = 0.1  # share of robots that have run into something while nobody saw them
SPINNING = 0.15  # probability of a spin of a robot found again, and of none, at least
STRANGE = 1e-3  # likelihood of a velocity below which the robot is another one


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
def settle(bank, variance, cfg, work):
    """Give the candidates found often enough to the tracks out of sight that they fit best.

    One that fits none makes a track anew once its course is known.
    """
    for c in range(CANDIDATES):
        for j in range(bank["status"].shape[0]):
            work["c_ztest"][c, j] = math.inf
            away = bank["status"][j] == TRACKED and bank["age"][j] > OUT_OF_SIGHT
            if away and bank["c_filled"][c] >= SURE:
                last = bank["c_sights"][c, int(bank["c_filled"][c]) - 1]
                likely = ways(bank, j, c, variance, cfg, work["ways"])
                value = fit(bank, j, last[1:], variance)
                if likely > STRANGE:
                    work["c_ztest"][c, j] = value - 2.0 * math.log(likely)
    assign(work["c_ztest"], CANDIDATES, ALONE, work["c_choice"], work["c_assign"])
    for c in range(CANDIDATES):
        if work["c_choice"][c] >= 0:
            find_again(bank, work["c_choice"][c], c, variance, cfg, work)
        elif bank["c_filled"][c] >= HITS:
            promote(bank, c, variance, cfg)


@kernel
def ways(bank, j, c, variance, cfg, out):
    """How likely the velocity of candidate c is for track j: at most 1 for one expected exactly.

    Args:
        out: receives the parts of it, (3,): the robot goes on, it has run into something and goes
            the other way, it spins.
    """
    north, east, spread = velocity(bank["c_sights"][c], int(bank["c_filled"][c]))
    heading, speed = bank["x"][j, STRAIGHT, 2], cfg["speed"]
    noise = variance / spread
    doubt = noise + speed * speed * min(bank["P"][j, STRAIGHT, 2, 2], 2.0)
    p_spin = min(max(bank["p_spin"][j], SPINNING), 1.0 - SPINNING)
    total = 0.0
    for k in range(3):
        along = speed if k == 0 else (-speed if k == 1 else 0.0)
        u, v = north - along * math.cos(heading), east - along * math.sin(heading)
        S = noise if k == 2 else doubt
        prior = p_spin if k == 2 else (1.0 - p_spin) * (TURNED if k == 1 else 1.0 - TURNED)
        out[k] = prior * noise / S * math.exp(-0.5 * (u * u + v * v) / S)
        total += out[k]
    return total


@kernel
def find_again(bank, j, c, variance, cfg, work):
    """Use candidate c for track j, out of sight until now."""
    x, P, filled = bank["x"][j], bank["P"][j], int(bank["c_filled"][c])
    total, part = ways(bank, j, c, variance, cfg, work["ways"]), work["ways"]
    p_spin = min(max(part[2] / total, mmae.LEAST), 1.0 - mmae.LEAST)
    if part[1] > part[0]:
        turn_to(x, P, wrap_angle(x[STRAIGHT, 2] + math.pi), math.sqrt(P[STRAIGHT, 2, 2]))
    bank["p_spin"][j] = p_spin
    if p_spin < 0.5:
        bank["spun"][j] = NEVER
    for i in range(filled):
        bank["sights"][j, i, :] = bank["c_sights"][c, i, :]
    bank["filled"][j], bank["c_filled"][c] = filled - 1, 0.0
    absorb(bank, j, bank["c_sights"][c, filled - 1, 1:], variance, cfg, work["filter"])


@kernel
def promote(bank, c, variance, cfg):
    """Make a track of candidate c once it is known whether it goes straight, and where to."""
    filled = int(bank["c_filled"][c])
    heading, speed, deviation = course(bank["c_sights"][c], filled, variance)
    goes = moving(speed, deviation, cfg)
    if not goes and filled < SIGHTS:
        return
    last = bank["c_sights"][c, filled - 1]
    j = likeliest(bank, last[1], last[2], cfg)
    if j < 0:
        return
    sd = deviation / speed if goes else ANY_HEADING
    place(bank, j, last[1], last[2], heading, math.sqrt(variance), sd)
    if not goes:
        bank["spun"][j], bank["turn"][j] = 0.5 * cfg["spin_time"], cfg["spin_time"]
        bank["p_spin"][j] = 1.0 - mmae.LEAST
    for i in range(filled):
        bank["sights"][j, i, :] = bank["c_sights"][c, i, :]
    bank["filled"][j], bank["c_filled"][c] = filled, 0.0


@kernel
def likeliest(bank, north, east, cfg):
    """The track out of sight whose robot has most probably come to a place; -1 if all are seen.

    Measured by how far it may have gone since it was seen.
    """
    best, least = -1, math.inf
    for j in range(bank["status"].shape[0]):
        if bank["age"][j] > OUT_OF_SIGHT or bank["status"][j] == NONE:
            away = math.hypot(north - bank["r_N"][j, 0], east - bank["r_N"][j, 1])
            share = away / (0.5 + bank["sd_r"][j] + 0.3 * cfg["speed"] * bank["age"][j])
            if share < least:
                best, least = j, share
    return best
