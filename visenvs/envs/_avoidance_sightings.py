"""What the camera of an avoidance scene tells of the obstacles, image by image.

The last label, GOAL, is the waypoint's where that has to be seen, too. The camera is fixed to the
vehicle, whose attitude work["C"] holds (C_CN); the vehicle knows it.
"""

from __future__ import annotations

import math

from visenvs.core.compile import kernel
from visenvs.core.frames import rotate
from visenvs.core.noise import normal, normal_pair, uniform, uniform_pair
from visenvs.core.sight import differ, noise_variance, see
from visenvs.envs._avoidance_config import (
    CUT,
    GIVEN,
    IMAGES,
    KNOWN,
    NEAREST,
    SEEN,
    SIZE,
    TOLD,
    UNIFORM,
    K,
)
from visenvs.estimation.tracks import NOBODY, SPHERICAL
from visenvs.sensors.camera import in_view

GOAL = K  # its label
SIGHTINGS = K + 2  # of the obstacles, the waypoint, and one of nothing
PLACE, IMAGE, FALSE = 0, 1, 1 + SIGHTINGS  # noise streams; an image of label i is IMAGE + i
ERROR = 2  # draw of PLACE at step 1 + label


@kernel
def relative(lane, label, cfg, out):
    """Write the true position of an obstacle or the GOAL relative to the vehicle, N, m, (3,)."""
    for j in range(3):
        at = cfg["waypoint"][j] if label == GOAL else lane["r_O_N"][label, j]
        out[j] = at - lane["r_V_N"][j]


@kernel
def has_labels(cfg):
    """Whether the image processor tells obstacles apart; in rendered pictures all look alike."""
    return cfg["association"] == KNOWN and cfg["perception"] != IMAGES


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
    ahead = rotate(work["C"], work["u"])[0]
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
        if cfg["estimator"] == SPHERICAL:
            prior[1] = cfg["prior_deviation"]
    elif cfg["prior"] == GIVEN:
        prior[0] = cfg["prior_first"] if lane["tracks"]["made"] == 0.0 else cfg["prior_later"]
        prior[1] = cfg["prior_deviation"]
    elif cfg["prior"] == TOLD:
        prior[0], prior[1] = distance, cfg["prior_deviation"]


@kernel
def receive(picture, work):
    """Take over what was found in a rendered picture (`_avoidance_images.SIGHTED`)."""
    work["found"] = picture["count"]
    for i in range(picture["count"]):
        work["labels"][i], work["distance"][i] = picture["labels"][i], picture["distance"][i]
        work["seen"][i, 0], work["seen"][i, 1] = picture["seen"][i, 0], picture["seen"][i, 1]
