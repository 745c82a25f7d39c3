"""What a track knows of its robot's 20 s timer.

`phase` is the time since the robot's last reversal by the timer, s; all are started together, as if
they had just reversed. A spin seen where one was due sets it right. One that nothing explains (not
due, not ours, nobody near) tells that it was wrong. With `bump_restarts_timer` every half turn
starts the timer anew, once it has lasted too long to be a mistake.

Tracks are rows of a bank (`herd.bank_dtype`). Settings: speed, spin_time, period, robot_radius,
bump_restarts_timer.
"""

from __future__ import annotations

import math

from visenvs.core.compile import kernel
from visenvs.estimation import mmae
from visenvs.estimation.mmae import SPIN
from visenvs.estimation.slope import SIGHTS

EARLY, LATE = 0.6, 3.4  # a reversal may be found so much before and after it is due, s
SEEN = 0.15  # standard deviation of a phase whose reversal was seen, s
SURPRISED = 1.0  # standard deviation after a spin that nothing explains, s
UNKNOWN = 6.0  # standard deviation of a phase of which nothing is known, s
BELIEVED = 1.0  # a spin seen for so long is one, s
BESIDE = 0.25  # gap at which robots may have bumped, m


@kernel
def due(phase, sd_phase, cfg):
    """Whether a reversal by the timer may begin at this phase."""
    early, late = cfg["period"] - EARLY - 2.0 * sd_phase, cfg["period"] + LATE + 2.0 * sd_phase
    return early < phase < late


@kernel
def note_spin(bank, j, cfg):
    """Set the phase of track j by a spin that has just been found, `spun` ago."""
    spun, bank["turn"][j] = bank["spun"][j], cfg["spin_time"]
    timed = due(bank["phase"][j] - spun, bank["sd_phase"][j], cfg)
    if bank["filled"][j] < SIGHTS:
        began_unseen(bank, j, spun, timed, cfg)
    elif timed:
        bank["phase"][j], bank["sd_phase"][j] = spun, SEEN
    elif not bumped(bank, j, cfg):
        bank["phase"][j], bank["sd_phase"][j] = spun, SURPRISED


@kernel
def began_unseen(bank, j, spun, timed, cfg):
    """A robot just found again may have been spinning for a while: sets `spun`.

    By the timer where that was due, else anywhere within the spin.
    """
    x, P = bank["x"][j], bank["P"][j]
    before, doubt = 0.5 * cfg["spin_time"] - spun, 0.3 * cfg["spin_time"]
    if timed:
        overdue = min(bank["phase"][j] - cfg["period"], cfg["spin_time"])
        before, doubt = max(overdue - spun, 0.0), min(bank["sd_phase"][j], doubt)
    x[SPIN, 2] += math.pi * before / cfg["spin_time"]
    P[SPIN, 2, 2] += (math.pi * doubt / cfg["spin_time"]) ** 2
    bank["spun"][j] = spun + before


@kernel
def note_double(bank, j, cfg):
    """A spin that outlasts its time is two: the timer was waiting for the end of a bump's."""
    if bank["spun"][j] > bank["turn"][j] + mmae.ONSET + SEEN:
        bank["spun"][j] -= bank["turn"][j]
        bank["turn"][j] = cfg["spin_time"]
        if bank["phase"][j] >= cfg["period"]:
            bank["phase"][j], bank["sd_phase"][j] = bank["spun"][j], SEEN


@kernel
def note_restart(bank, j, cfg):
    """A half turn that has lasted for long enough has restarted the timer, where a bump does."""
    spun, long = bank["spun"][j], bank["turn"][j] > BELIEVED
    if cfg["bump_restarts_timer"] and long and spun > BELIEVED:
        bank["phase"][j], bank["sd_phase"][j] = spun, SEEN


@kernel
def note_overdue(bank, j, cfg):
    """A robot in sight that has not reversed in time has another phase than was believed."""
    if bank["phase"][j] > cfg["period"] + LATE + 2.0 * bank["sd_phase"][j]:
        bank["phase"][j] -= cfg["period"]
        bank["sd_phase"][j] = UNKNOWN


@kernel
def bumped(bank, j, cfg):
    """Whether another robot or an obstacle is so near that track j may have run into it."""
    r, reach = bank["x"][j, SPIN], 2.0 * cfg["robot_radius"] + BESIDE
    for k in range(bank["status"].shape[0]):
        away = math.hypot(bank["r_N"][k, 0] - r[0], bank["r_N"][k, 1] - r[1])
        if k != j and bank["status"][k] == 1.0 and away < reach:
            return True
    for k in range(bank["r_O_N"].shape[0]):
        if math.hypot(bank["r_O_N"][k, 0] - r[0], bank["r_O_N"][k, 1] - r[1]) < reach:
            return True
    return False
