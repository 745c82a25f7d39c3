"""Strategies for herding ground robots over one line: the paper's rule, and an index of services.

The rule (IARC section V) blocks the robot nearest to the goal line among those that do not head for
it. The index policy asks what each service of each robot is worth: how much more likely the robot
gets over the goal line with it than without it (`herding_value.py`), per second that it takes.
Idle, it looks at what it has not seen for long, or searches for robots that it has lost.
"""

from __future__ import annotations

import math
import re
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from visenvs.core.compile import kernel
from visenvs.core.registry import Law
from visenvs.guidance.choices import (
    DELAYS,
    FIRST_PLACE,
    ROBOTS,
    SERVICES,
    SIDE,
    look_at,
    nearest_place,
    number_of,
)
from visenvs.guidance.herding_value import KEY, value, value_table
from visenvs.guidance.interception import BLOCK, POSE, meet

TRACKED, NOBODY = 1.0, 0.0  # status of a track
AWAY = 0.4  # how far a robot must point away from the goal line to be blocked by the paper's rule
ARRIVED = 1.0  # this near to a place, it is searched, m
CLAIM = 1.2  # a robot this near to where another aircraft is bound is that one's, m


class Temper(NamedTuple):
    """What an index policy makes of time and doubt.

    Attributes:
        overhead: of a service beside the time to its contact, s.
        least: a service that gains less is not worth coming down for.
        stale: a track not seen for so long is looked at before it is served, s.
        idle: with nothing to serve, a track not seen for so long is looked at, s.
        doubt: standard deviation of a place at which a service is worth 1/e, m.
        spread: 1 to average over the heading's standard deviation, 0 to believe the heading.
    """

    overhead: float
    least: float
    stale: float
    idle: float
    doubt: float
    spread: float


PLAIN = Temper(1.5, 0.02, 1.0, 1.0, math.inf, 0.0)
LOOKING = Temper(8.0, 0.02, 5.0, 100.0, 1.5, 1.0)

TRACK_FIELDS = (
    "track_r_N", "track_sin", "track_cos", "track_p_spin", "track_phase", "track_sd_r",
    "track_sd_heading", "track_age", "track_status", "r_V_N", "aim_N", "height", "t_go",
    "others_N", "others_first", "allowed",
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
def claimed(belief, north, east):
    """Whether another aircraft that goes first is bound for this place, m."""
    others, first = belief["others_N"], belief["others_first"]
    for k in range(first.shape[0]):
        if first[k] > 0.5:
            away = math.hypot(others[4 * k + 2] - north, others[4 * k + 3] - east)
            if away < CLAIM:
                return True
    return False


@kernel
def chance(V, pose, turn, phase, left, sd, cfg):
    """`value` of a pose turned by an angle (rad), over a heading of standard deviation sd (rad)."""
    north, east, heading = pose[0], pose[1], pose[2] + turn
    middle = value(V, north, east, heading, phase, left, cfg)
    if sd == 0.0:
        return middle
    right = value(V, north, east, heading + sd, phase, left, cfg)
    return 0.4 * middle + 0.3 * (right + value(V, north, east, heading - sd, phase, left, cfg))


@kernel
def gain_of(belief, i, service, delay, V, temper, cfg, pose, aim):
    """What a service of robot i gains: its chance with it less that without it, per second."""
    ahead = meet(belief, i, service, delay, cfg, pose, aim)
    if pose[4] == 0.0 or claimed(belief, aim[0], aim[1]):
        return 0.0
    left, phase = belief["t_go"] - ahead, pose[3]
    turn = math.pi if service == BLOCK else 0.25 * math.pi
    spin = cfg["spin_time"] * turn / math.pi
    restart = service == BLOCK and cfg["bump_restarts_timer"] != 0
    sd = temper.spread * min(belief["track_sd_heading"][i], 1.2)
    without = chance(V, pose, 0.0, phase, left, sd, cfg)
    after = chance(V, pose, turn, spin if restart else phase + spin, left - spin, sd, cfg)
    if after - without < temper.least:
        return 0.0
    trust = math.exp(-belief["track_sd_r"][i] / temper.doubt)
    return trust * (after - without) / (ahead + temper.overhead)


@kernel
def most_gain(belief, V, temper, cfg, pose, aim):
    """The service that gains most per second, or a look before it; 0 where none is worth it."""
    most, best = 0.0, 0
    for i in range(ROBOTS):
        for service in range(len(SERVICES)):
            if belief["allowed"][number_of(i, service, 0)] < 0.5:
                continue
            for k in range(len(DELAYS)):
                gain = gain_of(belief, i, service, DELAYS[k], V, temper, cfg, pose, aim)
                if gain > most:
                    fresh = belief["track_age"][i] < temper.stale
                    most, best = gain, number_of(i, service, k) if fresh else look_at(i)
    return best


@kernel
def look_about(belief, temper, cfg):
    """With nothing to serve: the track not seen for longest, else a search for who is missing.

    The search goes from place to place; where the aircraft is bound tells how far it has come.
    """
    oldest, best, missing = temper.idle, 0, 0
    for i in range(ROBOTS):
        missing += belief["track_status"][i] == NOBODY
        if belief["allowed"][look_at(i)] > 0.5 and belief["track_age"][i] > oldest:
            oldest, best = belief["track_age"][i], look_at(i)
    if best == 0 and missing and belief["allowed"][FIRST_PLACE] > 0.5:
        bound, off = nearest_place(belief["aim_N"], cfg["side"])
        here, away = nearest_place(belief["r_V_N"], cfg["side"])
        if off > ARRIVED or (here == bound and away < ARRIVED):
            bound = (here + 1) % (SIDE * SIDE) if away < ARRIVED else here
        best = FIRST_PLACE + bound
    return best


@kernel
def choose_by_index(temper, V, beliefs, settings, commands):
    """The service of most gain; where there is none, information."""
    pose, aim = np.zeros(POSE), np.zeros(2)
    for n in range(beliefs.shape[0]):
        best = most_gain(beliefs[n], V, temper, settings[0], pose, aim)
        commands[n, 0] = best if best else look_about(beliefs[n], temper, settings[0])


def follow_index(
    temper: Temper, beliefs: NDArray[Any], settings: NDArray[Any], commands: NDArray[Any]
) -> None:
    """`choose_by_index` with the value table of the configuration."""
    choose_by_index(temper, value_table(settings), beliefs, settings, commands)


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


def index(name: str, summary: str, temper: Temper) -> Law:
    """The card of an index policy."""
    return Law(
        name=name,
        summary=summary,
        source="backward induction; no published source",
        needs=TRACK_FIELDS,
        settings=(*MEETING, *KEY),
        decide=partial(follow_index, temper),
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
    index("index", "the service that gains most chance of a goal per second", PLAIN),
    index("index-look", "the same, more careful of its time and of doubtful tracks", LOOKING),
)
