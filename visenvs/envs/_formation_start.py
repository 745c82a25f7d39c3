"""How a formation flight starts: what is drawn, and each follower in its place behind its leader.

In a steady turn everything circles about one centre, at (0, R) in a follower's frame F. Its leader
at (x, y) circles with R_L = V_L / w, so that R = y + sqrt(R_L^2 - x^2), and the leader's course is
asin(x / R_L) ahead of the follower's.
"""

from __future__ import annotations

import math

from visenvs.core.compile import kernel
from visenvs.core.noise import normal, normal_pair, uniform, uniform_pair
from visenvs.dynamics.leader import PROFILES, accelerate, sway, turn_rate
from visenvs.envs._formation_config import DRAWN, V_FORMATION

PLACE, AGENTS = 0, 1  # noise streams: of the leader, which a team shares, and of each follower
DRAWS = 8  # of one follower
ARMS = 2.0  # wingspans that the arms of a drawn V are to either side at least


@kernel
def parent_of(agent, cfg):
    """Whom a follower follows: the number of another one of its team, or -1 for the leader."""
    return agent - 2 if cfg["formation"] == V_FORMATION and agent > 0 else agent - 1


@kernel
def between(ends, u):
    """A uniform draw between two ends."""
    return ends[0] + u * (ends[1] - ends[0])


@kernel
def plan_leader(lane, cfg):
    """Draw profile and speed and put the leader at the origin; the same for all of a team."""
    seed, episode, plan, leader = lane["seed"], lane["episode"], lane["plan"], lane["leader"]
    drawn = cfg["start"] == DRAWN
    u_profile, u_speed = uniform_pair(seed, episode, PLACE, 0, 0)
    u_turn, u_rate = uniform_pair(seed, episode, PLACE, 0, 1)
    u_switch, u_course = uniform_pair(seed, episode, PLACE, 0, 2)
    u_dark, u_long = uniform_pair(seed, episode, PLACE, 0, 3)
    plan["profile"] = int(u_profile * len(PROFILES)) if drawn else cfg["profile"]
    plan["turn"] = between(cfg["turn"], u_turn)
    plan["rate"] = between(cfg["weave_rate"], u_rate)
    plan["a_lat"] = cfg["leader_sd_lat"] * normal(seed, episode, PLACE, 0, 4)
    share = u_switch if drawn else 1.0
    plan["switch"][0] = share * cfg["switch"][0]
    plan["switch"][1] = share * cfg["switch"][1]
    for i in range(3):
        plan["amplitude"][i] = cfg["weave"][i]
        leader["r_N"][i] = 0.0
    lane["blackout"][0] = u_dark * cfg["t_f"] if drawn else cfg["blackout"][0]
    lane["blackout"][1] = u_long * cfg["blackout"][1] if drawn else cfg["blackout"][1]
    course = 2.0 * math.pi * u_course if drawn else 0.0
    speed = between(cfg["speed"], u_speed)
    v = leader["v_N"]
    v[0], v[1], v[2] = speed * math.cos(course), speed * math.sin(course), 0.0
    leader["wingspan"] = cfg["wingspan"]
    lane["first_course"] = course
    accelerate(leader, turn_rate(plan, 0.0, speed), sway(plan, 0, 0.0), sway(plan, 2, 0.0))


@kernel
def plan_offsets(lane, cfg):
    """Write the commanded offsets and when each takes over.

    A drawn flight has one change, at a time between 0.2 and 0.8 of it. In a V the leader is to the
    right of even followers and to the left of odd ones; drawn offsets keep the two arms apart.
    """
    seed, episode, agent = lane["seed"], lane["episode"], lane["agent"]
    k, offsets, times = DRAWS * agent, lane["offsets"], lane["offset_times"]
    for i in range(3):
        offsets[0, i] = cfg["offset"][i]
        offsets[1, i], offsets[2, i], offsets[3, i] = (
            cfg["step_1"][i],
            cfg["step_2"][i],
            cfg["step_3"][i],
        )
        times[i] = cfg["step_times"][i] if cfg["step_times"][i] > 0.0 else math.inf
    if cfg["start"] == DRAWN:
        times[0] = cfg["t_f"] * (0.2 + 0.6 * uniform(seed, episode, AGENTS, 0, k + 3))
        for i in range(3):
            u, w = uniform_pair(seed, episode, AGENTS, 0, k + i)
            half = cfg["offset_drawn"][i]
            offsets[0, i] = cfg["offset"][i] + half * (2.0 * u - 1.0)
            offsets[1, i] = cfg["offset"][i] + half * (2.0 * w - 1.0)
    if cfg["formation"] == V_FORMATION:
        apart = ARMS * cfg["wingspan"] if cfg["start"] == DRAWN else 0.0
        for j in range(4):
            across = max(abs(offsets[j, 1]), apart)
            offsets[j, 1] = across if agent % 2 == 0 else -across


@kernel
def take_place(lane, course, rate, cfg):
    """Put a follower at its first offset behind its leader, moving as the formation does.

    Args:
        lane: its record, with the leader's place and the offsets.
        course: of its leader, rad.
        rate: turn rate of the formation, rad/s.
    """
    seed, episode, agent = lane["seed"], lane["episode"], lane["agent"]
    r_L, v_L, offset = lane["leader"]["r_N"], lane["leader"]["v_N"], lane["offsets"][0]
    r, v, a = lane["r_V_N"], lane["v_V_N"], lane["a_V_F"]
    speed, ahead = math.hypot(v_L[0], v_L[1]), 0.0
    if abs(rate) * abs(offset[0]) >= 0.9 * speed:
        rate = 0.0  # the offset does not fit on the circle
    if rate != 0.0:
        radius = speed / abs(rate)
        side = 1.0 if rate > 0.0 else -1.0
        ahead = side * math.asin(offset[0] / radius)
        speed = rate * (offset[1] + side * math.sqrt(radius * radius - offset[0] ** 2))
    heading = course - ahead
    c, s = math.cos(heading), math.sin(heading)
    r[0] = r_L[0] - c * offset[0] + s * offset[1]
    r[1] = r_L[1] - s * offset[0] - c * offset[1]
    r[2] = r_L[2] - offset[2]
    v[0], v[1], v[2] = speed * c, speed * s, v_L[2]
    a[0], a[1], a[2] = 0.0, speed * rate, 0.0
    if cfg["start"] == DRAWN:
        k = DRAWS * agent + 4
        for i in range(3):
            n, m = normal_pair(seed, episode, AGENTS, 0, k + i)
            r[i] += cfg["start_error"] * n
            v[i] += cfg["start_velocity_error"] * m
    lane["heading"] = math.atan2(v[1], v[0])
    lane["turn_rate"] = rate


@kernel
def tell(lane, cfg):
    """Draw what the follower is told of wingspan and range."""
    k = DRAWS * lane["agent"] + 7
    n, m = normal_pair(lane["seed"], lane["episode"], AGENTS, 0, k)
    r, square = lane["leader"]["r_N"], 0.0
    for i in range(3):
        square += (r[i] - lane["r_V_N"][i]) ** 2
    far = max(1.0 + cfg["range_bias"] + cfg["range_error"] * m, 0.1)
    lane["range_told"] = math.sqrt(square) * far
    lane["size_told"] = (
        lane["leader"]["wingspan"] * (1.0 + cfg["size_bias"]) * math.exp(-cfg["size_error"] * n)
    )
