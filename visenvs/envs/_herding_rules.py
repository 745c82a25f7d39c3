"""The rules of the mission: lines, touches, poles, the score."""

from __future__ import annotations

import math

from visenvs.core.compile import kernel
from visenvs.core.outcome import COLLISION, DIVERGED, MISS, RUNNING, SUCCESS
from visenvs.dynamics.ground_robot import ACTIVE, CIRCLES, GOALED, REMOVED, ROBOTS
from visenvs.envs._herding_aircraft import DESCENT, leave, true_place
from visenvs.envs._herding_config import MARGIN, QUADROTOR, TOUCHED_ONLY, VELOCITY, WHOLE
from visenvs.envs._herding_flight import stop_fall
from visenvs.guidance.interception import TAP

MARGIN_WIDTH = 0.5  # how far the centre must be out under the `margin` rule, m
POLE_RADIUS = 0.05  # m
POLES = (0.5, 1.0, 1.5, 2.0)  # heights, m
FAR = 1e3  # no robot gets so far from the centre, m


@kernel
def line_of(cfg):
    """How far from the centre a robot has crossed a line, m."""
    line = 0.5 * cfg["side"]
    if cfg["crossing"] == WHOLE:
        return line + cfg["robot_radius"]
    return line + (MARGIN_WIDTH if cfg["crossing"] == MARGIN else 0.0)


@kernel
def cross_lines(arena, cfg):
    """Take the robots that are over a line out of the arena, and charge those that are lost."""
    line = line_of(cfg)
    for k in range(ROBOTS):
        north, east = arena["r_R_N"][k, 0], arena["r_R_N"][k, 1]
        out = line <= abs(north) < FAR or line <= abs(east) < FAR
        if arena["fate"][k] != ACTIVE or not out:
            continue
        touched = arena["touched"][k] != 0
        if north >= line and (touched or cfg["count_only_touched"] != TOUCHED_ONLY):
            arena["fate"][k] = GOALED
            arena["goaled"] += 1.0
            arena["herded"] += 1.0 if touched else 0.0
            if arena["goaled"] == cfg["goal_count"]:
                arena["t_success"] = arena["t"]
        else:
            arena["fate"][k] = REMOVED
            arena["removed"] += 1.0
            arena["cost_lost"] += cfg["score_goal"] + cfg["score_lost"]


@kernel
def meet_tops(arena, lane, before, cfg):
    """Stop a quadrotor that sinks onto robots at their tops; before: its height a tick ago, m."""
    if cfg["dynamics"] != QUADROTOR or not lane["height"] < cfg["top_height"] <= before:
        return
    reach = cfg["robot_radius"] + cfg["aircraft_radius"]
    for k in range(ROBOTS):
        north = arena["r_R_N"][k, 0] - true_place(lane, 0)
        east = arena["r_R_N"][k, 1] - true_place(lane, 1)
        if arena["fate"][k] == ACTIVE and math.hypot(north, east) < reach:
            stop_fall(lane, cfg["top_height"], cfg)


@kernel
def feel_touches(team, cfg):
    """Bumps against landed aircraft, and aircraft that have come down onto a robot's top."""
    arena = team[0]
    for k in range(ROBOTS):
        if arena["fate"][k] == ACTIVE and arena["met"][k]:
            lane = team[arena["met"][k] - 1]
            if lane["landed"] == 0:
                lane["landed"] = k + 1
                lane["touched_top"] = 0
                lane["blocks"] += 1.0
                lane["touches"] += 1.0
            arena["touched"][k] = 1
    for m in range(team.shape[0]):
        lane = team[m]
        coming = lane["stage"] == DESCENT and lane["landed"] == 0
        if coming and lane["height"] <= cfg["top_height"]:
            if cfg["action_mode"] == VELOCITY:
                tap_nearest(arena, lane, cfg)
            elif lane["service"] == TAP:
                lane["aborts"] += 0.0 if tap_nearest(arena, lane, cfg) else 1.0
                leave(lane)


@kernel
def tap_nearest(arena, lane, cfg):
    """Touch the top of the robot beneath an aircraft; whether there is one."""
    for k in range(ROBOTS):
        north = arena["r_R_N"][k, 0] - true_place(lane, 0)
        east = arena["r_R_N"][k, 1] - true_place(lane, 1)
        if arena["fate"][k] == ACTIVE and math.hypot(north, east) <= cfg["tap_radius"]:
            arena["tapped"][k] = arena["touched"][k] = 1
            lane["landed"] = k + 1
            lane["touched_top"] = 1
            lane["taps"] += 1.0
            lane["touches"] += 1.0
            return True
    return False


@kernel
def hit_poles(team, cfg):
    """Count every time that an aircraft runs into the pole of an obstacle."""
    arena, reach = team[0], cfg["aircraft_radius"] + POLE_RADIUS
    for m in range(team.shape[0]):
        lane, hit = team[m], 0
        if lane["height"] < POLES[-1]:
            for k in range(ROBOTS, CIRCLES):
                north = arena["r_R_N"][k, 0] - true_place(lane, 0)
                east = arena["r_R_N"][k, 1] - true_place(lane, 1)
                below = lane["height"] < POLES[k - ROBOTS]
                if arena["fate"][k] == ACTIVE and below and math.hypot(north, east) < reach:
                    hit = 1
        if hit and not lane["at_pole"]:
            arena["pole_contacts"] += 1.0
        lane["at_pole"] = hit


@kernel
def sound(arena):
    """Whether the numbers of the arena are those of an arena."""
    total = arena["t"]
    for k in range(CIRCLES):
        if arena["fate"][k] == ACTIVE:
            total += abs(arena["r_R_N"][k, 0]) + abs(arena["r_R_N"][k, 1])
            total += 0.0 * arena["heading"][k]
    return total < FAR * CIRCLES


@kernel
def judge(arena, cfg):
    """Charge the time of a tick, and end the run where it is over."""
    arena["cost_time"] += cfg["score_minute"] * cfg["tick"] / 60.0
    arena["t_go"] = cfg["t_f"] - arena["t"]
    arena["remained"] = cfg["robots"] - arena["goaled"] - arena["removed"]
    if not sound(arena):
        arena["outcome"] = DIVERGED
    elif cfg["pole_limit"] and arena["pole_contacts"] >= cfg["pole_limit"]:
        arena["outcome"] = COLLISION
    elif arena["remained"] == 0.0 or arena["t_go"] < 0.5 * cfg["tick"]:
        arena["outcome"] = SUCCESS if arena["goaled"] >= cfg["goal_count"] else MISS
    if arena["outcome"] != RUNNING:
        arena["cost_remained"] = cfg["score_goal"] * arena["remained"]


@kernel
def share(team):
    """Tell every aircraft of a team the score of the step, which is the arena's."""
    arena = team[0]
    arena["total_cost"] += arena["cost_lost"] + arena["cost_remained"] + arena["cost_time"]
    for m in range(1, team.shape[0]):
        lane = team[m]
        lane["outcome"] = arena["outcome"]
        lane["cost_lost"] = arena["cost_lost"]
        lane["cost_remained"] = arena["cost_remained"]
        lane["cost_time"] = arena["cost_time"]
        lane["total_cost"] = arena["total_cost"]
        lane["goaled"], lane["removed"] = arena["goaled"], arena["removed"]
        lane["remained"], lane["herded"] = arena["remained"], arena["herded"]
        lane["t_success"], lane["t_go"] = arena["t_success"], arena["t_go"]
        lane["pole_contacts"] = arena["pole_contacts"]
