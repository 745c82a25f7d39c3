"""Obstacles of an avoidance scene: where they are, and the tracks that the camera keeps of them."""

from __future__ import annotations

import math

import numpy as np

from visenvs.core.compile import kernel
from visenvs.core.noise import normal, uniform, uniform_pair
from visenvs.core.sight import see
from visenvs.envs._avoidance_config import CUT, FIXED, MOVING, K
from visenvs.envs._avoidance_sightings import (
    ERROR,
    GOAL,
    PLACE,
    SIGHTINGS,
    has_labels,
    look,
)
from visenvs.estimation import drifting, tracks
from visenvs.estimation.association import IGNORED, NEW, by_label
from visenvs.estimation.tracks import tracks_dtype, work_dtype

TRACKS = tracks_dtype(K + 1, cells=1)  # no bank: a lane is to be small
WORK = np.dtype(
    [
        ("tracker", work_dtype(K + 1, SIGHTINGS)),
        ("moving", drifting.SCRATCH),
        ("C", "f8", (3, 3)),  # attitude of vehicle and camera,
        ("wanted", "f8", (3, 3)),  # and the one that the command asks for
        ("u", "f8", (3,)),
        ("moved", "f8", (3,)),
        ("cone", "f8", (2, 3)),
        ("seen", "f8", (SIGHTINGS, 2)),
        ("labels", "f8", (SIGHTINGS,)),
        ("priors", "f8", (SIGHTINGS, 2)),
        ("key", "f8", (K,)),
        ("order", "i8", (K,)),
        ("found", "i8"),  # balls in a rendered picture, already in `seen` and `labels`,
        ("distance", "f8", (SIGHTINGS,)),  # and how far away by their size, m
    ]
)

COUNT, SPEED = 0, 1  # draws of PLACE at step 0; the speed has three
ALONG, ACROSS, DRIFT = 0, 1, ERROR + 1  # and at step 1 + label


@kernel
def place(lane, cfg):
    """Put the obstacles where the configuration says, or draw spheres that block the way."""
    seed, episode = lane["seed"], lane["episode"]
    n, low, high = cfg["obstacles"], cfg["along_drawn"][0], cfg["along_drawn"][1]
    if cfg["scene"] != FIXED:
        n = 1 + int(uniform(seed, episode, PLACE, 0, COUNT) * n)
    lane["count"] = n
    for i in range(n):
        u_along, u_radius = uniform_pair(seed, episode, PLACE, i + 1, ALONG)
        u_across, u_angle = uniform_pair(seed, episode, PLACE, i + 1, ACROSS)
        r, w = lane["r_O_N"][i], cfg["waypoint"]
        if cfg["scene"] == FIXED:
            lane["radius"][i] = cfg["radius"][i]
            r[0] = cfg["obstacle_x"][i] + (2.0 * u_along - 1.0) * cfg["spread_x"][i]
            r[1], r[2] = cfg["obstacle_y"][i], cfg["obstacle_z"][i]
            across = cfg["spread_yz"][i] * math.sqrt(u_across)
        else:
            smallest, largest = cfg["radius_drawn"][0], cfg["radius_drawn"][1]
            lane["radius"][i] = smallest + u_radius * (largest - smallest)
            r[0] = low + (i + u_along) / n * (high - low)
            r[1], r[2] = r[0] / w[0] * w[1], r[0] / w[0] * w[2]
            across = cfg["offset"] * lane["radius"][i] * math.sqrt(u_across)
        r[1] += across * math.cos(2.0 * math.pi * u_angle)
        r[2] += across * math.sin(2.0 * math.pi * u_angle)
        if cfg["drift"] > 0.0:
            set_adrift(lane, i, cfg)


@kernel
def set_adrift(lane, i, cfg):
    """Draw the velocity of obstacle i; it is where it was placed when the vehicle comes by."""
    seed, episode, r, v = lane["seed"], lane["episode"], lane["r_O_N"][i], lane["v_O_N"][i]
    t = r[0] / cfg["velocity"][0]
    for j in range(3):
        n = normal(seed, episode, PLACE, i + 1, DRIFT + j)
        v[j] = cfg["drift"] * min(max(n, -CUT), CUT)
        r[j] -= t * v[j]


@kernel
def tell_priors(lane, cfg, work):
    """Start the tracks of a prior that is told: the configured estimate and its deviation."""
    T, C, u = lane["tracks"], work["C"], work["u"]
    kind, scratch, seen = cfg["estimator"], work["tracker"]["filter"], work["seen"][0]
    if kind == MOVING:
        kind = tracks.CARTESIAN
    deviation = cfg["prior_deviation"]
    for i in range(lane["count"]):
        u[0] = lane["r_O_N"][i, 0] + cfg["error_x"][i]
        u[1] = lane["r_O_N"][i, 1] + cfg["error_y"][i]
        u[2] = lane["r_O_N"][i, 2] + cfg["error_z"][i]
        prior = work["priors"][0]
        seen[0], seen[1], prior[0] = see(cfg["sensor"], C, u, cfg["min_range"])
        prior[1] = deviation
        tracks.begin(kind, T, i, lane["r_V_N"], C, seen, prior, cfg, scratch)
        P, square = T["P"][i], u[0] * u[0] + u[1] * u[1] + u[2] * u[2]
        for j in range(3):
            if kind == tracks.CARTESIAN:
                T["x"][i, j] = lane["r_V_N"][j] + u[j]
                P[j, 0] = P[j, 1] = P[j, 2] = 0.0
                P[j, j] = deviation * deviation
            elif j != (0 if kind == tracks.SPHERICAL else 2):  # the angles
                P[j, j] += deviation * deviation / square
        T["alive"][i] = T["hits"][i] = T["votes"][i] = 1.0
        T["owner"][i] = i
        T["made"] += 1.0
        start_moving(lane, i, cfg)


