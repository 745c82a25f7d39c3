"""Geometric guidance: turn the velocity onto the line to the aiming point (IISc 4.2-4.4).

Forward speed u is kept; in each of the two planes through the forward axis the lateral velocity v
goes to v* = (y / x) u, which points it at (x, y), within 0.6 of the time to go: four time
constants. Forward is north where only lateral commands are allowed, else along the velocity.
`dgg` inverts the dynamics of v - v* (4.17); `ngg` commands in proportion to the sine of the angle
between (4.13), with the gain of IISc appendix C. The two are then the same law: that gain turns the
sine into v* - v.

The report prints the sign of both reversed in appendix C, and for (4.13) a gain without a speed.
It aims behind a vehicle that has entered the front half of a safety sphere, so that v* points into
the obstacle; here the point is taken as far ahead as it is behind.

`hug` is `dgg` towards the tangent of whatever is ahead, on course for it or not: it flies to the
sphere even if it would miss it.
"""

from __future__ import annotations

import math
from functools import partial
from typing import Any

import numpy as np

from visenvs.core.compile import kernel
from visenvs.core.frames import camera_towards, identity, rotate
from visenvs.core.registry import Law
from visenvs.guidance.avoidance import (
    AHEAD,
    NEEDS,
    OUT,
    SETTINGS,
    TARGET,
    Rules,
    memory_size,
    most_critical,
    parse,
)

SETTLED = 0.6  # share of the time to go (4.21)


@kernel
def gain(T, dt):
    """k_v of (4.17), 1/s, for time to go T, s: no faster than a step allows."""
    return min(4.0 / (SETTLED * T), 1.0 / dt)


@kernel
def invert(k, u, v, T, y):
    """-k (v - v*) with v* = y / T for a point at (u T, y), m/s^2 (4.12), (4.17)."""
    return -k * (v - y / T)


@kernel
def turn(k, u, v, T, y):
    """The same from the angle between (u, v) and (u T, y) (4.13), gain as in IISc appendix C."""
    x, aligned = u * T, y / T
    speed, reach = math.sqrt(u * u + v * v), math.sqrt(x * x + y * y)
    sine = (u * y - v * x) / (speed * reach)
    return k * speed * math.sqrt(u * u + aligned * aligned) / u * sine


@kernel
def align(by_angle, X, V, s, C, a):
    """Write the command (3,), m/s^2, that turns a velocity onto the line to a point.

    Args:
        by_angle: `turn` rather than `invert`.
        X: the point relative to the vehicle, m. V: velocity relative to the point, m/s.
        s: settings. C: scratch (3, 3).

    None where the vehicle does not move forward.
    """
    if s["lateral"] != 0:
        identity(C)
    else:
        camera_towards(V, C)
    x, y, z = rotate(C, X)
    u, v, w = rotate(C, V)
    for i in range(3):
        a[i] = 0.0
    if u == 0.0:
        return
    T = max(abs(x / u), s["dt"])
    k = gain(T, s["dt"])
    right = turn(k, u, v, T, y) if by_angle else invert(k, u, v, T, y)
    down = turn(k, u, w, T, z) if by_angle else invert(k, u, w, T, z)
    for i in range(3):
        a[i] = C[1, i] * right + C[2, i] * down


@kernel
def steer(by_angle, rules, b, s, inside_of, latched, work, C, a):
    """Write the command for one belief: to the aiming point, else to a waypoint that is ahead."""
    j, _ = most_critical(b, s, rules, inside_of, latched, work)
    if j >= 0:
        align(by_angle, work[0], work[1], s, C, a)
    elif b["rhat_WV_N"][0] * b["v_V_N"][0] > 0.0 or s["lateral"] == 0:
        align(by_angle, b["rhat_WV_N"], b["v_V_N"], s, C, a)
    else:
        for i in range(3):
            a[i] = 0.0


@kernel
def decide(by_angle, rules, beliefs, settings, memory, commands):
    """The law for a batch of beliefs; a row's memory tells what was critical."""
    work, C, s = np.zeros((6, 3)), np.zeros((3, 3)), settings[0]
    for i in range(beliefs.shape[0]):
        b = beliefs[i]
        steer(by_angle, rules, b, s, b["rhat_OV_N"], memory[i], work, C, commands[i])


@kernel
def decide_told(by_angle, rules, beliefs, settings, memory, commands):
    """The same with spheres entered and left by the obstacles' true places, r_OV_N."""
    work, C, s = np.zeros((6, 3)), np.zeros((3, 3)), settings[0]
    for i in range(beliefs.shape[0]):
        b = beliefs[i]
        steer(by_angle, rules, b, s, b["r_OV_N"], memory[i], work, C, commands[i])


TOLD = "-told"  # ends the names of laws that are told when they have entered a sphere
BASES = {
    "dgg": Rules(inside=OUT),
    "ngg": Rules(inside=OUT),
    "hug": Rules(inside=OUT, test=AHEAD),
}
HOW = {
    "dgg": "velocity turned onto the aiming line by dynamic inversion",
    "ngg": "velocity turned onto the aiming line by the sine of the angle",
    "hug": "always along the tangent of what is ahead",
}
SOURCE = {
    "dgg": "IISc (4.12)-(4.21), appendix B with |x|",
    "ngg": "IISc (4.13), appendix C with its sign mended, appendix B with |x|",
    "hug": "IISc (4.17) with every obstacle ahead critical",
}


def law(name: str, base: str, changes: dict[str, Any]) -> Law:
    """The card of `base` with some of the rules changed."""
    told = name.endswith(TOLD)
    rules, decision = BASES[base]._replace(**changes), decide_told if told else decide
    return Law(
        name=name,
        summary=HOW[base]
        + (", cone test also on the waypoint's direction" if rules.test == TARGET else "")
        + (", told the truth when inside a sphere" if told else ""),
        source=SOURCE[base],
        needs=(*NEEDS, "r_OV_N") if told else NEEDS,
        settings=SETTINGS,
        decide=partial(decision, base == "ngg", rules),
        memory=memory_size,
    )


def member(name: str) -> Law | None:
    """`dgg`, `ngg` or `hug` with further words; None for other names.

    The words are those of `avoidance.WORDS`, then perhaps `told`: the safety spheres are tracked by
    the true places of the obstacles, which no vehicle knows. The tables of IISc seem to need that.
    """
    found = parse(name.removesuffix(TOLD), BASES)
    return law(name, *found) if found else None


LAWS = (
    *(law(name, name, {}) for name in BASES),
    law("dgg-target", "dgg", {"test": TARGET}),
)
