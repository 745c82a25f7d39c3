"""One track of a ground robot, a row of a bank: the record, and how a finding is used for it.

`herd` says what the fields are, and how a bank is used.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from visenvs.core.compile import kernel
from visenvs.core.frames import wrap_angle
from visenvs.estimation import mmae, robot_clock
from visenvs.estimation.mmae import NEVER, SPIN, STRAIGHT
from visenvs.estimation.slope import SIGHTS, course, push
from visenvs.estimation.whereabouts import GONE, GUESSES, turn_guesses
from visenvs.sensors.ground_camera import pixel_size, stretch

NONE, TRACKED, FINISHED = 0.0, 1.0, 2.0
CANDIDATES, OTHERS = 12, 4
GATE = 11.8  # z-test value of a place that is a track's, chi-square of 2 at 99.7 %
MOVING = 0.65  # share of the speed above which a robot goes straight,
DOUBTFUL = 0.3  # if its standard deviation is below this share
WRONG = math.radians(50.0)  # heading error that the course of the last sights convicts of
LEAST_SD = 0.004  # of a finding, as assumed, m
ANY_HEADING = math.pi / math.sqrt(3.0)  # standard deviation of a heading of which nothing is known


def bank_dtype(slots: int = 10) -> np.dtype[Any]:
    """Record of a bank of so many tracks."""
    if slots < 1:
        raise ValueError(f"slots={slots}: a bank holds at least one track; write `bank_dtype(10)`")
    names = ("heading", "p_spin", "phase", "sd_r", "sd_heading", "sd_phase", "age", "status")
    own = ("spun", "turn", "filled", "away", "leader")
    return np.dtype(
        [
            ("r_N", "f8", (slots, 2)),
            *((name, "f8", (slots,)) for name in names + own),
            ("x", "f8", (slots, 2, 3)),  # of both models
            ("P", "f8", (slots, 2, 3, 3)),
            ("sights", "f8", (slots, SIGHTS, 3)),
            ("c_filled", "f8", (CANDIDATES,)),  # sights of candidates; 0 where there is none
            ("c_missed", "f8", (CANDIDATES,)),
            ("c_sights", "f8", (CANDIDATES, SIGHTS, 3)),
            ("r_O_N", "f8", (OTHERS, 2)),
            ("guesses", "f8", (slots, GUESSES, GONE + 1)),  # while out of sight (`whereabouts`)
            *((name, "f8") for name in ("t", "picture")),
        ]
    )


@kernel
def place(bank, j, north, east, heading, sd_r, sd_heading):
    """Begin track j at a pose of these standard deviations (m, rad), going straight."""
    for mode in range(2):
        x, P = bank["x"][j, mode], bank["P"][j, mode]
        x[0], x[1], x[2] = north, east, heading
        P[:] = 0.0
        P[0, 0] = P[1, 1] = sd_r * sd_r
        P[2, 2] = sd_heading * sd_heading
    bank["p_spin"][j], bank["spun"][j], bank["status"][j] = mmae.LEAST, NEVER, TRACKED
    bank["age"][j] = bank["away"][j] = bank["filled"][j] = 0.0
    report(bank, j)


@kernel
def tell(bank, j, half_turn, cfg):
    """Note that the aircraft has just made robot j spin: by half a turn, or by a touch's 45 deg."""
    angle = math.pi if half_turn else 0.25 * math.pi
    turn_guesses(bank, j, angle, cfg)
    winner = STRAIGHT if bank["spun"][j] < 0.0 else SPIN
    mmae.inherit(bank["x"][j], bank["P"][j], winner, 1 - winner, 0.0)
    bank["spun"][j], bank["p_spin"][j] = 0.0, 1.0 - mmae.LEAST
    bank["turn"][j] = cfg["spin_time"] * angle / math.pi
    if half_turn and cfg["bump_restarts_timer"]:
        bank["phase"][j], bank["sd_phase"][j] = 0.0, robot_clock.SEEN


