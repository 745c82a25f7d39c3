"""Mapping: fly, and point the camera, so that a map of straight edges becomes whole and exact.

Thesis 2.4. An aircraft at constant altitude sees line segments and estimates the edges that they
are of. What is scored is the map, all the time, against the true edges; so much for

- error: the mean distance of the edges from their lines, at most `error_scale`, over that;
- uncertainty: the mean deviation that the filter states of these lines, likewise;
- uncovered: the share of the area that no image has shown;
- effort: (acceleration / a_max)^2,

each weighted, as a time mean over the episode. An edge without a line counts in full.
"""

from __future__ import annotations

import math

import numpy as np

from visenvs.core.compile import kernel
from visenvs.core.lanes import Task, lane_dtype
from visenvs.core.layout import Field, Layout
from visenvs.core.noise import uniform_pair
from visenvs.core.outcome import MISS, RUNNING, SUCCESS
from visenvs.dynamics.point_mass import move, saturate
from visenvs.envs._mapping_config import (
    EDGES,
    SCENARIOS,
    SEGMENTS,
    SIDE,
    SLOTS,
    SOLIDS,
    TOKENS,
)
from visenvs.envs._mapping_map import SCENE, WORK, compare, describe, look
from visenvs.envs._mapping_world import build
from visenvs.estimation.line_map import map_dtype
from visenvs.sensors.segments import scene_columns

ENV_ID = "visenvs/Mapping-v0"

START = 1_000_000  # which draw of the scene's stream the start is

LANE = lane_dtype(
    [
        ("r_V_N", "f8", (3,)),  # aircraft, known to itself
        ("v_V_N", "f8", (2,)),
        ("a_V_N", "f8", (2,)),  # applied acceleration
        ("tilt", "f8", (2,)),  # where the camera looks: north and east per unit down
        ("C", "f8", (3, 3)),  # its attitude C_CN
        *scene_columns(EDGES, SOLIDS),  # truth
        ("map", map_dtype(SLOTS)),
        ("segment", "f8", (SEGMENTS, 4)),  # of the last image,
        ("cut", "f8", (SEGMENTS, 2)),
        ("seen", "f8"),  # and how many
        # of the row
        ("t_go", "f8"),
        ("lines", "f8"),
        ("covered", "f8", (SIDE * SIDE,)),
        ("rhat_1_N", "f8", (TOKENS, 3)),
        ("rhat_2_N", "f8", (TOKENS, 3)),
        ("worst_N", "f8", (TOKENS, 3)),
        ("age", "f8", (TOKENS,)),
        ("in_view", "f8", (TOKENS,)),
        ("valid", "f8", (TOKENS,)),
        ("cost_error", "f8"),
        ("cost_uncertainty", "f8"),
        ("cost_uncovered", "f8"),
        ("cost_effort", "f8"),
        ("total_cost", "f8"),
        ("control_cost", "f8"),
        ("map_error", "f8"),  # of error_scale
        ("map_deviation", "f8"),
        ("miss_distance", "f8"),
        ("coverage", "f8"),
        ("map_lines", "f8"),
        ("phantoms", "f8"),  # lines of no edge at the end
    ]
)

OBSERVATION = Layout(
    (
        Field("r_V_N", 3, "m", "N", -1000.0, 1000.0, 50.0, "own position, from the area's middle"),
        Field("v_V_N", 2, "m/s", "N", -100.0, 100.0, 10.0, "own velocity"),
        Field("tilt", 2, "", "N", -6.0, 6.0, 1.0, "where the camera looks, per unit down"),
        Field("t_go", 1, "s", "", 0.0, 1000.0, 60.0, "time to go"),
        Field("lines", 1, "", "", 0.0, float(SLOTS), 50.0, "lines of the map"),
        Field(
            "covered",
            SIDE * SIDE,
            "",
            "",
            0.0,
            1.0,
            1.0,
            "1 for cells of the area that an image has shown, from the south-west, east first",
        ),
        Field(
            "rhat_1_N",
            3 * TOKENS,
            "m",
            "N",
            -500.0,
            500.0,
            50.0,
            f"one end of the {TOKENS} lines with the largest deviations, relative to the aircraft",
            each=TOKENS,
        ),
        Field("rhat_2_N", 3 * TOKENS, "m", "N", -500.0, 500.0, 50.0, "their other end", TOKENS),
        Field(
            "worst_N",
            3 * TOKENS,
            "m",
            "N",
            -100.0,
            100.0,
            5.0,
            "their largest deviation across, as a vector of this length",
            each=TOKENS,
        ),
        Field("age", TOKENS, "s", "", 0.0, 1000.0, 20.0, "since they were seen", TOKENS),
        Field("in_view", TOKENS, "", "", 0.0, 1.0, 1.0, "1 for those in the last picture", TOKENS),
        Field("valid", TOKENS, "", "", 0.0, 1.0, 1.0, "1 where there is a line", TOKENS),
    )
)
ACTION = Layout(
    (
        Field("a_V_N", 2, "a_max", "N", -1.0, 1.0, 1.0, "acceleration over the longest one"),
        Field(
            "tilt",
            2,
            "tilt_max",
            "N",
            -1.0,
            1.0,
            1.0,
            "where to point the camera: tangent of its angle from straight down over the largest",
        ),
    )
)


