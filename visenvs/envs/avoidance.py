"""Obstacle avoidance: reach a waypoint past obstacles that one camera sees and a filter places.

Thesis chapter 3 and 4.2.4. Every obstacle has a safety sphere that the vehicle must not enter. The
episode ends where the vehicle passes the waypoint's plane across the first axis of N, which points
from the start roughly to the waypoint. Cost, in m^2/s^3, its terms summed over the episode:

- control: 1/2 integral of |a|^2;
- violation: 1/2 s_violation times the square of the deepest intrusion into each sphere, charged as
  it deepens, so that a violation costs as much as a miss of that depth at s_x = s_violation;
- divergence: 1/2 s_divergence times the square of what the closest approach to a sphere that
  blocks the straight line exceeds 1 + margin radii by: flying much wider than needed;
- miss: 1/2 s_x times the squared distance to the waypoint in its plane, or to the waypoint itself
  if the time runs out before;
- time: s_time times the time flown. It is 0 in the papers' cases, where the forward speed is kept;
  in `minimum-time` (future work of the thesis, 5.2.3) the vehicle may accelerate and slow down.

The acceleration charged is the one that was reached, which is the command where `dynamics` is
"point_mass"; a "quadrotor" tilts for it first, and its camera tilts with it.

A flight goes on inside a sphere; it ends as a collision if it has been inside by more than `margin`
of the radius.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from visenvs.core.compile import kernel
from visenvs.core.config import to_record
from visenvs.core.lanes import Task, lane_dtype
from visenvs.core.layout import Field, Frames, Layout
from visenvs.core.noise import uniform
from visenvs.core.outcome import RUNNING
from visenvs.dynamics import quadrotor
from visenvs.dynamics.point_mass import move, saturate
from visenvs.envs._avoidance_config import PAST, QUADROTOR, SEEN, TOLD, TRUTH, AvoidanceConfig, K
from visenvs.envs._avoidance_row import CONE_TOO, OBSERVATION, TOLD_TOO, tell
from visenvs.envs._avoidance_scenarios import SCENARIOS
from visenvs.envs._avoidance_score import blocks, longest, score, watch
from visenvs.envs._avoidance_sightings import (
    GOAL,
    PLACE,
    SIGHTINGS,
    look,
    receive,
    relative,
)
from visenvs.envs._obstacles import SPEED, TRACKS, WORK, place, tell_priors, track

ENV_ID = "visenvs/Avoidance-v0"

LANE = lane_dtype(
    [
        ("r_V_N", "f8", (3,)),  # vehicle, known to itself
        ("v_V_N", "f8", (3,)),
        ("a_V_N", "f8", (3,)),  # acceleration that was reached, mean over the step
        ("q_V", "f8", (4,)),  # attitude, quaternion of C_CN with the scalar first
        ("omega_V", "f8", (3,)),  # body rates, rad/s
        ("way_N", "f8", (PAST, 3)),  # where it was, step by step in turns,
        ("way_q", "f8", (PAST, 4)),  # and in which attitude
        ("count", "i8"),  # obstacles of the scene
        ("r_O_N", "f8", (K, 3)),  # obstacles, truth
        ("v_O_N", "f8", (K, 3)),
        ("radius", "f8", (K,)),  # of their safety spheres, known to the vehicle
        ("speed", "f8"),  # along x at the start
        ("blocks", "f8", (K,)),  # 1 where the sphere cuts the straight line to the waypoint
        ("closest", "f8", (K,)),  # least distance from the centre so far, m
        ("t_closest", "f8", (K,)),  # when that was, s
        ("tracks", TRACKS),
        ("x_O", "f8", (K + 1, 6)),  # position and velocity that "ekf-moving" estimates
        ("P_O", "f8", (K + 1, 6, 6)),
        ("t_made", "f8", (K,)),  # when the first tracks began, s
        ("sightings", "f8", (SIGHTINGS, 2)),  # of the last image,
        ("sighted", "f8"),  # and how many
        # of the row: tracks sorted by time to go
        ("rhat_WV_N", "f8", (3,)),
        ("t_go", "f8"),
        ("rhat_OV_N", "f8", (K, 3)),
        ("chol_OV", "f8", (K, 6)),
        ("vhat_O_N", "f8", (K, 3)),
        ("radius_O", "f8", (K,)),
        ("valid_O", "f8", (K,)),
        ("slot_O", "f8", (K,)),
        ("r_OV_N", "f8", (K, 3)),  # the truth that `told` adds
        # what `cones` adds
        ("pass_O_N", "f8", (K, 3)),
        ("t_pass_O", "f8", (K,)),
        ("gap_O", "f8", (K,)),
        ("sigma_gap_O", "f8", (K,)),
        ("aim_O_N", "f8", (K, 3)),
        ("t_aim_O", "f8", (K,)),
        ("cost_control", "f8"),
        ("cost_violation", "f8"),
        ("cost_divergence", "f8"),
        ("cost_miss", "f8"),
        ("cost_time", "f8"),
        ("total_cost", "f8"),
        ("control_cost", "f8"),
        ("miss_distance", "f8"),
        ("flight_time", "f8"),
        ("min_separation", "f8"),
        ("violations", "f8"),
        ("ghosts", "f8"),  # tracks of nothing, or of an obstacle that has one
        ("nees_mean", "f8"),  # over tracks and steps
        ("nees_count", "f8"),
        ("peak_acceleration", "f8"),
    ]
)

ACTION = Layout(
    (
        Field(
            "a_V_N", 3, "a_max", "N", -1.0, 1.0, 1.0, "commanded acceleration over the longest one"
        ),
    )
)


@kernel
def step_lane(lane, action, cfg, work):
    """One step: act and move, sense and estimate, score."""
    fly(lane, action, cfg, work)
    perceive(lane, cfg, work)
    score(lane, cfg, work)


@kernel
def reset_lane(lane, cfg, work):
    """Start an episode from a zeroed record: place the obstacles, tell the filter, look."""
    begin(lane, cfg, work)
    perceive(lane, cfg, work)


@kernel
def perceive(lane, cfg, work):
    """The part of a step between flight and score: sense, estimate, and write the row."""
    believe(lane, cfg, work)
    tell(lane, cfg, work)


@kernel
def begin(lane, cfg, work):
    """The part of a start before the first look: place the obstacles, tell the filter."""
    place(lane, cfg)
    for i in range(3):
        u = uniform(lane["seed"], lane["episode"], PLACE, 0, SPEED + i)
        lane["v_V_N"][i] = cfg["velocity"][i] + (2.0 * u - 1.0) * cfg["velocity_drawn"][i]
    lane["speed"] = lane["v_V_N"][0]
    lane["q_V"][0] = lane["way_q"][0, 0] = 1.0  # level
    for i in range(lane["count"]):
        lane["closest"][i] = math.inf
        lane["blocks"][i] = 1.0 if blocks(lane, i, cfg) else 0.0
    watch(lane, cfg, work["u"])
    if cfg["prior"] == TOLD and cfg["estimator"] != TRUTH:
        quadrotor.attitude(lane["q_V"], work["C"])
        tell_priors(lane, cfg, work)


@kernel
def fly(lane, action, cfg, work):
    """Obey the saturated command for one step; work["moved"] receives the displacement (N, m).

    A quadrotor tilts for it, heading along the first axis: with no command along that axis it
    rolls, and does not pitch.
    """
    command, moved, r = work["u"], work["moved"], lane["r_V_N"]
    free = 1.0 if lane["step"] > round(cfg["pre_run"] / cfg["dt"]) else 0.0
    for i in range(3):
        command[i] = free * cfg["a_max"] * action[i]
    if cfg["lateral"]:
        command[0] = 0.0
    saturate(command, cfg["a_max"], command)
    if cfg["dynamics"] == QUADROTOR:
        for i in range(3):
            moved[i] = -r[i]
        quadrotor.fly(lane, command, 0.0, cfg, work)
        for i in range(3):
            moved[i] += r[i]
    else:
        for i in range(3):
            lane["a_V_N"][i], moved[i] = command[i], 0.0
        move(moved, lane["v_V_N"], command, cfg["dt"])
        for i in range(3):
            r[i] += moved[i]
    now = lane["step"] % PAST
    for i in range(3):
        lane["way_N"][now, i] = r[i]
    for i in range(4):
        lane["way_q"][now, i] = lane["q_V"][i]
    for i in range(lane["count"]):
        for j in range(3):
            lane["r_O_N"][i, j] += cfg["dt"] * lane["v_O_N"][i, j]


@kernel
def believe(lane, cfg, work):
    """Bring the tracks up to date: by the next image, or with perfect information."""
    quadrotor.attitude(lane["q_V"], work["C"])  # of a point mass: level
    if cfg["estimator"] != TRUTH:
        track(lane, cfg, work)
        return
    look(lane, cfg, work)
    T = lane["tracks"]
    for j in range(K + 1):
        known = j < lane["count"] or (j == GOAL and cfg["goal"] == SEEN)
        T["alive"][j], T["owner"][j] = (1.0 if known else 0.0), j
        if known:
            relative(lane, j, cfg, T["r"][j])
        for i in range(3):
            lane["x_O"][j, i + 3] = lane["v_O_N"][j, i] if j < lane["count"] else 0.0


@kernel
def reset_lanes(lanes, config):
    """Start every lane given."""
    work = np.zeros(1, WORK)
    for i in range(lanes.shape[0]):
        reset_lane(lanes[i], config[0], work[0])


@kernel
def step_lanes(lanes, actions, config):
    """Advance every lane that is running."""
    work = np.zeros(1, WORK)
    for i in range(lanes.shape[0]):
        if lanes[i]["outcome"] == RUNNING:
            step_lane(lanes[i], actions[i], config[0], work[0])


@kernel
def begin_lanes(lanes, config):
    """Start every lane given, as far as the first look."""
    work = np.zeros(1, WORK)
    for i in range(lanes.shape[0]):
        begin(lanes[i], config[0], work[0])


@kernel
def fly_lanes(lanes, actions, config, moved):
    """Fly every lane that is running; `moved` receives the displacements (N, m), (n, 3)."""
    work = np.zeros(1, WORK)
    for i in range(lanes.shape[0]):
        if lanes[i]["outcome"] == RUNNING:
            fly(lanes[i], actions[i], config[0], work[0])
            for j in range(3):
                moved[i, j] = work[0]["moved"][j]


@kernel
def take_in(lanes, config, moved, sighted, started):
    """Go on with every lane that is running from what was found in its picture."""
    work = np.zeros(1, WORK)
    for i in range(lanes.shape[0]):
        if lanes[i]["outcome"] == RUNNING:
            receive(sighted[i], work[0])
            for j in range(3):
                work[0]["moved"][j] = moved[i, j]
            perceive(lanes[i], config[0], work[0])
            if started:
                score(lanes[i], config[0], work[0])


def reset_seeing(lanes: Any, config: Any) -> None:
    """Start every lane given, with a look at rendered pictures."""
    from visenvs.envs import _avoidance_images as images

    begin_lanes(lanes, config)
    take_in(lanes, config, np.zeros((len(lanes), 3)), images.look(lanes, config), False)


def step_seeing(lanes: Any, actions: Any, config: Any) -> None:
    """Advance every lane that is running, with a look at rendered pictures."""
    from visenvs.envs import _avoidance_images as images

    moved = np.zeros((len(lanes), 3))
    fly_lanes(lanes, actions, config, moved)
    take_in(lanes, config, moved, images.look(lanes, config), True)


def max_steps(config: AvoidanceConfig) -> int:
    """Only a vehicle that may slow down is ever cut off."""
    return int(longest(to_record(config)[0]))


TASK = Task(
    id=ENV_ID,
    summary="reach a waypoint past obstacles that one camera sees and a filter places",
    scenarios=SCENARIOS,
    lane=LANE,
    observation=OBSERVATION,
    views={"belief": OBSERVATION, "told": TOLD_TOO, "cones": CONE_TOO},
    pictures={"pixels": Frames("visenvs.envs._avoidance_images:frames", "frame", 2)},
    action=ACTION,
    costs=("cost_control", "cost_violation", "cost_divergence", "cost_miss", "cost_time"),
    metrics={
        "total_cost": "m^2/s^3",
        "control_cost": "m^2/s^3",
        "miss_distance": "m",
        "flight_time": "s",
        "min_separation": "",
        "violations": "",
        "ghosts": "",
        "nees_mean": "",
        "peak_acceleration": "m/s^2",
    },
    reset_lanes=reset_lanes,
    step_lanes=step_lanes,
    perceptions={"images": (reset_seeing, step_seeing)},
    max_steps=max_steps,
    picture="visenvs.render.avoidance:draw",
    reference="cone-pn",
    shown=("violations", "min_separation"),
)
