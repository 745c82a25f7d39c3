"""Velocity obstacles: fly with the allowed velocity that is nearest to the wanted one.

After Fiorini and Shiller 1998, "Motion planning in dynamic environments using velocity obstacles",
in space: the velocities that lead into one of the moving safety spheres are its collision cone,
shifted by its velocity. The wanted velocity leads to the waypoint. Where it is not allowed, the
candidates are those along the tangents all around every cone; of the ones that are in no cone, the
nearest to the wanted and the present velocity is flown to, as fast as geometric guidance would.

Forward speed is kept where only lateral commands are allowed, else the speed.
"""

from __future__ import annotations

import math

import numpy as np

from visenvs.core.compile import kernel
from visenvs.core.frames import camera_towards
from visenvs.core.registry import Law
from visenvs.guidance.avoidance import NEEDS, waypoint
from visenvs.guidance.collision_cone import coordinates, dot, leads_in, way_out
from visenvs.guidance.geometric import gain

AROUND = 24  # tangents tried for each sphere
CLEAR = 1.001  # radius to keep over that of the safety sphere, so that a tangent counts as free


@kernel
def relative(b, j, v, W):
    """Write the velocity v (3,), m/s, relative to obstacle j."""
    for i in range(3):
        W[i] = v[i] - b["vhat_O_N"][3 * j + i]


@kernel
def matters(b, j, v, W):
    """Whether a velocity comes level with obstacle j before the waypoint; W: scratch (3,)."""
    relative(b, j, v, W)
    X, WW = b["rhat_OV_N"][3 * j : 3 * j + 3], dot(W, W)
    if b["valid_O"][j] < 0.5 or WW == 0.0:
        return False
    return 0.0 < dot(X, W) / WW < b["t_go"]


@kernel
def allowed(b, v, W):
    """Whether a velocity leads into none of the spheres."""
    for j in range(b["valid_O"].shape[0]):
        if matters(b, j, v, W):
            _, x, y = coordinates(b["rhat_OV_N"][3 * j : 3 * j + 3], W, b["radius_O"][j])
            if leads_in(x, y):
                return False
    return True


@kernel
def along(b, s, j, wish, p, out):
    """Write the velocity (3,), m/s, that leads along p past obstacle j; False if there is none.

    With the forward speed of `wish` where only lateral commands are allowed, else with its speed
    relative to the obstacle.
    """
    O, size = b["vhat_O_N"], math.sqrt(dot(p, p))
    if s["lateral"] != 0:
        if p[0] * (wish[0] - O[3 * j]) <= 0.0:
            return False
        pace = (wish[0] - O[3 * j]) / p[0]
    else:
        relative(b, j, wish, out)
        pace = math.sqrt(dot(out, out)) / size
    for i in range(3):
        out[i] = O[3 * j + i] + pace * p[i]
    return True


@kernel
def tangent(X, d, k, C, p):
    """Write the direction (3,) of the k-th tangent around a sphere's cone. C: scratch (3, 3).

    From the sphere itself that is straight across the line of sight.
    """
    camera_towards(X, C)
    sine, angle = d / max(math.sqrt(dot(X, X)), d), 2.0 * math.pi * k / AROUND
    ahead, aside = math.sqrt(1.0 - sine * sine), math.sin(angle)
    for i in range(3):
        p[i] = ahead * C[0, i] + sine * (math.cos(angle) * C[1, i] + aside * C[2, i])


@kernel
def choose(b, s, wish, C, work):
    """Write the velocity to fly to, work[0], m/s; returns the time that there is for it, s.

    wish: wanted velocity. Where no candidate is allowed, the wanted one is kept.
    """
    best, W, p, v, soonest = work[0], work[1], work[2], work[3], b["t_go"]
    least = math.inf
    for i in range(3):
        best[i] = wish[i]
    if allowed(b, wish, W):
        return soonest
    for j in range(b["valid_O"].shape[0]):
        if not matters(b, j, b["v_V_N"], W):
            continue
        X, d = b["rhat_OV_N"][3 * j : 3 * j + 3], CLEAR * b["radius_O"][j]
        soonest = min(soonest, dot(X, W) / dot(W, W))
        for k in range(AROUND):
            tangent(X, d, k, C, p)
            if not along(b, s, j, wish, p, v) or not allowed(b, v, W):
                continue
            change = 0.0
            for i in range(3):
                change += (v[i] - wish[i]) ** 2 + (v[i] - b["v_V_N"][i]) ** 2
            if change < least:
                least = change
                for i in range(3):
                    best[i] = v[i]
    return soonest


@kernel
def escape(b, s, wish, p, out):
    """Write the velocity out of the sphere that the vehicle is in; False outside of all."""
    for j in range(b["valid_O"].shape[0]):
        X, d = b["rhat_OV_N"][3 * j : 3 * j + 3], b["radius_O"][j]
        if b["valid_O"][j] > 0.5 and dot(X, X) < d * d and way_out(X, d, p):
            speed = math.sqrt(dot(wish, wish) / dot(p, p))
            for i in range(3):
                out[i] = b["vhat_O_N"][3 * j + i] + speed * p[i]
            return True
    return False


@kernel
def decide(beliefs, settings, commands):
    """The law for a batch of beliefs."""
    work, C, s = np.zeros((6, 3)), np.zeros((3, 3)), settings[0]
    for i in range(beliefs.shape[0]):
        b, a, wish = beliefs[i], commands[i], work[4]
        T, V = waypoint(b, s, wish), b["v_V_N"]
        left, speed = math.sqrt(dot(wish, wish)), math.sqrt(dot(V, V))
        for k in range(3):
            if s["lateral"] != 0:
                wish[k] = V[0] if k == 0 else wish[k] / T
            else:
                wish[k] *= speed / left if left > 0.0 else 0.0
        if escape(b, s, wish, work[2], work[0]):
            T = s["dt"]
        else:
            T = max(choose(b, s, wish, C, work), s["dt"])
        rate = gain(T, s["dt"])
        for k in range(3):
            a[k] = rate * (work[0, k] - V[k])
        if s["lateral"] != 0:
            a[0] = 0.0


LAWS = (
    Law(
        name="vo",
        summary="nearest velocity to the wanted one that is in no collision cone",
        source="Fiorini and Shiller 1998, cones as in thesis (3.20)",
        needs=tuple(name for name in NEEDS if name != "slot_O"),
        settings=("dt", "lateral"),
        decide=decide,
    ),
)
