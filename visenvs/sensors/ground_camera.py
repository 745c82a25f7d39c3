"""A camera that looks down from an aircraft, tilts with it, and finds ground robots in its picture.

The picture is 320 x 240 (IARC, section V), its long side across the aircraft. What is found of a
robot is the centre of its top plate, so that depths count from the plate. A finding is given as the
place on the ground (north, east) that its pixel shows, at the camera's known pose (4, 3): its
position in N (m), and the rows of its attitude C_CN (optical axis, right, down).

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
HORIZON = 0.05  # least downward part of a ray that ends on the ground


@kernel
def mount(C_BN, pose):
    """Write the attitude of a camera that looks along the body's down axis, forward on top."""
    for i in range(3):
        pose[1, i], pose[2, i], pose[3, i] = C_BN[2, i], C_BN[1, i], -C_BN[0, i]


@kernel
def depth(pose):
    """How far below the camera the robots' tops are, m; 0 for a camera on the ground."""
    return max(-pose[0, 2] - TOP, 0.0)


@kernel
def size_at(distance, cfg):
    """What a pixel measures so far along the optical axis, m: over the focal length (14)."""
    return distance * 2.0 * math.tan(0.5 * cfg["fov"]) / WIDTH


@kernel
def pixel_size(pose, cfg):
    """What a pixel measures on the robots' tops straight below a level camera, m."""
    return size_at(depth(pose), cfg)


@kernel
def along(pose, axis, north, east):
    """Coordinate (m) of a place on the robots' tops along an axis of the camera, 0 the optical."""
    C = pose[1 + axis]
    return C[0] * (north - pose[0, 0]) + C[1] * (east - pose[0, 1]) + C[2] * depth(pose)


@kernel
def stretch(pose, north, east):
    """How many times more a pixel measures at a place than a level camera's: mean of both sides.

    A plane's picture is smaller by the third power of the distance along the optical axis.
    """
    share = max(along(pose, 0, north, east), 0.0) / max(depth(pose), 1e-9)
    return share * math.sqrt(share)


@kernel
def in_view(pose, north, east, margin, cfg):
    """Whether a place on the ground is in the picture, by at least `margin` (m) from its edge."""
    half = 0.5 * size_at(along(pose, 0, north, east), cfg)
    right, down = along(pose, 1, north, east), along(pose, 2, north, east)
    return abs(right) + margin < WIDTH * half and abs(down) + margin < HEIGHT * half


@kernel
def displace(pose, right, down, place):
    """Move a place to where a point beside it shows, so far off in the picture's plane, m."""
    off = pose[2, 2] * right + pose[3, 2] * down
    share = off / (depth(pose) + off)
    for i in range(2):
        beside = pose[2, i] * right + pose[3, i] * down
        place[i] += beside - share * (place[i] + beside - pose[0, i])


@kernel
def ground_at(pose, right, down, place):
    """Write the place on the ground that a ray shows; False where it ends nowhere.

    right, down: of the ray where it is as far along the optical axis as the tops are below, m.
    """
    far = depth(pose)
    fall = pose[1, 2] * far + pose[2, 2] * right + pose[3, 2] * down
    if fall < HORIZON * far:
        return False
    for i in range(2):
        ray = pose[1, i] * far + pose[2, i] * right + pose[3, i] * down
        place[i] = pose[0, i] + ray * (far / fall)
    return True


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
    count = 0
    for i in range(r.shape[0]):
        found = active[i] > 0.0 and in_view(pose, r[i, 0], r[i, 1], 0.0, cfg)
        if found and uniform(seed, episode, stream, step, 2 * i + 1) < cfg["p_detect"]:
            up, right = normal_pair(seed, episode, stream, step, 2 * i)
            sd = cfg["sigma_pixel"] * size_at(along(pose, 0, r[i, 0], r[i, 1]), cfg)
            seen[count, 0], seen[count, 1] = r[i, 0], r[i, 1]
            displace(pose, sd * right, -sd * up, seen[count])
            labels[count] = i
            count += 1
    half = 0.5 * pixel_size(pose, cfg)
    for k in range(FALSE):
        draw = FALSE_DRAWS + 2 * k
        if half > 0.0 and uniform(seed, episode, stream, step, draw) < (
            cfg["false_detections"] / FALSE
        ):
            u, v = uniform_pair(seed, episode, stream, step, draw + 1)
            right, up = WIDTH * half * (2.0 * u - 1.0), HEIGHT * half * (2.0 * v - 1.0)
            if ground_at(pose, right, -up, seen[count]):
                labels[count] = NOTHING
                count += 1
    return count
