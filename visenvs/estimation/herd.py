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
    status      NONE (0): nobody's, or lost; TRACKED (1); FINISHED (2): it has left the arena

The rest is the tracks' own business. To use it: `start` at the beginning of an episode, then
`place` for each robot whose pose is known; `step` at each picture (`sensors.ground_camera.look`),
with `dt` the time since the last one; `tell` when the aircraft has stopped or touched a robot. In
`r_O_N` the caller may keep the places of obstacles, which explain a bump; far away by default.

There are as many robots as rows. A finding goes to the track that it fits best, by likelihood: what
fits none is a candidate, and one found again and again takes the row of the robot that it most
probably is. A track that should have been found and was not is lost.

Settings: a record with what `ground_camera` and `robot_clock` need, and side (of the arena, m).
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from visenvs.core.compile import kernel
from visenvs.estimation import mmae, robot_clock
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
)
from visenvs.sensors.ground_camera import FALSE, in_view, pixel_size

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

MISSED = 1e-6  # chance of not being found so often, below which a track is lost
LOST_SD = 2.5  # standard deviation of the place above which it is lost, m
BEYOND = 0.2  # how far behind the edge a robot out of sight must be to have left, m
LEAST_SD = 0.004  # of a finding, as assumed, m


def work_dtype(slots: int = 10) -> np.dtype[Any]:
    """Scratch record for a bank of so many tracks, for pictures of as many robots."""
    rows = slots + FALSE
    return np.dtype(
        [
            ("filter", mmae.SCRATCH),
            ("ztest", "f8", (rows, slots)),
            ("choice", "i8", (rows,)),
            ("assign", "f8", assign_scratch(rows, slots)),
            ("c_ztest", "f8", (CANDIDATES, slots)),
            ("ways", "f8", (3,)),
            ("c_choice", "i8", (CANDIDATES,)),
            ("c_assign", "f8", assign_scratch(CANDIDATES, slots)),
        ]
    )


@kernel
def start(bank):
    """Empty a bank at the time when all robots are started."""
    slots = bank["status"].shape[0]
    bank["t"] = 0.0
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
        pose: of the camera, (4,), as of `ground_camera`.
        cfg, work: settings, and a record of `work_dtype`.
    """
    bank["t"] += dt
    variance = max(cfg["sigma_pixel"] * pixel_size(pose, cfg), LEAST_SD) ** 2
    for j in range(bank["status"].shape[0]):
        advance(bank, j, dt, cfg)
    compare(bank, seen, count, variance, work["ztest"])
    assign(work["ztest"], count, ALONE, work["choice"], work["assign"])
    for j in range(bank["status"].shape[0]):
        bank["age"][j] += dt
    for i in range(count):
        j = work["choice"][i]
        if j >= 0:
            absorb(bank, j, seen[i], variance, cfg, work["filter"])
    follow(bank, seen, count, work["choice"])
    settle(bank, variance, cfg, work)
    for j in range(bank["status"].shape[0]):
        if bank["status"][j] == TRACKED:
            report(bank, j)
            give_up(bank, j, pose, dt, cfg)


@kernel
def advance(bank, j, dt, cfg):
    """Predict track j, or go on by its clock where it is out of sight."""
    bank["phase"][j] += dt
    if bank["status"][j] == TRACKED and bank["age"][j] < OUT_OF_SIGHT:
        mmae.predict(bank["x"][j], bank["P"][j], dt, cfg)
        bank["spun"][j] += dt if bank["spun"][j] >= 0.0 else 0.0
    elif bank["status"][j] == TRACKED:
        robot_clock.coast(bank, j, dt, cfg)
    elif bank["phase"][j] >= cfg["period"]:
        bank["phase"][j] -= cfg["period"]


@kernel
def compare(bank, seen, count, variance, ztest):
    """Write the likelihood of every finding for every track in sight, as `fit`; else inf."""
    for j in range(bank["status"].shape[0]):
        in_sight = bank["status"][j] == TRACKED and bank["age"][j] < OUT_OF_SIGHT
        for i in range(count):
            ztest[i, j] = fit(bank, j, seen[i], variance) if in_sight else math.inf


@kernel
def give_up(bank, j, pose, dt, cfg):
    """Whether track j has left the arena, or is lost."""
    north, east = bank["r_N"][j, 0], bank["r_N"][j, 1]
    outside = max(abs(north), abs(east)) - 0.5 * cfg["side"]
    if bank["age"][j] == 0.0:
        return
    if in_view(pose, north, east, 2.0 * bank["sd_r"][j], cfg):
        bank["missed"][j] -= math.log(max(1.0 - cfg["p_detect"], 0.05))
    missed = bank["missed"][j] > -math.log(MISSED)
    if outside > BEYOND or (missed and outside > -BEYOND):
        bank["status"][j] = FINISHED
    elif missed or bank["sd_r"][j] > LOST_SD:
        bank["status"][j] = NONE
