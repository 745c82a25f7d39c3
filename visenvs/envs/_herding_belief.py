"""What an aircraft believes: the truth, or what its camera and its filters make of it."""

from __future__ import annotations

import math

from visenvs.core.compile import kernel
from visenvs.core.noise import uniform
from visenvs.core.outcome import RUNNING
from visenvs.dynamics import quadrotor
from visenvs.dynamics.ground_robot import ABSENT, ACTIVE, OBSTACLES, ROBOTS, spinning
from visenvs.envs._herding_aircraft import CRUISE, TRACKED
from visenvs.envs._herding_config import BLOCK_ONLY, IMAGES, TRUTH, VIO
from visenvs.estimation import herd
from visenvs.guidance.choices import DELAYS, FIRST_PLACE, SIDE, look_at, number_of
from visenvs.guidance.interception import BLOCK, TAP, meet
from visenvs.sensors.ground_camera import in_view, look, mount

NONE, FINISHED = 0.0, 2.0  # status of a track
CAMERA = 8  # noise stream of the first aircraft's camera; each further one has the next
POLES_SEEN = 12  # noise stream: whether an obstacle in view is found, as CAMERA
NEVER_SEEN = 60.0  # age of an obstacle that has not been seen, s
REACH = 1.0  # farthest track that a felt bump is put down to, m


@kernel
def begin_belief(lane, arena, cfg, work):
    """Start an episode knowing nothing but that all robots start now, or the truth."""
    if cfg["estimator"] != TRUTH:
        herd.start(lane["bank"])
        lane["obstacle_age"][:] = NEVER_SEEN
        copy_tracks(lane)
    else:
        tell_truth(lane, arena)


@kernel
def sense(lane, arena, cfg, work):
    """Bring the belief up to date: at every tick the truth, at every picture the filters.

    Rendered pictures are taken outside of the kernels (`looks`).
    """
    if cfg["estimator"] == TRUTH:
        tell_truth(lane, arena)
        return
    note_touch(lane, cfg)
    if cfg["perception"] != IMAGES and due(arena, cfg):
        take_picture(lane, arena, cfg, work)


@kernel
def due(arena, cfg):
    """Whether a picture is due at this tick."""
    return arena["tick"] % round(cfg["camera_every"] / cfg["tick"]) == 0


@kernel
def looks(arena, cfg):
    """Whether a tick asks for rendered pictures, or for the navigation on them."""
    if cfg["perception"] != IMAGES or cfg["estimator"] == TRUTH or arena["outcome"] != RUNNING:
        return False
    return cfg["navigation"] == VIO or due(arena, cfg)


@kernel
def tell_truth(lane, arena):
    """The tracks as they are, without deviation."""
    for k in range(ROBOTS):
        fate = arena["fate"][k]
        if fate == ACTIVE:
            lane["track_status"][k] = TRACKED
        else:
            lane["track_status"][k] = NONE if fate == ABSENT else FINISHED
        for i in range(2):
            lane["track_r_N"][2 * k + i] = arena["r_R_N"][k, i]
        lane["track_sin"][k] = math.sin(arena["heading"][k])
        lane["track_cos"][k] = math.cos(arena["heading"][k])
        lane["track_p_spin"][k] = 1.0 if spinning(arena, k) else 0.0
        lane["track_phase"][k] = arena["t"] - arena["reversal_t"][k]
    for k in range(OBSTACLES):
        for i in range(2):
            lane["obstacle_r_N"][2 * k + i] = arena["r_R_N"][ROBOTS + k, i]


@kernel
def note_touch(lane, cfg):
    """Tell the filters of a bump or a touch that the aircraft has just felt."""
    if lane["landed"] == 0 or lane["noted"]:
        lane["noted"] = 0 if lane["landed"] == 0 else 1
        return
    lane["noted"] = 1
    nearest, track = REACH, -1
    for j in range(ROBOTS):
        north = lane["track_r_N"][2 * j] - lane["r_V_N"][0]
        east = lane["track_r_N"][2 * j + 1] - lane["r_V_N"][1]
        if lane["track_status"][j] == TRACKED and math.hypot(north, east) < nearest:
            nearest, track = math.hypot(north, east), j
    if track >= 0:
        herd.tell(lane["bank"], track, lane["touched_top"] == 0, cfg)