@kernel
def track(lane, cfg, work):
    """Take an image, where one is due, and give it to the tracks."""
    T, r_V, scratch = lane["tracks"], lane["r_V_N"], work["tracker"]["filter"]
    kind, made = cfg["estimator"], T["made"]
    if kind == MOVING:
        track_moving(lane, cfg, work)
        kind = tracks.CARTESIAN
    else:
        if lane["step"] > 0:
            tracks.predict(kind, T, r_V, work["moved"], cfg, scratch)
        count = look(lane, cfg, work)
        if count >= 0:
            match(lane, kind, count, cfg, work)
            seen, labels, priors = work["seen"], work["labels"], work["priors"]
            threshold = -1.0 if has_labels(cfg) else cfg["ztest_max"]
            tracker, C = work["tracker"], work["C"]
            tracks.absorb(kind, T, r_V, C, seen, labels, priors, count, threshold, cfg, tracker)
        if kind == tracks.SPHERICAL:
            end_pre_run(lane, cfg, scratch)
    tracks.report(kind, T, r_V, cfg, scratch)
    for k in range(int(made), min(int(T["made"]), K)):
        lane["t_made"][k] = lane["step"] * cfg["dt"]


@kernel
def end_pre_run(lane, cfg, scratch):
    """Start the IISc report's filters anew at the end of the pre-run, as configured."""
    T, r_V, step = lane["tracks"], lane["r_V_N"], round(cfg["pre_run"] / cfg["dt"])
    if step == 0 or lane["step"] != step:
        return
    for j in range(K + 1):
        if T["alive"][j] > 0.0:
            x, P, history, deviation = T["x"][j], T["P"][j], T["history"][j], T["deviation"][j]
            tracks.spherical.restart(x, P, history, r_V, deviation, cfg, scratch)


@kernel
def track_moving(lane, cfg, work):
    """The same for obstacles with a velocity.

    The record of tracks keeps the position's part of every filter, for association and report.
    """
    T, r_V, C, tracker = lane["tracks"], lane["r_V_N"], work["C"], work["tracker"]
    for j in range(K + 1):
        if lane["step"] > 0 and T["alive"][j] > 0.0:
            drifting.predict(lane["x_O"][j], lane["P_O"][j], cfg["dt"], cfg["q"] * cfg["dt"])
            copy_position(lane, j)
    count = look(lane, cfg, work)
    if count < 0:
        return
    match(lane, tracks.CARTESIAN, count, cfg, work)
    choice, labels, seen, priors = tracker["choice"], work["labels"], work["seen"], work["priors"]
    for j in range(K + 1):
        T["unseen"][j] += 1.0
    for i in range(count):
        j = choice[i]
        if j >= 0:
            drifting.update(lane["x_O"][j], lane["P_O"][j], r_V, C, seen[i], cfg, work["moving"])
            copy_position(lane, j)
            tracks.count_hit(T, j, labels[i])
    threshold = -1.0 if has_labels(cfg) else cfg["ztest_max"]
    for i in range(count):
        if choice[i] == NEW:
            kind = tracks.CARTESIAN
            tracks.create(kind, T, i, r_V, C, seen, labels, priors, count, threshold, cfg, tracker)
    for j in range(K + 1):
        if T["alive"][j] > 0.0 and T["hits"][j] == 1.0 and T["unseen"][j] == 0.0:
            start_moving(lane, j, cfg)
    tracks.delete(T, cfg["delete_after"])


@kernel
def start_moving(lane, j, cfg):
    """Give track j, which is new, a velocity; the waypoint has none."""
    deviation = 0.0 if lane["tracks"]["owner"][j] == GOAL else cfg["drift"]
    x, P = lane["tracks"]["x"][j], lane["tracks"]["P"][j]
    drifting.begin(lane["x_O"][j], lane["P_O"][j], x, P, deviation)


@kernel
def copy_position(lane, j):
    """Copy position and its covariance from the filter of a moving obstacle to its track."""
    for i in range(3):
        lane["tracks"]["x"][j, i] = lane["x_O"][j, i]
        for k in range(3):
            lane["tracks"]["P"][j, i, k] = lane["P_O"][j, i, k]


@kernel
def match(lane, kind, count, cfg, work):
    """Find the track of every sighting."""
    T, tracker = lane["tracks"], work["tracker"]
    tracks.compare(kind, T, lane["r_V_N"], work["C"], work["seen"], count, cfg, tracker)
    if has_labels(cfg):
        choose(T, count, cfg, work)
    else:
        tracks.associate(count, cfg, tracker)


@kernel
def choose(T, count, cfg, work):
    """Give every sighting to the track of its label, unless it fails the z-test."""
    choice, ztest = work["tracker"]["choice"], work["tracker"]["ztest"]
    by_label(T["owner"], T["alive"], work["labels"], count, choice)
    for i in range(count):
        j = choice[i]
        if j >= 0 and cfg["ztest_max"] > 0.0 and ztest[i, j] > cfg["ztest_max"]:
            choice[i] = IGNORED
