"""Two filters of one ground robot, one for each way it moves, and how probable each is (IARC III).

State of each: north, east (m), heading (rad), (3,). STRAIGHT is (27), SPIN is (28); the robot's
place is measured, and, where a picture shows it, its heading. Row 0 of `x` (2, 3) and `P` (2, 3, 3)
is STRAIGHT, row 1 SPIN.

The paper's models never tell each other anything, so that after a spin STRAIGHT has still the old
heading and has to turn it about by its residuals, and the heading of SPIN, of which its
measurements tell nothing, is anyone's. `hand_over` mends that where the winner changes: SPIN starts
from the heading at its beginning and turns it at the known rate, and STRAIGHT goes on from there.

Settings: a record with speed (m/s) and spin_time, that of half a turn (s).
"""

from __future__ import annotations

import math

import numpy as np

from visenvs.core.compile import kernel
from visenvs.core.frames import wrap_angle
from visenvs.estimation.ekf import update_scalar, update_sequential

STRAIGHT, SPIN = 0, 1
Q_PLACE = 0.02**2  # process noise of the place, m^2/s (27), (28)
Q_HEADING = 0.25**2  # of the heading while going straight: wide enough for the turns, rad^2/s
Q_SPINNING = 0.05**2  # of the heading while spinning, rad^2/s
LEAST = 0.01  # probability that a mode keeps at least
QUIET = 0.2  # probability of a spin below which none is on its way
ONSET = 0.2  # how long a spin has lasted when it is found, s
PARTED = 0.03  # how far the loser may lag behind, m
TURNED_GATE = 11.8  # squared residual in deviations up to which a heading is believed
NEVER = -1.0  # `spun` of a robot that goes straight

SCRATCH = np.dtype(
    [
        ("H", "f8", (2, 3)),
        ("residual", "f8", (2,)),
        ("variance", "f8", (2,)),
        ("B", "f8", (2, 3)),
        ("S", "f8", (2,)),
        ("log", "f8", (2,)),
    ]
)


@kernel
def predict_straight(x, P, dt, q_place, q_heading, cfg):
    """Carry a state (3,) and its covariance on by (27), F = I + dt A, in place; Q is per second."""
    along = cfg["speed"] * dt
    a, b = -along * math.sin(x[2]), along * math.cos(x[2])
    x[0] += b
    x[1] -= a
    P[0, 0] += 2.0 * a * P[0, 2] + a * a * P[2, 2] + q_place * dt
    P[1, 1] += 2.0 * b * P[1, 2] + b * b * P[2, 2] + q_place * dt
    P[0, 1] += a * P[1, 2] + b * P[0, 2] + a * b * P[2, 2]
    P[0, 2] += a * P[2, 2]
    P[1, 2] += b * P[2, 2]
    P[2, 2] += q_heading * dt
    P[1, 0], P[2, 0], P[2, 1] = P[0, 1], P[0, 2], P[1, 2]


@kernel
def predict_spin(x, P, dt, cfg):
    """Carry a state (3,) and its covariance on by (28), in place."""
    x[2] = wrap_angle(x[2] + math.pi * dt / cfg["spin_time"])
    P[0, 0] += Q_PLACE * dt
    P[1, 1] += Q_PLACE * dt
    P[2, 2] += Q_SPINNING * dt


@kernel
def predict(x, P, dt, cfg):
    """Carry both models on by `dt` s, in place."""
    predict_straight(x[STRAIGHT], P[STRAIGHT], dt, Q_PLACE, Q_HEADING, cfg)
    predict_spin(x[SPIN], P[SPIN], dt, cfg)


@kernel
def update_place(x, P, place, variance, scratch):
    """Use a measured place (m, (2,)) in one model, in place; returns ln pdf + ln 2 pi (22).

    variance: of either coordinate, m^2.
    """
    H = scratch["H"]
    H[:] = 0.0
    for i in range(2):
        H[i, i], scratch["variance"][i] = 1.0, variance
        scratch["residual"][i] = place[i] - x[i]
    B, S = scratch["B"], scratch["S"]
    nis = update_sequential(x, P, H, scratch["residual"], scratch["variance"], 0.0, B, S)
    x[2] = wrap_angle(x[2])
    return 0.5 * math.log(S[0] * S[1]) - 0.5 * nis


@kernel
def update(x, P, p_spin, place, variance, least, most, scratch):
    """Use a measured place in both models, in place; returns the probability of a spin (21).

    least, most: where it is kept within.
    """
    log = scratch["log"]
    for mode in range(2):
        log[mode] = update_place(x[mode], P[mode], place, variance, scratch)
    return weigh(p_spin, log[STRAIGHT] - log[SPIN], least, most)


@kernel
def weigh(p_spin, log_ratio, least, most):
    """Probability of a spin after a measurement whose log likelihoods differ so, STRAIGHT's first.

    least, most: where it is kept within.
    """
    odds = (1.0 - p_spin) / p_spin * math.exp(min(log_ratio, 50.0))
    return min(max(1.0 / (1.0 + odds), least), most)


@kernel
def update_heading(x, P, p_spin, heading, variance, least, most, scratch):
    """Use a measured heading (rad) in both models, in place; returns the probability of a spin.

    One that fits neither model is taken for a mistake and changes nothing.
    """
    off, other = wrap_angle(heading - x[STRAIGHT, 2]), wrap_angle(heading - x[SPIN, 2])
    S, T = P[STRAIGHT, 2, 2] + variance, P[SPIN, 2, 2] + variance
    nis, nis_spin = off * off / S, other * other / T
    if min(nis, nis_spin) > TURNED_GATE:
        return p_spin
    H, work = scratch["H"], scratch["B"][0]
    H[:] = 0.0
    H[0, 2] = 1.0
    for mode in range(2):
        residual = off if mode == STRAIGHT else other
        update_scalar(x[mode], P[mode], H, 0, residual, variance, work)
        x[mode, 2] = wrap_angle(x[mode, 2])
    return weigh(p_spin, 0.5 * (math.log(T / S) - nis + nis_spin), least, most)


@kernel
def hand_over(x, P, p_spin, spun):
    """Pass on what the likelier model knows, in place; returns `spun`.

    Args:
        spun: how long the robot has been spinning, s; NEVER while it goes straight. The caller
            counts it on.
    """
    if spun < 0.0:
        if p_spin > 0.5:
            spun = ONSET
        elif p_spin < QUIET:
            inherit(x, P, STRAIGHT, SPIN, PARTED)
    if spun >= 0.0:
        if p_spin < 0.5:
            spun = NEVER
        else:
            inherit(x, P, SPIN, STRAIGHT, PARTED)
    return spun


@kernel
def inherit(x, P, winner, loser, parted):
    """Give the loser the winner's heading, and its place too where they have parted by more (m)."""
    north, east = x[winner, 0] - x[loser, 0], x[winner, 1] - x[loser, 1]
    if north * north + east * east >= parted * parted:
        for i in range(3):
            x[loser, i] = x[winner, i]
            for j in range(3):
                P[loser, i, j] = P[winner, i, j]
    else:
        x[loser, 2], P[loser, 2, 2] = x[winner, 2], P[winner, 2, 2]
        for i in range(2):
            P[loser, i, 2] = P[loser, 2, i] = 0.0
