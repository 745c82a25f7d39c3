"""Where to fly and look so that a map of lines becomes whole: three patterns, and information gain.

The patterns do not look at the map. They follow a path over the square area by a carrot that runs
ahead of the aircraft: `circle` about the middle with the camera towards it, and, with the camera
straight down, `zigzag` and `boustrophedon` (there and back in parallel lanes that leave no gap).

`information-gain` compares accelerations and directions of the camera by what one picture after a
manoeuvre would tell, in nats: 1/2 log(1 + h' P h / sigma^2) for each line in view, seen across its
largest deviation, and a constant for each cell of the area that is shown for the first time.
"""

from __future__ import annotations

import math
from functools import partial
from typing import Any

import numpy as np

from visenvs.core.compile import kernel
from visenvs.core.frames import camera_towards, rotate
from visenvs.core.pinhole import jacobian, project
from visenvs.core.registry import Law

ZIGZAG, BOUSTROPHEDON = range(2)
RADIUS = 0.6  # of the circle, half sides of the area
LEAD = 0.5  # rad, by which the carrot is ahead on the circle
OVERLAP = 0.1  # of two neighbouring lanes' strips
NORTH, EAST, ALONG = range(3)  # memory of a pattern: its first corner, and how far along it is
STIFFNESS = 1.0  # of the speed's error, 1/s

DIRECTIONS = 8  # that are compared, beside none, for the acceleration and for the camera
MANOEUVRE = 3.0  # s
CELL = 3.0  # nats of a new cell


@kernel
def pursue(belief, north, east, speed, command):
    """Command the acceleration that brings the velocity to `speed` (m/s) towards a point in N."""
    x, y = north - belief["r_V_N"][0], east - belief["r_V_N"][1]
    away = math.sqrt(x * x + y * y)
    wanted = min(speed, away) / away if away > 0.0 else 0.0
    command[0] = STIFFNESS * (wanted * x - belief["v_V_N"][0])
    command[1] = STIFFNESS * (wanted * y - belief["v_V_N"][1])


@kernel
def look_at(belief, north, east, settings, command):
    """Command the camera towards a point on the ground, in N, as far as it turns."""
    x, y = north - belief["r_V_N"][0], east - belief["r_V_N"][1]
    widest = settings["altitude"] * math.tan(settings["tilt_max"])
    away = max(math.sqrt(x * x + y * y), widest)
    share = settings["tilt_max"] / away if away > 0.0 else 0.0
    command[2], command[3] = share * x, share * y


@kernel
def fly_circle(beliefs, settings, commands):
    """Circle clockwise about the middle, and look there."""
    s = settings[0]
    radius = max(RADIUS * s["area"], s["altitude"] * s["half_width"])
    speed = min(s["v_max"], math.sqrt(0.5 * s["a_max"] * radius))
    for i in range(beliefs.shape[0]):
        r = beliefs[i]["r_V_N"]
        angle = math.atan2(r[1], r[0]) + LEAD
        north, east = radius * math.cos(angle), radius * math.sin(angle)
        pursue(beliefs[i], north, east, speed, commands[i])
        look_at(beliefs[i], 0.0, 0.0, s, commands[i])


@kernel
def pattern_point(pattern, along, settings):
    """Point of a pattern, (north, east), after so many metres from its south-west corner.

    After its end it is flown back.
    """
    swath = settings["altitude"] * settings["half_width"]
    half = max(settings["area"] - (1.0 - OVERLAP) * swath, 0.0)
    if half == 0.0:
        return 0.0, 0.0
    lanes = math.ceil(half / ((1.0 - OVERLAP) * swath)) + 1
    legs = lanes - 1
    if pattern == ZIGZAG:
        length = 2.0 * half * math.sqrt(1.0 + 1.0 / legs**2)
        total = legs * length
    else:
        length = 2.0 * half * (1.0 + 1.0 / legs)
        total = lanes * 2.0 * half + 2.0 * half
    along = along % (2.0 * total)
    along = min(along, 2.0 * total - along)
    leg = math.floor(along / length)
    rest = along - leg * length
    side = -1.0 if leg % 2 == 0 else 1.0
    if pattern == ZIGZAG:
        return -half + 2.0 * half * along / total, side * (half - 2.0 * half * rest / length)
    east = side * (half - min(rest, 2.0 * half))
    return -half + (leg * 2.0 * half + max(rest - 2.0 * half, 0.0) * legs) / legs, east


