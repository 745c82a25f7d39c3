"""A camera that looks straight down from an aircraft and finds ground robots in its picture.

The picture is 320 x 240 (IARC, section V), its long side across the aircraft's heading. What is
found of a robot is the centre of its top plate, so that depths count from the plate. A finding is
given as the place on the ground (north, east) that its pixel shows, at the aircraft's known pose
(4,): north, east, down in N (m), heading (rad).

Settings: a record with fov (rad, across), sigma_pixel (px), p_detect, and false_detections, the
mean number in a picture.
"""

from __future__ import annotations

import math

from visenvs.core.compile import kernel
from visenvs.core.noise import normal_pair, uniform, uniform_pair

WIDTH, HEIGHT = 320.0, 240.0  # px
TOP = 0.1  # height of a robot, m
FALSE = 3  # false detections in a picture at most
FALSE_DRAWS = 1 << 16  # first draw of theirs, so that a robot more shifts none
NOTHING = -1.0  # label of a false detection


@kernel
def depth(pose):
    """How far below the camera the robots' tops are, m; 0 for a camera on the ground."""
    return max(-pose[2] - TOP, 0.0)


@kernel
def pixel_size(pose, cfg):
    """What a pixel measures on the robots' tops, m: depth over the focal length (14)."""
    return depth(pose) * 2.0 * math.tan(0.5 * cfg["fov"]) / WIDTH


@kernel
def in_view(pose, north, east, margin, cfg):
    """Whether a place on the ground is in the picture, by at least `margin` (m) from its edge."""
    c, s = math.cos(pose[3]), math.sin(pose[3])
    ahead = c * (north - pose[0]) + s * (east - pose[1])
    right = c * (east - pose[1]) - s * (north - pose[0])
    size = 0.5 * pixel_size(pose, cfg)
    return abs(right) + margin < WIDTH * size and abs(ahead) + margin < HEIGHT * size


@kernel
def look(pose, r, active, cfg, seed, episode, step, stream, seen, labels):
    """Find the robots in view, and what looks like one; returns how many were found.

    Args:
        r: true places of the robots (north, east), m, (robots, 2); active: 1 for those there.
        seed, episode, step, stream: name the draws (`core.noise`): 2 i for the noise of robot i,
            2 i + 1 for its detection.
        seen: receives the places found, m, (robots + FALSE, 2).
        labels: receives the robot of each, NOTHING for a false one, (robots + FALSE,).
    """
    count, sd = 0, cfg["sigma_pixel"] * pixel_size(pose, cfg)
    for i in range(r.shape[0]):
        found = active[i] > 0.0 and in_view(pose, r[i, 0], r[i, 1], 0.0, cfg)
        if found and uniform(seed, episode, stream, step, 2 * i + 1) < cfg["p_detect"]:
            north, east = normal_pair(seed, episode, stream, step, 2 * i)
            seen[count, 0], seen[count, 1] = r[i, 0] + sd * north, r[i, 1] + sd * east
            labels[count] = i
            count += 1
    half = 0.5 * pixel_size(pose, cfg)
    c, s = math.cos(pose[3]), math.sin(pose[3])
    for k in range(FALSE):
        draw = FALSE_DRAWS + 2 * k
        if half > 0.0 and uniform(seed, episode, stream, step, draw) < (
            cfg["false_detections"] / FALSE
        ):
            u, v = uniform_pair(seed, episode, stream, step, draw + 1)
            right, ahead = WIDTH * half * (2.0 * u - 1.0), HEIGHT * half * (2.0 * v - 1.0)
            seen[count, 0] = pose[0] + c * ahead - s * right
            seen[count, 1] = pose[1] + s * ahead + c * right
            labels[count] = NOTHING
            count += 1
    return count
