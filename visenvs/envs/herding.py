"""Herding: turn ten ground robots over one line of an arena, in ten minutes (IARC Mission 7).

The robots drive about by themselves and reverse every 20 s. An aircraft lands in front of one, so
that its bumper turns it about, or touches its top, so that it turns by 45 degrees. What there is to
choose is a service of a robot, so one step lasts as long as an aircraft is busy: a decision every
0.5 s on the way, none while it comes down, waits for the bump and climbs. What the aircraft knows
of the robots is what its camera sees of them, drawn as points or found in rendered pictures, or the
truth; of itself, the truth or what it navigates by (`_herding_images`, `_herding_navigation`).

North is the goal line. The cost is minus the mission's score, counted from the best that there is:
nothing lost is nothing paid.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from visenvs.core.compile import kernel
from visenvs.core.lanes import Task
from visenvs.core.layout import Choices, Frames, Row
from visenvs.core.noise import uniform
from visenvs.core.outcome import RUNNING
from visenvs.dynamics.arena import settle
from visenvs.dynamics.ground_robot import ACTIVE, CIRCLES, ROBOTS, drive_all
from visenvs.dynamics.kinematic_arena import crowded, touch
from visenvs.envs._herding_aircraft import CRUISE, choose, fly, obey, true_place
from visenvs.envs._herding_belief import begin_belief, describe, looks, sense
from visenvs.envs._herding_config import KINEMATIC, SCENARIOS, VELOCITY
from visenvs.envs._herding_layout import LANE, OBSERVATION, VELOCITY_ACTION, WORK
from visenvs.envs._herding_rules import (
    cross_lines,
    feel_touches,
    hit_poles,
    judge,
    meet_tops,
    share,
)
from visenvs.guidance.choices import CHOICES, HOVER, PER_ROBOT

ENV_ID = "visenvs/Herding-v0"

START = 2  # noise stream: rotation of the start
LONGEST = 60.0  # that a step can last, s
OVER, CONTACTS, PICTURES = 0, 1, 2  # what a step waits for (`run_team`)
Sensing = Callable[[NDArray[Any], int, Any, Any], None]


@kernel
def move_all(team, pads, cfg, work):
    """First half of a tick: aircraft fly, robots drive as if alone; writes who is in their way."""
    for m in range(team.shape[0]):
        pads[m, 0], pads[m, 1] = team[m]["r_V_N"][0], team[m]["r_V_N"][1]
    for m in range(team.shape[0]):
        before = team[m]["height"]
        if cfg["action_mode"] == VELOCITY:
            obey(team[m], cfg, work)
        else:
            fly(team[m], pads, m, cfg, work)
        meet_tops(team[0], team[m], before, cfg)
    for m in range(team.shape[0]):
        lane = team[m]
        pads[m, 0], pads[m, 1] = true_place(lane, 0), true_place(lane, 1)
        pads[m, 2] = 1.0 if lane["height"] < cfg["solid_height"] else 0.0
    drive_all(team[0], cfg)


@kernel
def settle_all(team, cfg, work):
    """Second half of a tick, after the contacts: rules, then what every aircraft comes to know."""
    arena = team[0]
    arena["tick"] += 1
    arena["t"] = arena["tick"] * cfg["tick"]
    feel_touches(team, cfg)
    cross_lines(arena, cfg)
    hit_poles(team, cfg)
    judge(arena, cfg)
    for m in range(team.shape[0]):
        sense(team[m], arena, cfg, work)


@kernel
def begin_step(team, actions, cfg):
    """Take up the choices; returns how many aircraft are free to choose again."""
    for m in range(team.shape[0]):
        lane, action = team[m], actions[m]
        if cfg["action_mode"] == VELOCITY:
            for i in range(2):
                lane["command"][i] = cfg["v_max"] * min(max(action[i], -1.0), 1.0)
            lane["down"] = 1.0 if action[2] > 0.0 else 0.0
        else:
            choose(lane, int(action[0]), cfg)
    return free(team, cfg)


@kernel
def free(team, cfg):
    """How many aircraft may choose."""
    count = 0
    for m in range(team.shape[0]):
        count += cfg["action_mode"] == VELOCITY or team[m]["stage"] == CRUISE
    return count


@kernel
def step_over(team, ticks, free_before, cfg):
    """Whether a step of so many ticks is over: in time, or since an aircraft has become free."""
    if team[0]["outcome"] != RUNNING or ticks * cfg["tick"] >= LONGEST:
        return True
    now = free(team, cfg)
    return now > free_before or (now > 0 and ticks >= round(cfg["dt"] / cfg["tick"]))


@kernel
def end_step(team, cfg, work):
    """Share the score, and write the rows' derived fields."""
    share(team)
    for m in range(team.shape[0]):
        describe(team, m, cfg, work)


