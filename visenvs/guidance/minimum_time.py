"""Least time and effort to aiming points and a waypoint, under a limit of the acceleration.

The thesis leaves this open (5.2.3): there the forward speed is kept, here it is chosen. Of a
vehicle with the velocity V that passes through a point X after T at the least effort (3.26), the
cost is

    s_time T + 3/2 |X - V T|^2 / T^3,

whose first minimum is where 2/3 s_time T^4 = 3 X.X - 4 T X.V + T^2 V.V. Commands no longer than
a_max do not lead there before |X - V T| = 1/2 a_max T^2: then it is the longest one in one
direction all the way, the solution of the minimum-time problem. `cone-time` flies proportional
navigation with the later one of these times to go, so that to a single point both ends of the
trade-off are exact.

Where the aiming point of an obstacle that is seen late lies too far aside, that time is longer than
at the present speed, and the command slows the vehicle down.

As `cone-pn` it looks at one point at a time: where s_time is so large that the limit holds all the
way, it passes the last sphere too fast to come back to the waypoint. There is no latch, which would
hold a vehicle that gathers speed at an obstacle that is no more in its way, and the cone test is
also made on the direction to the waypoint, into which it accelerates.
"""

from __future__ import annotations

import math
from functools import partial
from typing import Any

import numpy as np

from visenvs.core.compile import kernel
from visenvs.core.registry import Law
from visenvs.guidance import pn
from visenvs.guidance.avoidance import (
    NEEDS,
    SETTINGS,
    TARGET,
    Rules,
    memory_size,
    most_critical,
    parse,
    waypoint,
)
from visenvs.guidance.collision_cone import dot

STRIDE, HALVINGS = 1.03, 40  # of the search for a root


@kernel
def excess(q, T):
    """q_4 T^4 - (q_0 + q_1 T + q_2 T^2) for q = (q_0, q_1, q_2, q_4)."""
    return q[3] * T**4 - (q[0] + T * (q[1] + T * q[2]))


@kernel
def first_root(q, T):
    """Where `excess` is first no longer below zero, s, from T > 0 on; T itself if it is not."""
    if excess(q, T) >= 0.0:
        return T
    while excess(q, T * STRIDE) < 0.0:
        T *= STRIDE
    low, high = T, T * STRIDE
    for _ in range(HALVINGS):
        T = 0.5 * (low + high)
        if excess(q, T) < 0.0:
            low = T
        else:
            high = T
    return high


@kernel
def time_to_go(X, V, s_time, a_max):
    """Time of the cheapest passage through a point, s, no shorter than a_max allows.

    Args:
        X: the point relative to the vehicle, not 0, (3,), m. V: velocity relative to the point,
            m/s.
        s_time: cost of a second, m^2/s^4, above 0. a_max: length of the longest command, m/s^2.
    """
    XX, XV, VV = dot(X, X), dot(X, V), dot(V, V)
    # flying straight at it at full acceleration, it would not be reached earlier
    soonest = 2.0 * math.sqrt(XX) / (math.sqrt(VV) + math.sqrt(VV + 2.0 * a_max * math.sqrt(XX)))
    least = first_root((XX, -2.0 * XV, VV, 0.25 * a_max * a_max), soonest)
    return first_root((4.5 * XX, -6.0 * XV, 1.5 * VV, s_time), least)


@kernel
def decide(rules, beliefs, settings, memory, commands):
    """The law for a batch of beliefs; a row's memory tells what was critical."""
    work, s = np.zeros((6, 3)), settings[0]
    for i in range(beliefs.shape[0]):
        b, a = beliefs[i], commands[i]
        X, V = work[0], work[1]
        if most_critical(b, s, rules, b["rhat_OV_N"], memory[i], work)[0] < 0:
            waypoint(b, s, X)
            for k in range(3):
                V[k] = b["v_V_N"][k]
        T = time_to_go(X, V, s["s_time"], s["a_max"]) if dot(X, X) > 0.0 else 0.0
        pn.command(X, V, max(T, s["dt"]), a)


BASE = "cone-time"


def law(name: str, changes: dict[str, Any]) -> Law:
    """The card with some of the rules changed."""
    rules = Rules(timed=True, test=TARGET)._replace(**changes)
    return Law(
        name=name,
        summary="least time and effort to aiming points, then to the waypoint",
        source="thesis 5.2.3 (future work), with (3.26) and aiming points (3.21)",
        needs=NEEDS,
        settings=(*SETTINGS, "s_time", "a_max"),
        decide=partial(decide, rules),
        memory=memory_size,
        positive=("s_time",),
    )


def member(name: str) -> Law | None:
    """`cone-time` with further words, as in `avoidance.WORDS`; None for other names."""
    found = parse(name, (BASE,))
    return law(name, found[1]) if found else None


LAWS = (law(BASE, {}),)
