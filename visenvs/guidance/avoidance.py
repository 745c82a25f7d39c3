"""Which obstacle to avoid: what all laws for aiming points share (thesis 3.3, IISc 4.1).

An obstacle is critical where its cone test holds, also that of the time to go to the aiming point
if the rules are timed:

    t_min <= T < t_critical and T < the time left to the waypoint            (3.23), durations

Of several, the one with the shortest time to go counts. Where obstacles are critical that the
velocity passes by, those that it leads into within t_critical count first: else a law would keep to
the tangent of a near sphere until it is too late for the next one.

Nearer than t_min the aiming point is dropped, and the law flies to the waypoint: held back at
t_min, the command would not end.

By the letter of (3.20) the test is made anew at every step: a law that turns further than the
tangent leaves the cone, is drawn back by the waypoint, and enters again. With a latch, an obstacle
that was critical stays so as long as its time test holds, it is ahead (of one behind, too, there
are tangents, and the end of one may lie ahead), and the vehicle is outside the sphere.
"""

from __future__ import annotations

import math
import re
from collections.abc import Collection
from typing import Any, NamedTuple

from visenvs.core.compile import kernel
from visenvs.guidance.collision_cone import (
    abeam,
    coordinates,
    dot,
    is_farther,
    leads_in,
    tangents,
    time_to,
    way_out,
)

SLOTS = 8  # identities of tracks that a law can tell apart
VELOCITY, TARGET, AHEAD = 0, 1, 2  # cone tests
NOWHERE, OUT, ABEAM = 0, 1, 2  # where to aim from inside a sphere

NEEDS = (
    "rhat_WV_N",
    "v_V_N",
    "t_go",
    "rhat_OV_N",
    "vhat_O_N",
    "radius_O",
    "valid_O",
    "slot_O",
)
SETTINGS = ("dt", "lateral", "t_min", "t_critical")


class Rules(NamedTuple):
    """What makes an obstacle critical, and where to aim then.

    Attributes:
        timed: the time test (3.23) is made.
        latch: what was critical stays so.
        test: VELOCITY in the cone; or that or the direction to the TARGET; or anything AHEAD.
        inside: where to aim from inside a sphere, where there are no tangents: NOWHERE, that is,
            fly on; or straight OUT (IISc appendix B); or ABEAM of the centre, to the side that the
            velocity leads to.
        overlap: where two spheres overlap, take the tangent that is farther from the overlap
            (IISc (4.5)-(4.6)). In space this also turns away from tangents that are free.
        factor: radius to keep over that of the safety sphere.
    """

    timed: bool = False
    latch: bool = False
    test: int = VELOCITY
    inside: int = NOWHERE
    overlap: bool = False
    factor: float = 1.0


WORDS: dict[str, dict[str, Any]] = {
    "timed": {"timed": True},
    "latch": {"latch": True},
    "literal": {"latch": False},
    "target": {"test": TARGET},
    "overlap": {"overlap": True},
    "open": {"inside": NOWHERE},
    "out": {"inside": OUT},
    "abeam": {"inside": ABEAM},
}


def parse(name: str, bases: Collection[str]) -> tuple[str, dict[str, Any]] | None:
    """The base of a law's name and the rules that its further words set; None for other names.

    `dgg-target-x1.05` is `dgg` with the cone test on the target too and 1.05 times the radius.
    """
    base = next((b for b in bases if name == b or name.startswith(b + "-")), None)
    if base is None:
        return None
    rules: dict[str, Any] = {}
    for word in name.removeprefix(base).split("-")[1:]:
        if found := re.fullmatch(r"x(\d+(?:\.\d+)?)", word):
            rules["factor"] = float(found[1])
            if rules["factor"] <= 0.0:
                raise ValueError(f"{name}: a radius is more than 0; write {base}-x1.05")
        elif word in WORDS:
            rules |= WORDS[word]
        else:
            return None
    return base, rules


def memory_size(settings: Any, D: int) -> int:
    """One number for each identity of a track: 1 while its obstacle is critical."""
    return SLOTS


