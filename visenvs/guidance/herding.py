"""Strategies for herding ground robots over one line: the paper's rule, and an index of services.

The rule (IARC section V) blocks the robot nearest to the goal line among those that do not head for
it. The index policy asks what each service of each robot is worth: how much more likely the robot
gets over the goal line with it than without it (`herding_value.py`), per second that it takes.
"""

from __future__ import annotations

import math
import re
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from visenvs.core.compile import kernel
from visenvs.core.registry import Law
from visenvs.guidance.choices import DELAYS, ROBOTS, look_at, number_of
from visenvs.guidance.herding_value import value, value_table
from visenvs.guidance.interception import BLOCK, POSE, TAP, meet

TRACKED = 1.0  # status
AWAY = 0.4  # how far a robot must point away from the goal line to be blocked by the paper's rule
OVERHEAD = 1.5  # of a service beside the time to its contact, s
LEAST_GAIN = 0.02  # a service that gains less is not worth coming down for
STALE = 1.0  # tracks not seen for so long are worth a look, s

TRACK_FIELDS = (
    "track_r_N", "track_sin", "track_cos", "track_p_spin", "track_phase", "track_age",
    "track_status", "r_V_N", "height", "t_go", "allowed",
)  # fmt: skip
MEETING = (
    "speed", "spin_time", "period", "robot_radius", "aircraft_radius", "v_max", "v_descent",
    "top_height",
)  # fmt: skip


@kernel
def follow_rule(away, beliefs, settings, commands):
    """Block the robot nearest to the goal line that heads away from it; else wait by the nearest.

    away: robots with cos(heading) <= -away head away.
    """
    for n in range(beliefs.shape[0]):
        b = beliefs[n]
        first, nearest, to_block, to_wait = -math.inf, -math.inf, -1, -1
        for i in range(ROBOTS):
            if b["track_status"][i] == TRACKED:
                north = b["track_r_N"][2 * i]
                if north > nearest:
                    nearest, to_wait = north, i
                if north > first and b["track_cos"][i] <= -away:
                    first, to_block = north, i
        best = number_of(to_block, BLOCK, 0) if to_block >= 0 else 0
        if best == 0 and to_wait >= 0:
            best = look_at(to_wait)
        commands[n, 0] = best if b["allowed"][best] > 0.5 else 0


@kernel
def gain_of(belief, i, service, delay, V, cfg, pose, aim):
    """What a service of robot i gains per second: chance after it less without it, over its time."""
    ahead = meet(belief, i, service, delay, cfg, pose, aim)
    if pose[4] == 0.0:
        return 0.0
    left = belief["t_go"] - ahead
    north, east, heading, phase = pose[0], pose[1], pose[2], pose[3]
    without = value(V, north, east, heading, phase, left, cfg)
    if service == BLOCK:
        turn, spin = math.pi, cfg["spin_time"]
        phase = spin if cfg["bump_restarts_timer"] else phase + spin
    else:
        turn, spin = 0.25 * math.pi, 0.25 * cfg["spin_time"]
        phase += spin
    after = value(V, north, east, heading + turn, phase, left - spin, cfg)
    if after - without < LEAST_GAIN:
        return 0.0
    return (after - without) / (ahead + OVERHEAD)


@kernel
def most_gain(belief, V, cfg, pose, aim):
    """The service that gains most per second, as its number; 0 where none is worth it."""
    most, best = 0.0, 0
    for i in range(ROBOTS):
        if belief["track_status"][i] != TRACKED:
            continue
        for service in (BLOCK, TAP):
            if belief["allowed"][number_of(i, service, 0)] < 0.5:
                continue
            for k in range(len(DELAYS)):
                gain = gain_of(belief, i, service, DELAYS[k], V, cfg, pose, aim)
                if gain > most:
                    most, best = gain, number_of(i, service, k)
    return best


@kernel
def stalest(belief):
    """The look at the track that has not been seen for longest, as its number; 0 if all are fresh."""
    oldest, best = STALE, 0
    for i in range(ROBOTS):
        if belief["allowed"][look_at(i)] > 0.5 and belief["track_age"][i] > oldest:
            oldest, best = belief["track_age"][i], look_at(i)
    return best


@kernel
def choose_by_index(look_around, V, beliefs, settings, commands):
    """The service of most gain; where there is none, the stalest track or no motion."""
    pose, aim = np.zeros(POSE), np.zeros(2)
    for n in range(beliefs.shape[0]):
        b = beliefs[n]
        best = most_gain(b, V, settings[0], pose, aim)
        if best == 0 and look_around:
            best = stalest(b)
        commands[n, 0] = best


def follow_index(
    look_around: bool, beliefs: NDArray[Any], settings: NDArray[Any], commands: NDArray[Any]
) -> None:
    """`choose_by_index` with the value table of the configuration."""
    choose_by_index(look_around, value_table(settings), beliefs, settings, commands)


def paper_rule(name: str, away: float) -> Law:
    """The card of the paper's rule with a threshold."""
    return Law(
        name=name,
        summary=f"blocks the robot nearest to the goal line with cos(heading) <= -{away:g}",
        source="IARC section V; the paper gives no threshold",
        needs=("track_r_N", "track_cos", "track_status", "allowed"),
        settings=("cruise",),
        decide=partial(follow_rule, away),
        limit="",
    )


def index(name: str, summary: str, look_around: bool) -> Law:
    """The card of an index policy."""
    return Law(
        name=name,
        summary=summary,
        source="backward induction; no published source",
        needs=TRACK_FIELDS,
        settings=(*MEETING, "side", "noise_every", "noise_max", "bump_restarts_timer", "services"),
        decide=partial(follow_index, look_around),
        limit="",
    )


def member(name: str) -> Law | None:
    """`paper-rule-X` that blocks robots with cos(heading) <= -X, 0 to 1; None for other names."""
    found = re.fullmatch(r"paper-rule-(\d+(?:\.\d+)?)", name)
    if found is None:
        return None
    if (away := float(found[1])) > 1.0:
        raise ValueError(f"{name}: a cosine is at most 1; write paper-rule-{AWAY}")
    return paper_rule(name, away)


LAWS = (
    paper_rule("paper-rule", AWAY),
    index("index", "the service that gains most chance of a goal per second", False),
    index("index-look", "the same, and looks at the stalest track when idle", True),
)