@kernel
def step_lane(lane, action, cfg, work):
    """One step: act, then fly and look image by image, then score."""
    command(lane, action, cfg)
    for k in range(cfg["images"]):
        fly(lane, cfg["dt"] / cfg["images"], cfg, work["moved"])
        look(lane, (lane["step"] - 1) * cfg["images"] + k, cfg, work)
    tell(lane, cfg, work)
    score(lane, cfg)


@kernel
def reset_lane(lane, cfg, work):
    """Start an episode from a zeroed record: build the scene, place the aircraft, blind."""
    build(lane, cfg, lane["seed"], lane["episode"], SCENE)
    draws = uniform_pair(lane["seed"], lane["episode"], SCENE, 0, START)
    for i in range(2):
        lane["r_V_N"][i] = cfg["start"][i] + (2.0 * draws[i] - 1.0) * cfg["start_drawn"][i]
    lane["r_V_N"][2] = -cfg["altitude"]
    lane["C"][0, 2] = lane["C"][1, 1] = 1.0  # straight down
    lane["C"][2, 0] = -1.0
    tell(lane, cfg, work)


@kernel
def command(lane, action, cfg):
    """Set acceleration and camera by an action row; longer ones keep their direction."""
    widest = math.tan(cfg["tilt_max"])
    for i in range(2):
        lane["a_V_N"][i] = cfg["a_max"] * action[i]
        lane["tilt"][i] = widest * action[i + 2]
    saturate(lane["a_V_N"], cfg["a_max"], lane["a_V_N"])
    saturate(lane["tilt"], widest, lane["tilt"])


@kernel
def fly(lane, dt, cfg, moved):
    """Move for a time (s) under the commanded acceleration, as far as the highest speed allows."""
    v, a = lane["v_V_N"], lane["a_V_N"]
    for i in range(2):
        moved[i] = v[i] + dt * a[i]
    saturate(moved, cfg["v_max"], moved)
    for i in range(2):
        a[i] = (moved[i] - v[i]) / dt
    move(lane["r_V_N"][:2], v, a, dt)


@kernel
def tell(lane, cfg, work):
    """Write the row, and what the map is worth."""
    steps = round(cfg["t_f"] / cfg["dt"])
    lane["t_go"] = (steps - lane["step"]) * cfg["dt"]
    describe(lane, cfg, work)
    compare(lane, cfg, work)
    total = 0.0
    for c in range(SIDE * SIDE):
        total += lane["covered"][c]
    lane["coverage"] = total / (SIDE * SIDE)


@kernel
def score(lane, cfg):
    """Charge the four terms as time means, and end at the terminal time."""
    steps, a = round(cfg["t_f"] / cfg["dt"]), lane["a_V_N"]
    effort = (a[0] * a[0] + a[1] * a[1]) / cfg["a_max"] ** 2
    lane["cost_error"] = cfg["w_error"] * lane["map_error"] / steps
    lane["cost_uncertainty"] = cfg["w_uncertainty"] * lane["map_deviation"] / steps
    lane["cost_uncovered"] = cfg["w_uncovered"] * (1.0 - lane["coverage"]) / steps
    lane["cost_effort"] = cfg["w_effort"] * effort / steps
    lane["control_cost"] += lane["cost_effort"]
    lane["total_cost"] += lane["cost_error"] + lane["cost_uncertainty"]
    lane["total_cost"] += lane["cost_uncovered"] + lane["cost_effort"]
    if lane["step"] >= steps:
        m = lane["map"]
        lane["map_lines"] = lane["lines"]
        for j in range(m["used"]):
            lane["phantoms"] += m["alive"][j] * (1.0 if m["owner"][j] < 0.0 else 0.0)
        lane["miss_distance"] = lane["map_error"] * cfg["error_scale"]
        good = lane["miss_distance"] <= cfg["success_error"]
        lane["outcome"] = SUCCESS if good else MISS


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


TASK = Task(
    id=ENV_ID,
    summary="fly and point a camera so that a map of straight edges becomes whole and exact",
    scenarios=SCENARIOS,
    lane=LANE,
    observation=OBSERVATION,
    action=ACTION,
    costs=("cost_error", "cost_uncertainty", "cost_uncovered", "cost_effort"),
    metrics={
        "total_cost": "",
        "control_cost": "",
        "miss_distance": "m",
        "map_deviation": "",
        "coverage": "",
        "map_lines": "",
        "phantoms": "",
    },
    reset_lanes=reset_lanes,
    step_lanes=step_lanes,
    picture="visenvs.render.mapping:draw",
    reference="information-gain",
    episodes=500,
    shown=("miss_distance", "coverage"),
)