@kernel
def variance_at(pose, place, cfg):
    """Variance of a finding at a place along either axis, as assumed, m^2."""
    sd = cfg["sigma_pixel"] * pixel_size(pose, cfg) * stretch(pose, place[0], place[1])
    return max(sd, LEAST_SD) ** 2


@kernel
def fit(bank, j, place, variance):
    """z-test value of a place for track j, plus ln |S| over that of the noise; inf beyond GATE.

    Between tracks of different precision it is the likelihood that decides, not the distance.
    """
    model = SPIN if bank["p_spin"][j] > 0.5 else STRAIGHT
    x, P = bank["x"][j, model], bank["P"][j, model]
    a, b, c = P[0, 0] + variance, P[0, 1], P[1, 1] + variance
    u, v, det = place[0] - x[0], place[1] - x[1], a * c - b * b
    value = (c * u * u - 2.0 * b * u * v + a * v * v) / det
    return value + math.log(det / (variance * variance)) if value <= GATE else math.inf


@kernel
def absorb(bank, j, place, variance, turned, cfg, scratch):
    """Use a finding for track j, and what it tells of spins and of the clock.

    turned: heading found (rad) and its variance, 0 for none, (2,).
    """
    x, P = bank["x"][j], bank["P"][j]
    bank["age"][j] = 0.0
    spun = bank["spun"][j]
    least, most = mmae.LEAST, 1.0 - mmae.LEAST
    p_spin = mmae.update(x, P, bank["p_spin"][j], place, variance, least, most, scratch)
    if turned[1] > 0.0:
        p_spin = mmae.update_heading(x, P, p_spin, turned[0], turned[1], least, most, scratch)
    bank["p_spin"][j], bank["spun"][j] = p_spin, mmae.hand_over(x, P, p_spin, spun)
    if spun < 0.0 <= bank["spun"][j]:
        robot_clock.note_spin(bank, j, cfg)
    elif spun >= 0.0:
        robot_clock.note_double(bank, j, cfg)
        robot_clock.note_restart(bank, j, cfg)
    else:
        robot_clock.note_overdue(bank, j, cfg)
    filled = push(bank["sights"][j], int(bank["filled"][j]), bank["t"], place)
    bank["filled"][j] = filled
    check_heading(bank, j, filled, variance, cfg)


@kernel
def check_heading(bank, j, filled, variance, cfg):
    """Let the course of the last sights correct the heading of a track that is plainly wrong."""
    x, P = bank["x"][j], bank["P"][j]
    heading, speed, deviation = course(bank["sights"][j], filled, variance)
    off = abs(wrap_angle(heading - x[STRAIGHT, 2]))
    if filled == SIGHTS and moving(speed, deviation, cfg) and off > WRONG:
        turn_to(x, P, heading, deviation / speed)
        bank["spun"][j], bank["p_spin"][j] = NEVER, mmae.LEAST


@kernel
def moving(speed, deviation, cfg):
    """Whether a robot seen at this speed goes straight, in as much as the sights can tell."""
    return speed > MOVING * cfg["speed"] and deviation < DOUBTFUL * cfg["speed"]


@kernel
def turn_to(x, P, heading, deviation):
    """Replace the heading of both models by one of that standard deviation, rad."""
    for mode in range(2):
        x[mode, 2] = heading
        for i in range(2):
            P[mode, i, 2] = P[mode, 2, i] = 0.0
        P[mode, 2, 2] = deviation * deviation


@kernel
def report(bank, j):
    """Write the public figures of track j from the likelier model."""
    model = SPIN if bank["p_spin"][j] > 0.5 else STRAIGHT
    x, P = bank["x"][j, model], bank["P"][j, model]
    bank["r_N"][j, 0], bank["r_N"][j, 1], bank["heading"][j] = x[0], x[1], wrap_angle(x[2])
    bank["sd_r"][j] = math.sqrt(0.5 * (P[0, 0] + P[1, 1]))
    bank["sd_heading"][j] = min(math.sqrt(P[2, 2]), ANY_HEADING)