@kernel
def take_picture(lane, arena, cfg, work):
    """Look down, and let every filter use what is found."""
    pose, active = work["camera"], work["active"]
    pose[0, 0], pose[0, 1], pose[0, 2] = lane["r_V_N"][0], lane["r_V_N"][1], -lane["height"]
    quadrotor.attitude(lane["q_V"], work["C_BN"])
    mount(work["C_BN"], pose)
    for k in range(ROBOTS):
        active[k] = 1.0 if arena["fate"][k] == ACTIVE else 0.0
    see_obstacles(lane, arena, pose, cfg)
    count = look(
        pose, arena["r_R_N"][:ROBOTS], active, cfg, arena["seed"], arena["episode"],
        arena["tick"], CAMERA + lane["agent"], work["seen"], work["labels"],
    )  # fmt: skip
    take_in(lane, count, cfg, work)


@kernel
def take_in(lane, count, cfg, work):
    """Let every filter use `count` findings of the picture from work["camera"]."""
    pose, seen = work["camera"], work["seen"]
    herd.step(lane["bank"], seen, count, pose, cfg["camera_every"], cfg, work["herd"])
    copy_tracks(lane)


@kernel
def see_obstacles(lane, arena, pose, cfg):
    """Remember where the obstacles in view are: their poles tell them from the robots.

    The pose is the true one; what is remembered is as far off as the aircraft believes itself.
    """
    for k in range(OBSTACLES):
        r = arena["r_R_N"][ROBOTS + k]
        lane["obstacle_age"][k] += cfg["camera_every"]
        if arena["fate"][ROBOTS + k] != ACTIVE or not in_view(pose, r[0], r[1], 0.0, cfg):
            continue
        stream = POLES_SEEN + lane["agent"]
        u = uniform(arena["seed"], arena["episode"], stream, arena["tick"], k)
        if u < cfg["p_detect"]:
            lane["obstacle_age"][k] = 0.0
            for i in range(2):
                lane["bank"]["r_O_N"][k, i] = r[i] + lane["off_N"][i]
                lane["obstacle_r_N"][2 * k + i] = lane["bank"]["r_O_N"][k, i]


@kernel
def copy_tracks(lane):
    """Write the filters' public figures for the row."""
    bank = lane["bank"]
    for j in range(ROBOTS):
        lane["track_r_N"][2 * j], lane["track_r_N"][2 * j + 1] = (
            bank["r_N"][j, 0],
            bank["r_N"][j, 1],
        )
        lane["track_sin"][j] = math.sin(bank["heading"][j])
        lane["track_cos"][j] = math.cos(bank["heading"][j])
        lane["track_p_spin"][j], lane["track_phase"][j] = bank["p_spin"][j], bank["phase"][j]
        lane["track_sd_r"][j], lane["track_sd_heading"][j] = bank["sd_r"][j], bank["sd_heading"][j]
        lane["track_sd_phase"][j], lane["track_age"][j] = bank["sd_phase"][j], bank["age"][j]
        lane["track_status"][j] = bank["status"][j]


@kernel
def describe(team, m, cfg, work):
    """Write what follows for the row of aircraft m: times to contact, other aircraft, choices."""
    lane = team[m]
    free, allowed = lane["stage"] == CRUISE, lane["allowed"]
    allowed[0] = 1.0
    for i in range(ROBOTS):
        tracked = lane["track_status"][i] == TRACKED
        lane["t_contact"][i] = 0.0
        if tracked:
            lane["t_contact"][i] = meet(lane, i, BLOCK, 0.0, cfg, work["pose"], work["aim"])
        able = 1.0 if free and tracked else 0.0
        for k in range(len(DELAYS)):
            allowed[number_of(i, BLOCK, k)] = able
            allowed[number_of(i, TAP, k)] = 0.0 if cfg["services"] == BLOCK_ONLY else able
        allowed[look_at(i)] = able
    for k in range(SIDE * SIDE):
        allowed[FIRST_PLACE + k] = 1.0 if free else 0.0
    tell_others(team, m)


@kernel
def tell_others(team, m):
    """Tell aircraft m where the others are, where they are bound, and who goes first.

    An aircraft that is busy goes before one that is free, else the lower number.
    """
    lane, n = team[m], 0
    for k in range(team.shape[0]):
        if k == m:
            continue
        other = team[k]
        for i in range(2):
            lane["others_N"][4 * n + i] = other["r_V_N"][i]
            lane["others_N"][4 * n + 2 + i] = other["aim_N"][i]
        lane["others_first"][n] = 1.0 if k < m or other["stage"] != CRUISE else 0.0
        n += 1