@kernel
def fly_pattern(pattern, beliefs, settings, memory, commands):
    """Follow a pattern from the nearest corner of the area, and look straight down."""
    s = settings[0]
    lead = s["v_max"]
    for i in range(beliefs.shape[0]):
        r, m = beliefs[i]["r_V_N"], memory[i]
        if m[NORTH] == 0.0:
            m[NORTH] = 1.0 if r[0] < 0.0 else -1.0
            m[EAST] = 1.0 if r[1] < 0.0 else -1.0
        north, east = pattern_point(pattern, m[ALONG], s)
        north, east = m[NORTH] * north, m[EAST] * east
        if math.hypot(north - r[0], east - r[1]) < lead:
            m[ALONG] += s["v_max"] * s["dt"]
            north, east = pattern_point(pattern, m[ALONG], s)
            north, east = m[NORTH] * north, m[EAST] * east
        pursue(beliefs[i], north, east, s["v_max"], commands[i])
        commands[i, 2] = commands[i, 3] = 0.0


@kernel
def shows(C, r, settings):
    """Whether a camera of attitude C has a point at r (m, N, relative to it) in its picture."""
    X, Y, Z = rotate(C, r)
    edge = settings["half_width"] * X
    return X > settings["near"] and abs(Y) < edge and abs(Z) < edge


@kernel
def line_gain(first, last, w, k, r, C, settings, J):
    """Nats that one image tells of line k across its largest deviation.

    Args:
        first, last: its ends, and w: its deviation as a vector, those of all lines in a row, m, N.
        r: its middle relative to the camera, m, N, (3,).
        C: attitude of the camera.
        J: scratch, (2, 3).
    """
    X, y, z = project(C, r, settings["near"])
    jacobian(C, X, y, z, J)
    along_y = along_z = moved_y = moved_z = 0.0
    for i in range(3):
        d = last[3 * k + i] - first[3 * k + i]
        along_y += J[0, i] * d
        along_z += J[1, i] * d
        moved_y += J[0, i] * w[3 * k + i]
        moved_z += J[1, i] * w[3 * k + i]
    length = math.sqrt(along_y * along_y + along_z * along_z)
    h = (along_y * moved_z - along_z * moved_y) / max(length, 1e-9) / settings["sigma_image"]
    return 0.5 * settings["p_detect"] * math.log(1.0 + h * h)


