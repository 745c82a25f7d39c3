"""Ten tracks of the herd, from what a camera that looks down finds: a two-model filter for each.

A track is one row of a bank (`bank_dtype`):

    r_N         place (north, east), m, (2,)
    heading     rad, clockwise from north
    p_spin      probability that the robot is spinning
    phase       time since its last reversal by the 20 s timer, s (`robot_clock`)
    sd_r        standard deviation of the place along either axis, m
    sd_heading  rad, at most that of a heading of which nothing is known
    sd_phase    s
    age         time since it was last seen, s
    status      NONE (0): nobody's yet; TRACKED (1); FINISHED (2): it has left the arena

The rest is the tracks' own business. To use it: `start` at the beginning of an episode, then
`place` for each robot whose pose is known; `step` at each picture (`sensors.ground_camera.look`),
with `dt` the time since the last one; `tell` when the aircraft has stopped or touched a robot. In
`r_O_N` the caller may keep the places of obstacles, which explain a bump; far away by default.

There are as many robots as rows. A finding goes to the track that it fits best, by likelihood: what
fits none is a candidate, and one found again and again takes the row of the robot that it most
probably is (`candidates`). A robot out of sight is guessed at (`whereabouts`): its track shows the
most central guess, and one after the other dies where the camera looks and finds nobody.

Settings: a record with what `ground_camera` and `robot_clock` need, and side (of the arena, m).
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from visenvs.core.compile import kernel
from visenvs.estimation import mmae
from visenvs.estimation.association import assign, assign_scratch
from visenvs.estimation.candidates import ALONE, OUT_OF_SIGHT, follow, settle
from visenvs.estimation.mmae import NEVER
from visenvs.estimation.robot_track import (
    ANY_HEADING,
    CANDIDATES,
    FINISHED,
    NONE,
    TRACKED,
    absorb,
    bank_dtype,
    fit,
    place,
    report,
    tell,
    variance_at,
)
from visenvs.estimation.whereabouts import carry_on, doubt, scatter, show
from visenvs.sensors.ground_camera import FALSE

__all__ = [
    "FINISHED",
    "NONE",
    "TRACKED",
    "bank_dtype",
    "place",
    "start",
    "step",
    "tell",
    "work_dtype",
]

LOST_SD = 6.0  # standard deviation of a place of which nothing is known, m
DELAYED = 0.1  # how much less is known of a timer each second out of sight, s/s^(1/2)


def work_dtype(slots: int = 10) -> np.dtype[Any]:
    """Scratch record for a bank of so many tracks, for pictures of as many robots."""
    rows = slots + FALSE
    return np.dtype(
        [
            ("filter", mmae.SCRATCH),
            ("turned", "f8", (rows, 2)),
            ("variance", "f8", (rows,)),
            ("ztest", "f8", (rows, slots)),
            ("choice", "i8", (rows,)),
            ("assign", "f8", assign_scratch(rows, slots)),
            ("c_ztest", "f8", (CANDIDATES, slots)),
            ("c_choice", "i8", (CANDIDATES,)),
            ("c_assign", "f8", assign_scratch(CANDIDATES, slots)),
        ]
    )


@kernel
def start(bank):
    """Empty a bank at the time when all robots are started."""
    slots = bank["status"].shape[0]
    bank["t"] = bank["picture"] = 0.0
    bank["r_O_N"][:] = math.inf
    bank["c_filled"][:] = 0.0
    for j in range(slots):
        bank["status"][j], bank["phase"][j], bank["sd_phase"][j] = NONE, 0.0, 0.0
        bank["age"][j] = bank["r_N"][j, 0] = bank["r_N"][j, 1] = 0.0
        bank["heading"][j], bank["p_spin"][j], bank["spun"][j] = 0.0, mmae.LEAST, NEVER
        bank["sd_r"][j], bank["sd_heading"][j] = LOST_SD, ANY_HEADING


@kernel
def step(bank, seen, count, pose, dt, cfg, work):
    """Carry all tracks on by `dt` s to a picture, and use what it shows.

    Args:
        seen: places found (north, east), m, (rows, 2), of which `count` are in use.
        pose: of the camera, (4, 3), as of `ground_camera`.
        cfg, work: settings, and a record of `work_dtype`; work["turned"], (rows, 2), holds the
            heading found (rad) with each place and its variance, 0 for none.
    """
    bank["t"] += dt
    bank["picture"] += 1.0
    for i in range(count):
        work["variance"][i] = variance_at(pose, seen[i], cfg)
    for j in range(bank["status"].shape[0]):
        advance(bank, j, dt, cfg)
    compare(bank, seen, count, work["variance"], work["ztest"])
    assign(work["ztest"], count, ALONE, work["choice"], work["assign"])
    for i in range(count):
        j = work["choice"][i]
        if j >= 0:
            variance, turned = work["variance"][i], work["turned"][i]
            absorb(bank, j, seen[i], variance, turned, cfg, work["filter"])
    follow(bank, seen, count, work["choice"])
    settle(bank, pose, cfg, work)
    for j in range(bank["status"].shape[0]):
        if bank["status"][j] == TRACKED:
            conclude(bank, j, pose, cfg)


@kernel
def advance(bank, j, dt, cfg):
    """Predict track j, or let its guesses live on where it is out of sight."""
    bank["age"][j] += dt
    bank["phase"][j] += dt
    if bank["status"][j] != TRACKED:
        bank["phase"][j] -= cfg["period"] if bank["phase"][j] >= cfg["period"] else 0.0
    elif bank["away"][j] > 0.0:
        carry_on(bank, j, dt, cfg)
        bank["sd_phase"][j] = math.hypot(bank["sd_phase"][j], DELAYED * math.sqrt(dt))
    else:
        mmae.predict(bank["x"][j], bank["P"][j], dt, cfg)
        bank["spun"][j] += dt if bank["spun"][j] >= 0.0 else 0.0


@kernel
def conclude(bank, j, pose, cfg):
    """Write the public figures of track j, from its filters or its guesses, or end it."""
    if bank["away"][j] == 0.0 and bank["age"][j] > OUT_OF_SIGHT:
        scatter(bank, j, cfg)
    if bank["away"][j] == 0.0:
        report(bank, j)
    elif doubt(bank, j, pose, cfg):
        bank["status"][j] = FINISHED
    else:
        show(bank, j, cfg)


@kernel
def compare(bank, seen, count, variance, ztest):
    """Write the likelihood of every finding for every track in sight, as `fit`; else inf."""
    for j in range(bank["status"].shape[0]):
        in_sight = bank["status"][j] == TRACKED and bank["away"][j] == 0.0
        for i in range(count):
            ztest[i, j] = fit(bank, j, seen[i], variance[i]) if in_sight else math.inf
