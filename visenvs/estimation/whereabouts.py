"""Where a robot out of sight may be: guesses that live as its firmware would have it.

A guess is a row of a bank's `guesses` (slots, GUESSES, 7): north, east (m), heading after its
present spin (rad), phase of its timer (s), what is left of a spin (s), weight, and 1 once it has
left the arena. Every guess drives straight, reverses by its timer, swerves, and now and then has
run into something. One that the camera should see and does not loses its weight: so a search goes
on where the robot can still be. When none is left the robot is anywhere that is not in the picture.
The leader is the guess that the track shows: at first the one without luck, later the middle one.

The dice are the filter's own (`core.noise` with a seed of its own), and the same in every run.
Settings: speed, spin_time, period, noise_every, noise_max, side, p_detect, bump_restarts_timer, and
`ground_camera`'s.
"""

from __future__ import annotations

import math

from visenvs.core.compile import kernel
from visenvs.core.frames import wrap_angle
from visenvs.core.noise import normal_pair, uniform_pair
from visenvs.estimation.mmae import SPIN, STRAIGHT
from visenvs.sensors.ground_camera import in_view

GUESSES = 24
NORTH, EAST, HEADING, PHASE, LEFT, WEIGHT, GONE = range(7)
DICE = 1 << 20  # seed of the filter's own draws
TURNED = 3  # guesses that go the other way from the start: the heading was wrong
RUN_INTO = 0.07  # chance of running into something between two swerves
SHY = 0.2  # how far inside the picture a guess must be to be missed there, m
SPOKEN_FOR = 0.7  # distance of a candidate that may be the robot of a guess, m
EXHAUSTED = 0.02  # weight left below which the robot is anywhere
DETHRONED = 0.3  # weight, as a share of the largest, below which a leader is none
LEFT_ARENA = 0.8  # share of the weight outside from which the robot has left
BEYOND = 0.2  # how far behind the edge that is, m


@kernel
def scatter(bank, j, cfg):
    """Guess from what the filters of track j knew last."""
    spinning = bank["p_spin"][j] > 0.5
    model = SPIN if spinning else STRAIGHT
    x, P, left = bank["x"][j, model], bank["P"][j, model], 0.0
    if spinning:
        left = min(max(bank["turn"][j] - bank["spun"][j], 0.0), cfg["spin_time"])
    a = math.sqrt(P[0, 0])
    b, c = P[1, 0] / a, P[2, 0] / a
    d = math.sqrt(max(P[1, 1] - b * b, 1e-12))
    e = (P[2, 1] - b * c) / d
    f = math.sqrt(max(P[2, 2] - c * c - e * e, 0.0))
    for k in range(GUESSES):
        g, draw = bank["guesses"][j, k], 2 * (j * GUESSES + k)
        u, v = normal_pair(DICE, 0, 0, bank["picture"], draw)
        w, p = normal_pair(DICE, 0, 0, bank["picture"], draw + 1)
        if k == 0:
            u = v = w = p = 0.0
        g[NORTH], g[EAST] = x[0] + a * u, x[1] + b * u + d * v
        g[HEADING] = x[2] + c * u + e * v + f * w + math.pi * left / cfg["spin_time"]
        g[HEADING] += math.pi if k >= GUESSES - TURNED else 0.0
        g[PHASE] = max(bank["phase"][j] + bank["sd_phase"][j] * p, 0.0)
        g[LEFT], g[WEIGHT], g[GONE] = left, 1.0 / GUESSES, 0.0
    bank["leader"][j], bank["away"][j] = 0.0, 1.0