@kernel
def most_critical(b, s, rules, inside_of, latched, work):
    """The most critical obstacle's place in the row, -1 for none, and the time to its aim, s.

    Args:
        b, s: belief and settings.
        inside_of: centres by which to tell that a sphere has been entered, (3 K,), m.
        latched: memory (SLOTS,); what was not critical this time is cleared.
        work: (6, 3). Row 0 receives the aiming point relative to the vehicle, m, row 1 the
            vehicle's velocity relative to the obstacle, m/s.
    """
    found, soonest, hurry, W = -1, math.inf, False, work[3]
    for j in range(b["valid_O"].shape[0]):
        if b["valid_O"][j] < 0.5:
            continue
        for i in range(3):
            W[i] = b["v_V_N"][i] - b["vhat_O_N"][3 * j + i]
        slot = int(b["slot_O"][j] + 0.5)
        if slot < 0 or slot >= latched.shape[0]:
            raise ValueError("a slot_O of the belief is no identity from 0 to 7")
        T, on_course = aim(b, s, rules, inside_of, j, latched[slot] > 0.0, work)
        if T < 0.0:
            continue
        first = rules.test == VELOCITY or (on_course and T < s["t_critical"])
        latched[slot] = 2.0 if rules.latch else 0.0  # 1.0 is from the step before
        if (first and not hurry) or (first == hurry and T < soonest):
            found, soonest, hurry = j, T, first
            for i in range(3):
                work[0, i], work[1, i] = work[2, i], W[i]
    for slot in range(latched.shape[0]):
        latched[slot] = 1.0 if latched[slot] > 1.5 else 0.0
    return found, soonest


@kernel
def aim(b, s, rules, inside_of, j, latched, work):
    """Write the aiming point of obstacle j to work[2]; returns its time to go, s, -1 if harmless.

    And whether the velocity leads into the sphere, or the vehicle is in it. work[3]: the vehicle's
    velocity relative to the obstacle.
    """
    p, W, d, lateral = work[2], work[3], rules.factor * b["radius_O"][j], s["lateral"] != 0
    X, at = b["rhat_OV_N"][3 * j : 3 * j + 3], inside_of[3 * j : 3 * j + 3]
    c, x, y = coordinates(X, W, d)
    on_course, held = leads_in(x, y), latched and dot(X, W) > 0.0
    if rules.inside != NOWHERE and dot(at, at) <= d * d:
        there = way_out(at, d, p) if rules.inside == OUT else abeam(at, W, d, p)
        if there and rules.inside == OUT:
            return abs(time_to(p, W, lateral)), True
        if not there:
            return -1.0, False
    elif 0.0 < c < math.inf and (held or threatens(b, s, rules, j, d, on_course, work)):
        tangents(X, W, d, c, p, work[4])
        if rules.overlap:
            leave_overlap(b, rules, j, p, work[4])
    else:
        return -1.0, False
    T = time_to(p, W, lateral)
    if rules.timed and not (s["t_min"] <= T < s["t_critical"] and T < b["t_go"]):
        return -1.0, False
    return T, on_course


@kernel
def threatens(b, s, rules, j, d, on_course, work):
    """Whether the cone test of obstacle j holds; `on_course`: on the velocity."""
    X, W, wish = b["rhat_OV_N"][3 * j : 3 * j + 3], work[3], work[5]
    if rules.test == AHEAD:
        return dot(X, W) > 0.0
    if on_course or rules.test == VELOCITY:
        return on_course
    toward, V = b["rhat_WV_N"], b["v_V_N"]
    reach = toward[0] if s["lateral"] != 0 else math.sqrt(dot(toward, toward))
    speed = V[0] if s["lateral"] != 0 else math.sqrt(dot(V, V))
    if reach <= 0.0:
        return False
    for i in range(3):
        wish[i] = speed / reach * toward[i] - (V[i] - W[i])
    _, x, y = coordinates(X, wish, d)
    return leads_in(x, y)


@kernel
def leave_overlap(b, rules, j, p, other):
    """Exchange the aiming point for the other tangent if that is farther from an overlap."""
    X, d = b["rhat_OV_N"][3 * j : 3 * j + 3], rules.factor * b["radius_O"][j]
    near, least = -1, math.inf
    for k in range(b["valid_O"].shape[0]):
        Y, square = b["rhat_OV_N"][3 * k : 3 * k + 3], 0.0
        for i in range(3):
            square += (Y[i] - X[i]) ** 2
        touch = d + rules.factor * b["radius_O"][k]
        if k != j and b["valid_O"][k] > 0.5 and square < touch * touch and square < least:
            near, least = k, square
    if near < 0:
        return
    Y, e = b["rhat_OV_N"][3 * near : 3 * near + 3], rules.factor * b["radius_O"][near]
    if not is_farther(p, other, X, d, Y, e):
        for i in range(3):
            p[i] = other[i]


@kernel
def place(V, T, work, point):
    """Write where the aiming point will be after T s, relative to the vehicle now, (3,), m.

    V: own velocity, m/s. work: after `most_critical`.
    """
    for i in range(3):
        point[i] = work[0, i] + T * (V[i] - work[1, i])


@kernel
def waypoint(b, s, point):
    """Write the waypoint relative to the vehicle (3,), m; returns the time left until there, s.

    No less than a step: where it is nearer, the point is moved along with the vehicle to the end of
    that step, so that flying on to it costs nothing.
    """
    late = max(s["dt"] - b["t_go"], 0.0)
    for i in range(3):
        point[i] = b["rhat_WV_N"][i] + late * b["v_V_N"][i]
    return b["t_go"] + late
