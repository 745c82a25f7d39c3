"""How the leader of a formation flies: profiles of turn and acceleration, and the exact motion.

The leader keeps its horizontal speed but for its acceleration along its course. In a profile:

    straight   nothing
    circle     a constant turn rate
    reverse    that turn until the first switch, straight on until the second, then the other way
    weave      1 - cos(w t) times an amplitude ahead, to the right and down
    random     a_lat to the right that wanders (a random walk that decays), and white acceleration
"""

from __future__ import annotations

import math

import numpy as np

from visenvs.core.compile import kernel
from visenvs.core.noise import normal_pair
from visenvs.dynamics.turning import turn

PROFILES = ("straight", "circle", "reverse", "weave", "random")  # the order of the codes
STRAIGHT, CIRCLE, REVERSE, WEAVE, RANDOM = range(len(PROFILES))

LEAST_SPEED = 1e-3  # m/s

PLAN = np.dtype([
    ("profile", "i8"),
    ("turn", "f8"),  # of circle and reverse, rad/s, clockwise positive
    ("switch", "f8", (2,)),  # of reverse, s
    ("amplitude", "f8", (3,)), ("rate", "f8"),  # of weave, m and rad/s
    ("a_lat", "f8"),  # of random, now, m/s^2
])  # fmt: skip


@kernel
def turn_rate(plan, t, speed):
    """Turn rate at a time (s), rad/s, of a leader at a horizontal speed (m/s)."""
    profile = plan["profile"]
    if profile == CIRCLE or (profile == REVERSE and t < plan["switch"][0]):
        return plan["turn"]
    if profile == REVERSE and t >= plan["switch"][1]:
        return -plan["turn"]
    if profile == WEAVE:
        return sway(plan, 1, t) / speed
    if profile == RANDOM:
        return plan["a_lat"] / speed
    return 0.0


@kernel
def sway(plan, axis, t):
    """Acceleration of a weave along an axis (ahead, right, down) at a time (s), m/s^2."""
    if plan["profile"] != WEAVE:
        return 0.0
    return plan["amplitude"][axis] * plan["rate"] ** 2 * math.cos(plan["rate"] * t)


@kernel
def wander(plan, v, dt, cfg, seed, episode, stream, step):
    """Let a random leader's a_lat drift and its velocity be kicked for `dt` s.

    Args:
        plan: PLAN record.
        v: its velocity, m/s, (3,), changed in place.
        cfg: record with leader_decay (1/s), leader_q_lat (m^2/s^5), leader_q_a (m^2/s^3).
        seed, episode, stream, step: name the draws (`core.noise`).
    """
    if plan["profile"] != RANDOM:
        return
    ahead, right = normal_pair(seed, episode, stream, step, 0)
    down, drift = normal_pair(seed, episode, stream, step, 1)
    kick = math.sqrt(cfg["leader_q_a"] * dt)
    v[0] += kick * ahead
    v[1] += kick * right
    v[2] += kick * down
    plan["a_lat"] *= math.exp(-cfg["leader_decay"] * dt)
    plan["a_lat"] += math.sqrt(cfg["leader_q_lat"] * dt) * drift


@kernel
def lead(leader, plan, t, dt, moved):
    """Fly the profile for one step from time t (s); exact for a constant turn.

    Args:
        leader: record with r_N, v_N, a_N (3,), changed in place; a_N at the end of the step.
        plan: PLAN record.
        moved: scratch, (3,).
    """
    r, v = leader["r_N"], leader["v_N"]
    speed = max(math.hypot(v[0], v[1]), LEAST_SPEED)
    middle = t + 0.5 * dt
    turn(v, turn_rate(plan, middle, speed), dt, moved)
    ahead, down = sway(plan, 0, middle), sway(plan, 2, middle)
    north, east = v[0] / speed, v[1] / speed
    r[0] += moved[0] + 0.5 * dt * dt * ahead * north
    r[1] += moved[1] + 0.5 * dt * dt * ahead * east
    r[2] += dt * (v[2] + 0.5 * dt * down)
    v[0] += dt * ahead * north
    v[1] += dt * ahead * east
    v[2] += dt * down
    accelerate(leader, turn_rate(plan, t + dt, speed), sway(plan, 0, t + dt), sway(plan, 2, t + dt))


@kernel
def accelerate(leader, rate, ahead, down):
    """Write the acceleration of a turn rate (rad/s) and accelerations ahead and down (m/s^2)."""
    v, a = leader["v_N"], leader["a_N"]
    speed = max(math.hypot(v[0], v[1]), LEAST_SPEED)
    a[0] = ahead * v[0] / speed - rate * v[1]
    a[1] = ahead * v[1] / speed + rate * v[0]
    a[2] = down