@kernel
def scatter_anywhere(bank, j, pose, cfg):
    """Guess anywhere in the arena but in the picture; the timer is all that is still known."""
    for k in range(GUESSES):
        g = bank["guesses"][j, k]
        for attempt in range(4):
            draw = 8 * (j * GUESSES + k) + 2 * attempt
            u, v = uniform_pair(DICE, 0, 1, bank["picture"], draw)
            g[NORTH], g[EAST] = cfg["side"] * (u - 0.5), cfg["side"] * (v - 0.5)
            if not in_view(pose, g[NORTH], g[EAST], SHY, cfg):
                break
        u, v = uniform_pair(DICE, 0, 1, bank["picture"], draw + 1)
        g[HEADING] = 2.0 * math.pi * u
        g[PHASE], g[LEFT], g[WEIGHT], g[GONE] = bank["phase"][j], 0.0, 1.0 / GUESSES, 0.0
    crown(bank, j)


@kernel
def carry_on(bank, j, dt, cfg):
    """Let all guesses of track j live for dt s."""
    for k in range(GUESSES):
        g = bank["guesses"][j, k]
        if g[GONE] > 0.0:
            continue
        g[PHASE] += dt
        if g[LEFT] > 0.0:
            g[LEFT] = max(g[LEFT] - dt, 0.0)
        elif g[PHASE] >= cfg["period"]:
            g[PHASE] -= cfg["period"]
            g[LEFT], g[HEADING] = cfg["spin_time"], g[HEADING] + math.pi
        else:
            g[NORTH] += cfg["speed"] * dt * math.cos(g[HEADING])
            g[EAST] += cfg["speed"] * dt * math.sin(g[HEADING])
        beat = bank["t"] / cfg["noise_every"] + k / GUESSES
        if math.floor(beat) != math.floor(beat - dt / cfg["noise_every"]):
            stir(bank, j, k, cfg)
        outside = max(abs(g[NORTH]), abs(g[EAST])) - 0.5 * cfg["side"]
        g[GONE] = 1.0 if outside > BEYOND else 0.0


@kernel
def stir(bank, j, k, cfg):
    """A swerve, and perhaps a bump, of a guess that is not the leader."""
    if k == bank["leader"][j]:
        return
    g = bank["guesses"][j, k]
    u, v = uniform_pair(DICE, 0, 2, bank["picture"], j * GUESSES + k)
    g[HEADING] += (2.0 * u - 1.0) * cfg["noise_max"]
    if v < RUN_INTO:
        g[LEFT], g[HEADING] = cfg["spin_time"], g[HEADING] + math.pi
        g[PHASE] = 0.0 if cfg["bump_restarts_timer"] else g[PHASE]


@kernel
def turn_guesses(bank, j, angle, cfg):
    """All guesses of track j begin to spin by an angle, rad."""
    for k in range(GUESSES):
        g = bank["guesses"][j, k]
        g[HEADING] += angle - math.pi * g[LEFT] / cfg["spin_time"]
        g[LEFT] = cfg["spin_time"] * angle / math.pi
        g[PHASE] = 0.0 if cfg["bump_restarts_timer"] and angle == math.pi else g[PHASE]


@kernel
def doubt(bank, j, pose, cfg):
    """Take the weight of guesses that should be in the picture; returns whether the robot has left.

    Not of those near a candidate: it may be the robot.
    """
    keep, inside, outside = 1.0 - min(cfg["p_detect"], 0.95), 0.0, 0.0
    for k in range(GUESSES):
        g = bank["guesses"][j, k]
        if g[GONE] == 0.0 and in_view(pose, g[NORTH], g[EAST], SHY, cfg):
            g[WEIGHT] *= 1.0 if spoken_for(bank, g) else keep
        inside += g[WEIGHT] if g[GONE] == 0.0 else 0.0
        outside += g[WEIGHT] if g[GONE] > 0.0 else 0.0
    if outside > LEFT_ARENA * (inside + outside) and outside > EXHAUSTED:
        return True
    if inside + outside < EXHAUSTED:
        scatter_anywhere(bank, j, pose, cfg)
    crown_if_due(bank, j)
    return False


@kernel
def spoken_for(bank, g):
    """Whether a candidate is near a guess."""
    for c in range(bank["c_filled"].shape[0]):
        filled = int(bank["c_filled"][c])
        if filled > 0:
            last = bank["c_sights"][c, filled - 1]
            if math.hypot(last[1] - g[NORTH], last[2] - g[EAST]) < SPOKEN_FOR:
                return True
    return False


