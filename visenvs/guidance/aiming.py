"""Linear-quadratic and one-step-ahead guidance to aiming points (thesis 4.2.4).

`cone-lq` flies the terminal law to the aiming point of the most critical obstacle (4.42)-(4.43),
else to the waypoint (4.40)-(4.41). `cone-osa` adds the push of (4.35) while there is a critical
obstacle, for the image of that obstacle.

There is no latch: a push leads far out of the cone of an obstacle that is believed too far away,
and a latch would call the vehicle back to its tangent. From inside the estimated sphere both fly on
to the waypoint; the thesis's figures 44 and 45 come with `cone-lq-abeam` and `cone-osa-abeam`.

The velocity wanted at the end is the present speed straight north where only lateral commands are
allowed, as the thesis's x_f; else along the line there, at the pace that arrives in time.
"""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np

from visenvs.core.compile import kernel
from visenvs.core.registry import Law
from visenvs.guidance import lq
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
from visenvs.guidance.osa import slope
from visenvs.guidance.planner import begin, make_tape


@kernel
def terminal(b, s, X, T, x, v, a):
    """Write the terminal law's command (3,), m/s^2, to a point X (3,), m, in T s.

    b, s: belief and settings. x, v: scratch (3,).
    """
    V, lateral = b["v_V_N"], s["lateral"] != 0
    for i in range(3):
        pace = X[i] / T
        if lateral:
            pace = V[0] if i == 0 else 0.0
        x[i], v[i] = X[i] - T * pace, V[i] - pace
    lq.command(x, v, T, s["s_x"], s["s_v"], a)
    if lateral:
        a[0] = 0.0


@kernel
def push(b, s, j, T, nothing, down, tape, a):
    """Add to the terminal law's command what makes the next image of obstacle j tell more (4.35).

    The image is taken where that command has led. To that end the belief that the planner gets is
    displaced by the command and by the obstacle's motion, and its gains are 0.

    b, s: belief and settings. T: time to the aiming point, s. nothing: no push, (1, 3). down:
    scratch (2, 3). tape: for one step. a: command (3,), m/s^2.
    """
    X, dt = down[1], s["dt"]
    for i in range(3):
        X[i] = b["rhat_OV_N"][3 * j + i] - 0.5 * dt * dt * a[i] + dt * b["vhat_O_N"][3 * j + i]
    begin(X, b["v_V_N"], b["chol_OV"][6 * j : 6 * j + 6], T, s, 1, tape)
    tape.table[0, 0] = tape.table[0, 1] = 0.0
    slope(nothing, s, tape, down[:1])
    for i in range(3):
        a[i] -= down[0, i] / tape.table[0, 3]


@kernel
def decide(rules, beliefs, settings, memory, commands):
    """`cone-lq` for a batch of beliefs; a row's memory tells what was critical."""
    work, s = np.zeros((6, 3)), settings[0]
    for i in range(beliefs.shape[0]):
        fly(rules, beliefs[i], s, memory[i], work, commands[i])


@kernel
def decide_push(rules, beliefs, settings, memory, commands):
    """`cone-osa` for a batch of beliefs."""
    work, s = np.zeros((6, 3)), settings[0]
    tape, nothing, down = make_tape(1, 3), np.zeros((1, 3)), np.zeros((2, 3))
    for i in range(beliefs.shape[0]):
        b, a = beliefs[i], commands[i]
        j, T = fly(rules, b, s, memory[i], work, a)
        if j >= 0:
            push(b, s, j, T, nothing, down, tape, a)
            if s["lateral"] != 0:
                a[0] = 0.0


@kernel
def fly(rules, b, s, latched, work, a):
    """Write the terminal law's command; returns the most critical obstacle, and the time to go."""
    j, T = most_critical(b, s, rules, b["rhat_OV_N"], latched, work)
    if j >= 0:
        T = max(T, s["dt"])
        place(b["v_V_N"], T, work, work[2])
        terminal(b, s, work[2], T, work[3], work[4], a)
    else:
        left = waypoint(b, s, work[2])
        terminal(b, s, work[2], left, work[3], work[4], a)
    return j, T


OSA = "cone-osa"
HOW = {
    "cone-lq": "linear-quadratic terminal guidance to aiming points, then to the waypoint",
    OSA: "the same plus the push that makes the next image of the obstacle tell more",
}
SOURCE = {"cone-lq": "thesis (4.40)-(4.43)", OSA: "thesis (4.35), (4.40)-(4.43)"}
PLANNER = ("camera", "min_range", "sigma_range", "sigma_angle")


def law(name: str, base: str, changes: dict[str, Any]) -> Law:
    """The card of `base` with some of the rules changed."""
    rules = Rules(timed=True)._replace(**changes)
    pushed = base == OSA
    return Law(
        name=name,
        summary=HOW[base],
        source=SOURCE[base],
        needs=(*NEEDS, "chol_OV") if pushed else NEEDS,
        settings=(*SETTINGS, "s_x", "s_v", *PLANNER) if pushed else (*SETTINGS, "s_x", "s_v"),
        decide=partial(decide_push if pushed else decide, rules),
        memory=memory_size,
    )


def member(name: str) -> Law | None:
    """`cone-lq` or `cone-osa` with further words, as in `avoidance.WORDS`; None otherwise."""
    found = parse(name, HOW)
    return law(name, *found) if found else None


LAWS = tuple(law(name, name, {}) for name in HOW)
