"""How an aircraft of the herding arena obeys its control: as a point mass, or as a quadrotor.

A point mass has the acceleration that it is asked for, and comes down and climbs at one speed. A
quadrotor is asked for accelerations in all directions, of a_max together at most, and reaches them
by tilting (`dynamics.quadrotor`) with its forward axis north; its camera tilts with it. It does not
slow down before the floor, and stands where it meets it: level and at rest. Where both ask for
much, level flight goes first: an aircraft that begins to sink still has to brake.

Its control knows velocity, height and attitude as they are. What it knows of its place is off by
`off_N`, which no flight changes.
"""

from __future__ import annotations

import math

import numpy as np

from visenvs.core.compile import kernel
from visenvs.dynamics import quadrotor
from visenvs.dynamics.lander import (
    HEIGHT_GAIN,
    approach_velocity,
    descend_or_climb,
    follow_velocity,
    glide,
    sink_acceleration,
    steer,
)
from visenvs.envs._herding_config import QUADROTOR, SUBSTEPS

UPRIGHT = 0.5  # share of a_max that up and down have in any case
LACKING = 0.1  # height below cruise at which a climb is over, m
KEPT = [
    ("q_V", "f8", (4,)), ("omega_V", "f8", (3,)),  # attitude C_BN and body rates, rad/s
    ("sink", "f8"),  # speed down, m/s
    ("felt", "f8", (SUBSTEPS, 2, 3)),  # acceleration in N and body rates in the last tick's parts
]  # fmt: skip
WORK = np.dtype([
    ("r_V_N", "f8", (3,)), ("v_V_N", "f8", (3,)), ("a_V_N", "f8", (3,)),
    ("q_V", "f8", (4,)), ("omega_V", "f8", (3,)), ("q_before", "f8", (4,)),
    ("command", "f8", (3,)), ("wanted", "f8", (3, 3)), ("C", "f8", (3, 3)),
    ("dt", "f8"), ("bandwidth", "f8"), ("damping", "f8"), ("rate_max", "f8"), ("substeps", "f8"),
])  # fmt: skip


@kernel
def fly_to(lane, height, cfg, work):
    """Fly for one tick towards aim_N, and to a height (m); `work` is a record of WORK."""
    r, v, a = lane["r_V_N"], lane["v_V_N"], lane["a_V_N"]
    if cfg["dynamics"] == QUADROTOR:
        steer(v, a, lane["aim_N"], r, cfg)
        tilt(lane, height, cfg, work)
    else:
        glide(r, v, a, lane["aim_N"], cfg)
        lane["height"], lane["sink"] = descend_or_climb(lane["height"], height, cfg), 0.0


@kernel
def fly_at(lane, height, cfg, work):
    """Fly for one tick at the commanded velocity, and to a height; near the floor at none."""
    r, v, a, command = lane["r_V_N"], lane["v_V_N"], lane["a_V_N"], lane["command"]
    if cfg["dynamics"] == QUADROTOR:
        share = 0.0 if lane["height"] < cfg["solid_height"] else 1.0
        approach_velocity(v, a, command, share, cfg)
        tilt(lane, height, cfg, work)
        return
    lane["height"] = descend_or_climb(lane["height"], height, cfg)
    if lane["height"] < cfg["solid_height"]:
        v[0] = v[1] = 0.0
    else:
        follow_velocity(r, v, a, command, cfg)


@kernel
def at_cruise(lane, cfg):
    """Whether a climb is over."""
    lacking = LACKING if cfg["dynamics"] == QUADROTOR else 0.0
    return lane["height"] >= cfg["cruise"] - lacking


@kernel
def tilt(lane, height, cfg, work):
    """Obey the level acceleration in a_V_N, and go to a height; below cruise, through it."""
    through = cfg["v_descent"] / HEIGHT_GAIN if height < cfg["cruise"] else 0.0
    command, a = work["command"], lane["a_V_N"]
    command[0], command[1] = a[0], a[1]
    command[2] = sink_acceleration(lane["height"], lane["sink"], height - through, cfg)
    obey(lane, cfg, work)


@kernel
def obey(lane, cfg, work):
    """Obey work["command"] (N, m/s^2) for one tick, as well as a quadrotor can."""
    n, r, v, a = int(cfg["substeps"]), work["r_V_N"], work["v_V_N"], lane["a_V_N"]
    limit(work["command"], cfg["a_max"])
    take_off(lane, cfg, work)
    a[0] = a[1] = 0.0
    for k in range(n):
        felt = lane["felt"][k]
        work["q_before"][:] = work["q_V"]
        quadrotor.fly(work, work["command"], 0.0, work, work)
        for i in range(3):
            felt[0, i], felt[1, i] = work["a_V_N"][i], work["omega_V"][i]
        if r[2] >= 0.0:
            meet_floor(felt, work)
        for i in range(2):
            a[i] += felt[0, i] / n
    lane["height"], lane["sink"] = -r[2], v[2]
    for i in range(2):
        lane["r_V_N"][i], lane["v_V_N"][i] = r[i], v[i]
    lane["q_V"][:], lane["omega_V"][:] = work["q_V"], work["omega_V"]


@kernel
def limit(command, most):
    """Shorten an acceleration (3,) to a length, level flight first, in place."""
    level = math.hypot(command[0], command[1])
    left = max(math.sqrt(max(most * most - level * level, 0.0)), UPRIGHT * most)
    command[2] = min(max(command[2], -left), left)
    gain = min(math.sqrt(most * most - command[2] * command[2]) / max(level, 1e-9), 1.0)
    command[0], command[1] = gain * command[0], gain * command[1]


@kernel
def take_off(lane, cfg, work):
    """Write the lane's state and the settings of one part of a tick for `quadrotor.fly`."""
    for i in range(2):
        work["r_V_N"][i], work["v_V_N"][i] = lane["r_V_N"][i], lane["v_V_N"][i]
    work["r_V_N"][2], work["v_V_N"][2] = -lane["height"], lane["sink"]
    work["q_V"][:], work["omega_V"][:] = lane["q_V"], lane["omega_V"]
    work["dt"], work["substeps"] = cfg["tick"] / cfg["substeps"], 1.0
    work["bandwidth"], work["damping"] = cfg["bandwidth"], cfg["damping"]
    work["rate_max"] = cfg["rate_max"]


@kernel
def meet_floor(felt, work):
    """End a part of a tick level and at rest on the floor, and write what that felt like."""
    q, h, v = work["q_before"], work["dt"], work["v_V_N"]
    sine = math.sqrt(q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    gain = 2.0 * math.atan2(sine, q[0]) / sine if sine > 1e-9 else 2.0
    for i in range(3):
        felt[0, i] -= v[i] / h
        felt[1, i] = -gain * q[1 + i] / h
        v[i] = work["omega_V"][i] = work["q_V"][1 + i] = 0.0
    work["r_V_N"][2], work["q_V"][0] = 0.0, 1.0


@kernel
def stand(lane):
    """Rest on the floor for one tick."""
    lane["felt"][:] = 0.0


@kernel
def stop_fall(lane, height, cfg):
    """End a tick at a height without speed down."""
    last = int(cfg["substeps"]) - 1
    lane["felt"][last, 0, 2] -= lane["sink"] * cfg["substeps"] / cfg["tick"]
    lane["height"], lane["sink"] = height, 0.0