@kernel
def crown_if_due(bank, j):
    """A leader that has left, or has lost its weight, is followed by another."""
    most = 0.0
    for k in range(GUESSES):
        g = bank["guesses"][j, k]
        most = max(most, g[WEIGHT] if g[GONE] == 0.0 else 0.0)
    leader = bank["guesses"][j, int(bank["leader"][j])]
    if most > 0.0 and (leader[GONE] > 0.0 or leader[WEIGHT] < DETHRONED * most):
        crown(bank, j)


@kernel
def crown(bank, j):
    """Make the guess in the middle of most of the weight the leader: that of least moment."""
    least = math.inf
    for k in range(GUESSES):
        g, moment = bank["guesses"][j, k], 0.0
        if g[GONE] > 0.0 or g[WEIGHT] <= 0.0:
            continue
        for m in range(GUESSES):
            h = bank["guesses"][j, m]
            if h[GONE] == 0.0:
                square = (h[NORTH] - g[NORTH]) ** 2 + (h[EAST] - g[EAST]) ** 2
                moment += h[WEIGHT] * min(square, 4.0)
        moment -= 4.0 * g[WEIGHT]
        if moment < least:
            least, bank["leader"][j] = moment, k


@kernel
def spread(bank, j):
    """Standard deviations about the leader: of the place along either axis, m; of the heading."""
    leader = bank["guesses"][j, int(bank["leader"][j])]
    total, place, cosine = 1e-12, 0.0, 0.0
    for k in range(GUESSES):
        g = bank["guesses"][j, k]
        if g[GONE] == 0.0:
            total += g[WEIGHT]
            square = (g[NORTH] - leader[NORTH]) ** 2 + (g[EAST] - leader[EAST]) ** 2
            place += 0.5 * g[WEIGHT] * square
            cosine += g[WEIGHT] * math.cos(g[HEADING] - leader[HEADING])
    turned = 2.0 * (1.0 - min(max(cosine / total, -1.0), 1.0))
    return math.sqrt(place / total), math.sqrt(turned)


@kernel
def density(bank, j, place, north, east, noise, cfg):
    """How likely a candidate is for track j, 1/m^2, and the guess that speaks most for it, or -1.

    Args:
        place: of the candidate, m, (2,).
        north, east, noise: its velocity, m/s, and the variance of either, m^2/s^2.
    """
    sd = spread(bank, j)[0]
    width = 0.15**2 + 0.25 * sd * sd
    total, most, best, weight = 0.0, 0.0, -1, 1e-12
    for k in range(GUESSES):
        g = bank["guesses"][j, k]
        weight += g[WEIGHT]
        if g[GONE] > 0.0:
            continue
        speed = 0.0 if g[LEFT] > 0.0 else cfg["speed"]
        S = noise + (0.3 * speed) ** 2 + 1e-4
        u, v = place[0] - g[NORTH], place[1] - g[EAST]
        s, t = north - speed * math.cos(g[HEADING]), east - speed * math.sin(g[HEADING])
        fit = math.exp(-0.5 * (u * u + v * v) / width) / (2.0 * math.pi * width)
        part = g[WEIGHT] * fit * (0.03 + noise / S * math.exp(-0.5 * (s * s + t * t) / S))
        total += part
        if part > most:
            most, best = part, k
    return total / weight, best


@kernel
def show(bank, j, cfg):
    """Write the public figures of track j from its leader."""
    g = bank["guesses"][j, int(bank["leader"][j])]
    bank["r_N"][j, 0], bank["r_N"][j, 1] = g[NORTH], g[EAST]
    bank["heading"][j] = wrap_angle(g[HEADING] - math.pi * g[LEFT] / cfg["spin_time"])
    bank["p_spin"][j], bank["phase"][j] = 0.99 if g[LEFT] > 0.0 else 0.01, g[PHASE]
    bank["sd_r"][j], bank["sd_heading"][j] = spread(bank, j)
