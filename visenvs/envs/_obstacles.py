"""Obstacles of an avoidance scene: where they are, what the camera tells of them, and the tracks.

The last label, GOAL, is the waypoint's where that has to be seen, too.
"""

from __future__ import annotations

import math

import numpy as np

from visenvs.core.compile import kernel
from visenvs.core.noise import normal, normal_pair, uniform, uniform_pair
from visenvs.core.sight import differ, noise_variance, see
from visenvs.envs._avoidance_config import (
    CUT,
    FIXED,
    GIVEN,
    IMAGES,
    KNOWN,
    MOVING,
    NEAREST,
    SEEN,
    SIZE,
    TOLD,
    UNIFORM,
    K,
)
from visenvs.estimation import drifting, tracks
from visenvs.estimation.association import IGNORED, NEW, by_label
from visenvs.estimation.tracks import NOBODY, tracks_dtype, work_dtype
from visenvs.sensors.camera import in_view

GOAL = K  # its label
SIGHTINGS = K + 2  # of the obstacles, the waypoint, and one of nothing
TRACKS = tracks_dtype(K + 1, cells=1)  # no bank: a lane is to be small
WORK = np.dtype(
    [
        ("tracker", work_dtype(K + 1, SIGHTINGS)),
        ("moving", drifting.SCRATCH),
        ("C", "f8", (3, 3)),
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

PLACE, IMAGE, FALSE = 0, 1, 1 + SIGHTINGS  # noise streams; an image of label i is IMAGE + i
COUNT, SPEED = 0, 1  # draws of PLACE at step 0; the speed has three
ALONG, ACROSS, ERROR, DRIFT = 0, 1, 2, 3  # draws of PLACE at step 1 + label


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
def relative(lane, label, cfg, out):
    """Write the true position of an obstacle or the GOAL relative to the vehicle, N, m, (3,)."""
    for j in range(3):
        at = cfg["waypoint"][j] if label == GOAL else lane["r_O_N"][label, j]
        out[j] = at - lane["r_V_N"][j]


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
        T["alive"][i] = T["hits"][i] = 1.0
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
            T["hits"][j] += 1.0
            T["unseen"][j] = T["missed"][j] = 0.0
            T["wrong"] += 1.0 if T["owner"][j] != labels[i] else 0.0
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
def has_labels(cfg):
    """Whether the image processor tells obstacles apart; in rendered pictures all look alike."""
    return cfg["association"] == KNOWN and cfg["perception"] != IMAGES


@kernel
def choose(T, count, cfg, work):
    """Give every sighting to the track of its label, unless it fails the z-test."""
    choice, ztest = work["tracker"]["choice"], work["tracker"]["ztest"]
    by_label(T["owner"], T["alive"], work["labels"], count, choice)
    for i in range(count):
        j = choice[i]
        if j >= 0 and cfg["ztest_max"] > 0.0 and ztest[i, j] > cfg["ztest_max"]:
            choice[i] = IGNORED


@kernel
def look(lane, cfg, work):
    """Take an image and keep it; returns how many sightings it gave, -1 where none is due."""
    count = -1
    if lane["step"] % cfg["image_every"] == 0:
        count = process(lane, cfg, work)
    lane["sighted"] = max(count, 0)
    for i in range(count):
        lane["sightings"][i, 0], lane["sightings"][i, 1] = work["seen"][i, 0], work["seen"][i, 1]
    return count


@kernel
def process(lane, cfg, work):
    """Write what the image processor tells: sightings, labels and priors; returns how many."""
    count, nearest, u, labels = 0, math.inf, work["u"], work["labels"]
    if cfg["perception"] == IMAGES:
        for i in range(work["found"]):
            set_prior(lane, max(int(labels[i]), 0), i, work["distance"][i], cfg, work)
        return work["found"]
    for i in range(lane["count"]):
        relative(lane, i, cfg, u)
        if sight(lane, i, count, cfg, work):
            distance = u[0] * u[0] + u[1] * u[1] + u[2] * u[2]
            if cfg["report"] != NEAREST or nearest == math.inf:
                nearest, count = distance, count + 1
            elif distance < nearest:
                nearest = distance
                move_row(work, count, count - 1)
    if cfg["goal"] == SEEN:
        relative(lane, GOAL, cfg, u)
        if sight(lane, GOAL, count, cfg, work):
            count += 1
    if cfg["association"] != KNOWN and false_point(lane, 0, count, cfg, work):
        labels[count] = NOBODY
        count += 1
    return count


@kernel
def move_row(work, source, target):
    """Copy a sighting with its label and prior to another row."""
    work["labels"][target] = work["labels"][source]
    for j in range(2):
        work["seen"][target, j] = work["seen"][source, j]
        work["priors"][target, j] = work["priors"][source, j]


@kernel
def sight(lane, label, row, cfg, work):
    """Write the sighting of what is at work["u"], or a false one in its place; False for none."""
    seed, episode, step, stream = lane["seed"], lane["episode"], lane["step"], IMAGE + label
    first, second, distance = see(cfg["sensor"], work["C"], work["u"], cfg["min_range"])
    ahead = work["u"][0]
    work["labels"][row] = label
    if cfg["association"] == KNOWN and false_point(lane, label, row, cfg, work):
        return True
    set_prior(lane, label, row, distance, cfg, work)
    if not in_view(ahead, first, second, cfg["min_range"], cfg["half_width"]):
        return False
    if cfg["p_detect"] < 1.0 and uniform(seed, episode, stream, step, 1) >= cfg["p_detect"]:
        return False
    sd = math.sqrt(noise_variance(distance, cfg))
    n_first, n_second = normal_pair(seed, episode, stream, step, 0)
    work["seen"][row, 0] = differ(cfg["sensor"], first + sd * n_first, 0.0)
    work["seen"][row, 1] = differ(cfg["sensor"], second + sd * n_second, 0.0)
    return True


@kernel
def false_point(lane, label, row, cfg, work):
    """Perhaps write a false sighting, anywhere in the picture; returns whether there is one."""
    if cfg["p_false"] == 0.0:
        return False
    seed, episode, step = lane["seed"], lane["episode"], lane["step"]
    if uniform(seed, episode, FALSE, step, 2 * label) >= cfg["p_false"]:
        return False
    u_first, u_second = uniform_pair(seed, episode, FALSE, step, 2 * label + 1)
    work["seen"][row, 0] = (2.0 * u_first - 1.0) * cfg["half_width"]
    work["seen"][row, 1] = (2.0 * u_second - 1.0) * cfg["half_width"]
    # its size means nothing, either: half of the way that is left
    set_prior(lane, label, row, 0.5 * (cfg["waypoint"][0] - lane["r_V_N"][0]), cfg, work)
    return True


@kernel
def set_prior(lane, label, row, distance, cfg, work):
    """Write what is told of the distance of a new track, and its standard deviation, m.

    SIZE: the true distance is the prior times 1 + range_error n, so that it is over- and
    underestimated alike; n is the same throughout an episode, as that of a size misjudged.
    """
    seed, episode, prior = lane["seed"], lane["episode"], work["priors"][row]
    if cfg["prior"] == SIZE:
        n = normal(seed, episode, PLACE, label + 1, ERROR)
        prior[0] = distance / (1.0 + cfg["range_error"] * min(max(n, -CUT), CUT))
        prior[1] = cfg["range_error"] * prior[0]
    elif cfg["prior"] == UNIFORM:
        u = uniform(seed, episode, PLACE, label + 1, ERROR)
        prior[0] = distance * (1.0 + (2.0 * u - 1.0) * cfg["range_error"])
        prior[1] = cfg["range_error"] / math.sqrt(3.0) * prior[0]
        if cfg["estimator"] == tracks.SPHERICAL:
            prior[1] = cfg["prior_deviation"]
    elif cfg["prior"] == GIVEN:
        prior[0] = cfg["prior_first"] if lane["tracks"]["made"] == 0.0 else cfg["prior_later"]
        prior[1] = cfg["prior_deviation"]
    elif cfg["prior"] == TOLD:
        prior[0], prior[1] = distance, cfg["prior_deviation"]