@kernel
def picture_gain(belief, offset, C, settings, r, J):
    """Nats that one image tells of the row's lines and of cells not shown before.

    Args:
        belief: record of the row's fields.
        offset: from the aircraft now to the camera then, m, N, (3,).
        C: attitude of the camera then.
        r, J: scratch, (3,) and (2, 3).
    """
    first, last, w = belief["rhat_1_N"], belief["rhat_2_N"], belief["worst_N"]
    valid, covered, place = belief["valid"], belief["covered"], belief["r_V_N"]
    total, n = 0.0, covered.shape[0]
    for k in range(valid.shape[0]):
        if valid[k] > 0.0:
            for i in range(3):
                r[i] = 0.5 * (first[3 * k + i] + last[3 * k + i]) - offset[i]
            if shows(C, r, settings):
                total += line_gain(first, last, w, k, r, C, settings, J)
    side = int(math.sqrt(n) + 0.5)
    width = 2.0 * settings["area"] / side
    north, east = settings["area"] + place[0] + offset[0], settings["area"] + place[1] + offset[1]
    r[2] = -place[2] - offset[2]
    for c in range(n):
        if covered[c] == 0.0:
            r[0] = (c // side + 0.5) * width - north
            r[1] = (c % side + 0.5) * width - east
            if shows(C, r, settings):
                total += CELL
    return total


@kernel
def choice(k, longest):
    """Number k of no vector and DIRECTIONS vectors of a length, evenly spaced."""
    if k == 0:
        return 0.0, 0.0
    angle = 2.0 * math.pi * (k - 1) / DIRECTIONS
    return longest * math.cos(angle), longest * math.sin(angle)


@kernel
def best_gaze(belief, offset, settings, C, r, J):
    """The direction of the camera at a place that tells most, by its number, and how much, nats."""
    most, best = -1.0, 0
    for g in range(DIRECTIONS + 1):
        r[0], r[1] = choice(g, math.tan(settings["tilt_max"]))
        r[2] = 1.0
        camera_towards(r, C)
        gain = picture_gain(belief, offset, C, settings, r, J)
        if gain > most:
            most, best = gain, g
    return best, most


@kernel
def fly_information_gain(beliefs, settings, commands):
    """Accelerate towards the picture that tells most, and look where the next one does."""
    s, offset, r = settings[0], np.zeros(3), np.zeros(3)
    C, J = np.zeros((3, 3)), np.zeros((2, 3))
    for i in range(beliefs.shape[0]):
        v, most = beliefs[i]["v_V_N"], -math.inf
        for k in range(DIRECTIONS + 1):
            north, east = choice(k, s["a_max"])
            x, y = v[0] + MANOEUVRE * north, v[1] + MANOEUVRE * east
            shrink = min(1.0, s["v_max"] / max(math.sqrt(x * x + y * y), 1e-9))
            offset[0] = 0.5 * MANOEUVRE * (v[0] + shrink * x)
            offset[1] = 0.5 * MANOEUVRE * (v[1] + shrink * y)
            gain = best_gaze(beliefs[i], offset, s, C, r, J)[1]
            if gain > most:
                most, commands[i, 0], commands[i, 1] = gain, north, east
        for j in range(2):
            offset[j] = s["dt"] * (v[j] + 0.5 * s["dt"] * commands[i, j])
        best = best_gaze(beliefs[i], offset, s, C, r, J)[0]
        commands[i, 2], commands[i, 3] = choice(best, s["tilt_max"])


OWN = ("r_V_N", "v_V_N")
LIMITS = ("dt", "a_max", "v_max", "tilt_max", "altitude", "area", "half_width")


def pattern(name: str, summary: str, code: int) -> Law:
    """The card of a pattern that is flown from the nearest corner."""
    return Law(
        name=name,
        summary=summary,
        source="thesis 2.4.4" if code == ZIGZAG else "coverage baseline",
        needs=OWN,
        settings=LIMITS,
        decide=partial(fly_pattern, code),
        memory=_three,
    )


def _three(_settings: Any, _size: int) -> int:
    return 3


LAWS = (
    Law(
        name="circle",
        summary="circles about the middle of the area and looks there",
        source="thesis 2.4.4",
        needs=OWN,
        settings=LIMITS,
        decide=fly_circle,
    ),
    pattern("zigzag", "crosses the area to and fro, looking down", ZIGZAG),
    pattern("boustrophedon", "flies parallel lanes, looking down", BOUSTROPHEDON),
    Law(
        name="information-gain",
        summary="flies and looks where the picture after one manoeuvre tells most",
        source="one-step greedy gain of information",
        needs=(*OWN, "covered", "rhat_1_N", "rhat_2_N", "worst_N", "valid"),
        settings=(*LIMITS, "near", "sigma_image", "p_detect"),
        decide=fly_information_gain,
    ),
)
