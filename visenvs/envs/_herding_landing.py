"""Landings that are planned anew at every tick (IARC section IV) in the herding arena."""

from __future__ import annotations

import math

import numpy as np

from visenvs.core.compile import kernel
from visenvs.core.config import to_record
from visenvs.envs._herding_config import QUADROTOR
from visenvs.envs._herding_flight import obey
from visenvs.guidance import ddp, landing
from visenvs.guidance.interception import advance, pose_now

STEPS = 120  # of the longest plan, all that there is room for
WEIGHTS = to_record(ddp.DDPConfig())
KEPT = [("landing", landing.LANDING), ("u", "f8", (STEPS, 3))]  # by a lane
WORK = np.dtype([
    ("x", "f8", (STEPS + 1, 6)), ("u_try", "f8", (STEPS, 3)), ("x_try", "f8", (STEPS + 1, 6)),
    ("k", "f8", (STEPS, 3)), ("K", "f8", (STEPS, 3, 6)),
    ("V", "f8", (6, 6)), ("V_x", "f8", (6,)), ("Q_u", "f8", (3,)), ("Q_uu", "f8", (3, 3)),
    ("Q_ux", "f8", (3, 6)), ("BV", "f8", (3, 6)),
    ("state", "f8", (6,)), ("next", "f8", (6,)), ("place", "f8", (2,)),
    ("weights", WEIGHTS.dtype, (1,)),
])  # fmt: skip


@kernel
def read_state(lane, state):
    """Write the aircraft's position and velocity in N, (6,), down is positive."""
    for i in range(2):
        state[i], state[3 + i] = lane["r_V_N"][i], lane["v_V_N"][i]
    state[2], state[5] = -lane["height"], lane["sink"]


@kernel
def settings_of(cfg, work):
    """The record of a DDPConfig for this aircraft: its limits, with some of each left."""
    work["weights"][0] = WEIGHTS[0]
    out = work["weights"][0]
    out["dt"] = cfg["tick"]
    out["v_max"] = ddp.SHARE_V * cfg["v_max"]
    out["a_max"] = ddp.SHARE_A * cfg["a_max"]
    return out


@kernel
def begin_landing(lane, i, cfg, pose, work):
    """Choose when to land in front of the robot of track i; pose is scratch (POSE,)."""
    plan, place, state = settings_of(cfg, work), work["place"], work["state"]
    pose_now(lane, i, pose)
    place[0], place[1] = pose[0], pose[1]
    read_state(lane, state)
    most = STEPS * cfg["tick"]
    landing.begin(lane["landing"], state, place, pose[2], cfg["speed"], most, plan)


@kernel
def land_by_plan(lane, i, cfg, pose, work, flight):
    """One tick of the landing; returns how far off its aim the robot's path has moved by now, m.

    The robot is met where it will be when the plan ends, its next half turn foreseen.

    Args:
        lane: its place, velocity, height and sink are advanced; aim_N receives the newest aim.
        pose, work, flight: scratch, (POSE,), a record of WORK, and one of `_herding_flight`.
    """
    plan, place, state = settings_of(cfg, work), work["place"], work["state"]
    task = lane["landing"]
    pose_now(lane, i, pose)
    advance(pose, task["t_go"], cfg)
    place[0], place[1] = pose[0] + lane["miss_N"][0], pose[1] + lane["miss_N"][1]
    read_state(lane, state)
    tape = ddp.Tape(
        lane["u"], work["x"], work["u_try"], work["x_try"], work["k"], work["K"], work["V"],
        work["V_x"], work["Q_u"], work["Q_uu"], work["Q_ux"], work["BV"],
    )  # fmt: skip
    landing.land(task, state, place, pose[2], 0.0, plan, tape)
    for k in range(2):
        lane["aim_N"][k] = task["fresh"][k]
    fly_by_plan(lane, cfg, work, flight)
    return math.hypot(task["fresh"][0] - task["aim"][0], task["fresh"][1] - task["aim"][1])


@kernel
def fly_by_plan(lane, cfg, work, flight):
    """One tick by the first acceleration of the plan."""
    u, to = lane["u"][0], work["next"]
    if cfg["dynamics"] == QUADROTOR:
        flight["command"][:] = u
        obey(lane, cfg, flight)
        return
    ddp.fly(work["state"], u, to, cfg["tick"])
    for k in range(2):
        lane["r_V_N"][k], lane["v_V_N"][k], lane["a_V_N"][k] = to[k], to[3 + k], u[k]
    lane["height"], lane["sink"] = max(-to[2], 0.0), to[5]