@kernel
def run_team(team, actions, pads, near, progress, cfg, work):
    """One step of one arena; OVER when it is, else what has to be done outside of kernels.

    CONTACTS are settled by pymunk, PICTURES are taken. After that it is called again, and goes on
    in the middle of the tick where it has stopped.

    Args:
        team, actions: records and actions of the aircraft that share the arena.
        pads: receives place and solidity of each, (aircraft, 3); see `kinematic_arena.touch`.
        near: receives 1 for the circles that are in contact, (CIRCLES,).
        progress: ticks, aircraft that have been free, and what has just been done outside; zero at
            the beginning of a step, (3,).
    """
    done = progress[2]
    if done == OVER:
        progress[1] = begin_step(team, actions, cfg)
    while done != OVER or not step_over(team, progress[0], progress[1], cfg):
        if done == OVER:
            move_all(team, pads, cfg, work)
            if crowded(team[0], pads, near, cfg):
                if cfg["arena"] != KINEMATIC:
                    progress[2] = CONTACTS
                    return CONTACTS
                touch(team[0], pads, cfg)
        if done != PICTURES:
            settle_all(team, cfg, work)
            if looks(team[0], cfg):
                progress[2] = PICTURES
                return PICTURES
        done = OVER
        progress[0] += 1
        progress[1] = min(progress[1], free(team, cfg))
    end_step(team, cfg, work)
    return OVER


@kernel
def reset_team(team, cfg, work):
    """Start a run: robots on their circle heading outward, obstacles on theirs, aircraft between.

    Several aircraft stand side by side, as the robots start.
    """
    arena = team[0]
    turn = 2.0 * math.pi * uniform(arena["seed"], arena["episode"], START, 0, 0)
    begin = 2.0 * math.pi * uniform(arena["seed"], arena["episode"], START, 0, 1)
    for k in range(CIRCLES):
        robot = k < ROBOTS
        count, place = (cfg["robots"], k) if robot else (cfg["obstacles"], k - ROBOTS)
        if place >= count:
            continue
        angle = (turn if robot else begin) + 2.0 * math.pi * place / count
        radius = cfg["start_circle"] if robot else cfg["obstacle_circle"]
        arena["fate"][k] = ACTIVE
        arena["r_R_N"][k, 0], arena["r_R_N"][k, 1] = (
            radius * math.cos(angle),
            radius * math.sin(angle),
        )
        arena["heading"][k] = angle if robot else angle + 0.5 * math.pi
    for m in range(team.shape[0]):
        lane = team[m]
        lane["agent"], lane["stage"], lane["service"] = m, CRUISE, HOVER
        lane["q_V"][0] = 1.0
        lane["height"], lane["t_go"] = cfg["cruise"], cfg["t_f"]
        lane["remained"], lane["t_success"] = cfg["robots"], cfg["t_f"]
        lane["r_V_N"][1] = 2.0 * (m - 0.5 * (team.shape[0] - 1))
        lane["aim_N"][1] = lane["r_V_N"][1]
        begin_belief(lane, arena, cfg, work)
    for m in range(team.shape[0]):
        describe(team, m, cfg, work)


@kernel
def reset_lanes(lanes, config):
    """Start every team given."""
    work, cfg = np.zeros(1, WORK)[0], config[0]
    size = cfg["aircraft"]
    for i in range(0, lanes.shape[0], size):
        reset_team(lanes[i : i + size], cfg, work)


def step_lanes(
    lanes: NDArray[Any], actions: Row, config: NDArray[Any], sense: Sensing | None = None
) -> None:
    """Advance every team that is running; `sense` takes a team's pictures, that of lane i on."""
    work, cfg = np.zeros(1, WORK)[0], config[0]
    size = int(cfg["aircraft"])
    pads, near, progress = np.zeros((size, 3)), np.zeros(CIRCLES, np.int64), np.zeros(3, np.int64)
    for i in range(0, len(lanes), size):
        team, chosen = lanes[i : i + size], actions[i : i + size]
        if team["outcome"][0] == RUNNING:
            progress[:] = 0
            while asked := run_team(team, chosen, pads, near, progress, cfg, work):
                if asked == CONTACTS:
                    settle(team[0], pads, near, cfg)
                elif sense is not None:
                    sense(team, i, cfg, work)


def reset_seeing(lanes: NDArray[Any], config: NDArray[Any]) -> None:
    """Start every team given, with a filter for the aircraft's own place if that is asked for."""
    from visenvs.envs import _herding_images as images

    images.reset(lanes, config, reset_lanes)


def step_seeing(lanes: NDArray[Any], actions: Row, config: NDArray[Any]) -> None:
    """Advance every team that is running, with a look at rendered pictures."""
    from visenvs.envs import _herding_images as images

    images.step(lanes, actions, config, step_lanes)


TASK = Task(
    id=ENV_ID,
    summary="turn ten ground robots over one line of an arena, in ten minutes",
    scenarios=SCENARIOS,
    lane=LANE,
    observation=OBSERVATION,
    views={"belief": OBSERVATION},
    pictures={"pixels": Frames("visenvs.envs._herding_images:frames", "frame")},
    action=Choices(CHOICES, "allowed", first=1, apiece=PER_ROBOT),
    modes={"velocity": VELOCITY_ACTION},
    team=lambda config: config.aircraft,
    costs=("cost_lost", "cost_remained", "cost_time"),
    metrics={
        "total_cost": "thousand points",
        "goaled": "",
        "removed": "",
        "remained": "",
        "herded": "",
        "touches": "",
        "blocks": "",
        "taps": "",
        "aborts": "",
        "pole_contacts": "",
        "t_success": "s",
    },
    reset_lanes=reset_lanes,
    step_lanes=step_lanes,
    perceptions={"images": (reset_seeing, step_seeing)},
    records={"vio": "visenvs.envs._herding_navigation:NAVIGATING"},
    picture="visenvs.render.herding:draw",
    reference="index",
    episodes=100,
    shown=("goaled", "t_success"),
)
