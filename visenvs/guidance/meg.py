"""Aiming points and a waypoint: proportional navigation in sequence, and minimum effort for both.

`cone-pn` flies to the aiming point of the most critical obstacle as if nothing came after it
(thesis (3.29)), `cone-meg` to both points with the least effort in all (3.32)-(3.33). Where nothing
is critical both are proportional navigation to the waypoint (3.26).
"""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np

from visenvs.core.compile import kernel
from visenvs.core.registry import Law
from visenvs.guidance import pn
from visenvs.guidance.avoidance import (
    NEEDS,
    SETTINGS,
    Rules,
    memory_size,
    most_critical,
    parse,
    place,
    waypoint,
)


@kernel
def command(X_ap, X_wp, V, T, T_f, a):
    """Write the first command (3,), m/s^2, of the least effort through two points (3.32)-(3.33).

    Args:
        X_ap, X_wp: aiming point and waypoint relative to the vehicle, m.
        V: own velocity, m/s.
        T, T_f: times left until the one and the other, s, 0 < T < T_f.
    """
    pn.command(X_ap, V, T, a)
    rest = T_f - T
    gain = 3.0 / (3.0 * T + 4.0 * rest)
    for i in range(a.shape[0]):
        a[i] += gain * (3.0 / T * X_ap[i] - 2.0 / rest * (X_wp[i] - X_ap[i]) - V[i])


@kernel
def decide(meg, rules, beliefs, settings, memory, commands):
    """The law for a batch of beliefs; a row's memory tells what was critical."""
    work, point, s = np.zeros((6, 3)), np.zeros(3), settings[0]
    for i in range(beliefs.shape[0]):
        b, a = beliefs[i], commands[i]
        V = b["v_V_N"]
        j, T = most_critical(b, s, rules, b["rhat_OV_N"], memory[i], work)
        if j < 0:
            T = waypoint(b, s, point)
        else:
            T = max(T, s["dt"])
            place(V, T, work, point)
        if meg and j >= 0 and T < b["t_go"]:
            command(point, b["rhat_WV_N"], V, T, b["t_go"], a)
        else:
            pn.command(point, V, T, a)
        if s["lateral"] != 0:
            a[0] = 0.0


HOW = {
    "cone-pn": "proportional navigation to aiming points, then to the waypoint",
    "cone-meg": "minimum effort through aiming point and waypoint",
}
SOURCE = {"cone-pn": "thesis (3.26), (3.29)", "cone-meg": "thesis (3.32)-(3.33)"}


def law(name: str, base: str, changes: dict[str, Any]) -> Law:
    """The card of `base` with some of the rules changed."""
    rules = Rules(timed=True, latch=True)._replace(**changes)
    return Law(
        name=name,
        summary=HOW[base],
        source=f"{SOURCE[base]}, with a latch" if rules.latch else SOURCE[base],
        needs=NEEDS,
        settings=SETTINGS,
        decide=partial(decide, base == "cone-meg", rules),
        memory=memory_size,
    )


def member(name: str) -> Law | None:
    """`cone-pn` or `cone-meg` with further words, as in `avoidance.WORDS`; None for other names."""
    found = parse(name, HOW)
    return law(name, *found) if found else None


LAWS = tuple(law(name, name, {}) for name in HOW)
