"""What an aircraft does with its choice: approach, come down, stay, climb."""

from __future__ import annotations

import math

from visenvs.core.compile import kernel
from visenvs.core.noise import normal_pair
from visenvs.envs._herding_config import BY_PLAN
from visenvs.envs._herding_flight import at_cruise, fly_at, fly_to, stand
from visenvs.envs._herding_landing import begin_landing, land_by_plan
from visenvs.guidance.choices import GO, HOVER, LOOK, meaning, place_of
from visenvs.guidance.interception import BLOCK, TAP, aim_at, descent_time, meet

CRUISE, DESCENT, GROUND, CLIMB = 0.0, 1.0, 2.0, 3.0  # stages
TRACKED = 1.0  # status of a track that can be served
LANDING = 1  # noise stream: where it comes down
NEAR = 0.5  # offset from the aim at which the descent begins, m
FRESH = 0.5  # nobody comes down for a robot that was not seen for longer, s
APART = 1.5  # aircraft nearer to each other than this make way, m
ASTRAY = 0.8  # offset at which it is broken off, m


@kernel
def true_place(lane, i):
    """Where the aircraft really is, north (0) or east (1), m."""
    return lane["r_V_N"][i] - lane["off_N"][i]


@kernel
def enter(lane, stage):
    """Begin a stage."""
    lane["stage"] = stage
    lane["stage_t"] = 0.0


@kernel
def choose(lane, number, cfg):
    """Take up a choice; an aircraft that is busy takes none."""
    if lane["stage"] != CRUISE:
        return
    lane["service"], lane["target"], lane["delay"] = meaning(number)
    for i in range(2):
        lane["aim_N"][i] = lane["r_V_N"][i]  # where it stays if there is nothing to fly to
    if lane["service"] == GO:
        lane["aim_N"][0], lane["aim_N"][1] = place_of(lane["target"], cfg["side"])


@kernel
def fly(lane, others, m, cfg, work):
    """One tick of an aircraft that has chosen; `others` and `m` as in `make_way`."""
    lane["stage_t"] += cfg["tick"]
    stage = lane["stage"]
    if stage == CRUISE:
        approach(lane, others, m, cfg, work)
    elif stage == DESCENT:
        come_down(lane, cfg, work)
    elif stage == GROUND:
        stay(lane, cfg)
    else:
        fly_to(lane, cfg["cruise"], cfg, work["flight"])
        if at_cruise(lane, cfg):
            enter(lane, CRUISE)
            lane["service"] = HOVER


@kernel
def make_way(lane, others, m):
    """Shift the aim of an aircraft in cruise away from any other that is too near.

    Args:
        others: places of all aircraft, north and east in the first columns, (aircraft, >= 2), m.
        m: which of them this one is.
    """
    if lane["stage"] != CRUISE:
        return
    r = lane["r_V_N"]
    for k in range(others.shape[0]):
        north, east = r[0] - others[k, 0], r[1] - others[k, 1]
        away = math.sqrt(north * north + east * east)
        if k != m and 0.0 < away < APART:
            lane["aim_N"][0] = r[0] + north / away
            lane["aim_N"][1] = r[1] + east / away


@kernel
def approach(lane, others, m, cfg, work):
    """Fly level to where the service begins, and begin to come down there."""
    service, i = lane["service"], lane["target"]
    serving = service in (BLOCK, TAP)
    if (serving or service == LOOK) and lane["track_status"][i] == TRACKED:
        kind = BLOCK if service == BLOCK else TAP
        meet(lane, i, kind, lane["delay"], cfg, work["pose"], lane["aim_N"])
    else:
        serving = False
    make_way(lane, others, m)
    fly_to(lane, cfg["cruise"], cfg, work["flight"])
    fresh = serving and lane["track_age"][i] < FRESH
    if fresh and lane["delay"] == 0.0 and off_aim(lane) < NEAR:
        enter(lane, DESCENT)
        lane["landed"] = 0
        draw_miss(lane, cfg)
        if planned(lane, cfg):
            begin_landing(lane, i, cfg, work["pose"], work["plan"])


@kernel
def draw_miss(lane, cfg):
    """Draw how far from its aim the aircraft comes down."""
    north, east = normal_pair(lane["seed"], lane["episode"], LANDING, lane["step"], lane["agent"])
    lane["miss_N"][0] = cfg["landing_sigma"] * north
    lane["miss_N"][1] = cfg["landing_sigma"] * east


@kernel
def off_aim(lane):
    """Distance from the aim, m."""
    aim, r = lane["aim_N"], lane["r_V_N"]
    return math.hypot(aim[0] - r[0], aim[1] - r[1])


@kernel
def come_down(lane, cfg, work):
    """Follow the aim down; break off where it runs away or the robot has left."""
    i = lane["target"]
    if lane["track_status"][i] != TRACKED:
        break_off(lane)
        return
    if planned(lane, cfg):
        off = land_by_plan(lane, i, cfg, work["pose"], work["plan"], work["flight"])
    else:
        off = sink_to_aim(lane, i, cfg, work)
    if off > ASTRAY:
        break_off(lane)
    elif lane["service"] == BLOCK and lane["height"] <= 0.0:
        enter(lane, GROUND)
        for k in range(2):
            lane["v_V_N"][k] = 0.0


@kernel
def break_off(lane):
    """Give up a descent."""
    lane["aborts"] += 1.0
    leave(lane)


@kernel
def planned(lane, cfg):
    """Whether it comes down by a plan: to land in front of a robot, where that is asked for."""
    return cfg["landing"] == BY_PLAN and lane["service"] == BLOCK


@kernel
def sink_to_aim(lane, i, cfg, work):
    """One tick of a descent at constant speed over the aim; returns how far off that it is, m."""
    kind = BLOCK if lane["service"] == BLOCK else TAP
    aim_at(lane, i, kind, descent_time(lane["height"], kind, cfg), cfg, work["pose"], lane["aim_N"])
    for k in range(2):
        lane["aim_N"][k] += lane["miss_N"][k]
    off = off_aim(lane)
    if off <= ASTRAY:
        fly_to(lane, cfg["top_height"] if kind == TAP else 0.0, cfg, work["flight"])
    return off


@kernel
def stay(lane, cfg):
    """Wait on the ground for a bump, then leave."""
    stand(lane)
    felt = lane["landed"] != 0
    if lane["stage_t"] >= cfg["dwell"] + (0.0 if felt else cfg["patience"]):
        lane["aborts"] += 0.0 if felt else 1.0
        leave(lane)


@kernel
def leave(lane):
    """Begin the climb, straight up."""
    for k in range(2):
        lane["aim_N"][k] = lane["r_V_N"][k]
    enter(lane, CLIMB)


@kernel
def obey(lane, cfg, work):
    """One tick under a velocity set-point: level flight, and up or down."""
    lane["stage_t"] += cfg["tick"]
    down = lane["down"] > 0.0
    fly_at(lane, 0.0 if down else cfg["cruise"], cfg, work["flight"])
    if at_cruise(lane, cfg):
        stage = CRUISE
    elif lane["height"] <= 0.0:
        stage = GROUND
    else:
        stage = DESCENT if down else CLIMB
    if stage != lane["stage"]:
        enter(lane, stage)
        lane["landed"] = 0 if stage == DESCENT else lane["landed"]
