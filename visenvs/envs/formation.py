"""Formation flight: keep a place behind a leader that one camera sees, alone or as a team.

The follower measures the direction of its leader's centre and the angle between the wing tips, ten
times a second, and a filter in the loop makes position, velocity and acceleration of it (thesis
2.3, UKF paper, tracking paper). In a team each vehicle follows the leader or another follower.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from visenvs.core.compile import kernel
from visenvs.core.frames import wrap_angle
from visenvs.core.lanes import Task, lane_dtype
from visenvs.core.outcome import RUNNING
from visenvs.dynamics.follower import fly, limit
from visenvs.dynamics.leader import PLAN, lead, turn_rate, wander
from visenvs.envs._formation_config import INERTIAL, SCENARIOS, FormationConfig
from visenvs.envs._formation_layout import ACTION, OBSERVATION
from visenvs.envs._formation_score import off_place, point, score, turn_into
from visenvs.envs._formation_start import parent_of, plan_leader, plan_offsets, take_place, tell
from visenvs.estimation import formation as filters
from visenvs.estimation.formation import SUBSTEPS
from visenvs.sensors.formation import in_view, linked, take_sight

ENV_ID = "visenvs/Formation-v0"

LEADER, CAMERA = 2, 3  # noise streams, beside those of the start

LANE = lane_dtype([
    ("agent", "i8"), ("leader", filters.LEADER), ("plan", PLAN),  # truth
    ("first_course", "f8"), ("blackout", "f8", (2,)),
    ("offsets", "f8", (4, 3)), ("offset_times", "f8", (3,)),
    ("r_V_N", "f8", (3,)), ("v_V_N", "f8", (3,)), ("heading", "f8"),  # known to itself
    ("push", "f8", (SUBSTEPS, 3)),  # mean acceleration in each inner step, N
    ("size_told", "f8"), ("range_told", "f8"),
    ("link", "f8"),  # 1 where the image processor holds on
    ("gone", "f8"),  # 1 where the follower that it follows has ended
    ("sight", filters.SIGHT), ("track", filters.TRACK), ("belief", filters.BELIEF),
    ("rhat_LV_F", "f8", (3,)), ("vhat_LV_F", "f8", (3,)), ("ahat_L_F", "f8", (3,)),
    ("sd_r_F", "f8", (3,)), ("sd_v_F", "f8", (3,)), ("sd_log_range", "f8"),
    ("bhat", "f8"), ("sd_b", "f8"),
    ("v_V_F", "f8", (3,)), ("a_V_F", "f8", (3,)), ("turn_rate", "f8"),
    ("offset_F", "f8", (3,)), ("offset_rate", "f8"),
    ("innovation", "f8", (3,)), ("seen", "f8"), ("age", "f8"), ("t_go", "f8"),
    ("cost_tracking", "f8"), ("cost_control", "f8"), ("cost_lost", "f8"), ("cost_collision", "f8"),
    ("total_cost", "f8"), ("control_cost", "f8"),
    ("tracking_error", "f8", (3,)), ("tracking_square", "f8"), ("tracking_rms", "f8"),
    # of the estimate in F, since `score_from`: how many, mean error and mean square of each axis
    ("scored", "f8"), ("bias_r", "f8", (3,)), ("square_r", "f8", (3,)), ("square_v", "f8", (3,)),
    ("position_rms", "f8"), ("nees", "f8"), ("nees_mean", "f8"), ("a_lat_mean", "f8"),
    ("separation", "f8"), ("min_separation", "f8"), ("seen_share", "f8"), ("t_kept", "f8"),
])  # fmt: skip

WORK = np.dtype([
    ("filter", filters.SCRATCH), ("command", "f8", (3,)), ("moved", "f8", (3,)), ("r", "f8", (3,)),
    ("e", "f8", (6,)), ("factor", "f8", (21,)), ("mean", "f8", (3,)),
])  # fmt: skip


@kernel
def step_team(lanes, actions, first, count, cfg, work):
    """One step of a team: all fly, then each looks and takes in what it saw."""
    fly_team(lanes, actions, first, count, cfg, work)
    for k in range(first, first + count):
        if lanes[k]["outcome"] == RUNNING:
            look(lanes[k], cfg, work["r"])
            take_in(lanes[k], cfg, work)


@kernel
def fly_team(lanes, actions, first, count, cfg, work):
    """All move, then all see where the others are now, and predict where their leader is."""
    for k in range(first, first + count):
        if lanes[k]["outcome"] == RUNNING:
            move(lanes[k], actions[k], cfg, work)
    for k in range(first, first + count):
        if lanes[k]["outcome"] == RUNNING:
            meet(lanes, first, count, k, cfg, work["r"])
            filters.predict(lanes[k]["track"], lanes[k], cfg, work["filter"])


@kernel
def reset_team(lanes, first, count, cfg, work):
    """Start an episode from zeroed records: place leader and followers, take a first image."""
    place_team(lanes, first, count, cfg, work["r"])
    for k in range(first, first + count):
        begin(lanes[k], cfg, work)


@kernel
def place_team(lanes, first, count, cfg, r):
    """Place leader and followers, and measure a first time."""
    for k in range(first, first + count):
        lane = lanes[k]
        lane["agent"] = k - first
        plan_leader(lane, cfg)
        plan_offsets(lane, cfg)
        parent, v = parent_of(k - first, cfg), lane["leader"]["v_N"]
        course, rate = lane["first_course"], turn_rate(lane["plan"], 0.0, math.hypot(v[0], v[1]))
        if parent >= 0:
            copy_leader(lane, lanes[first + parent], cfg)
            course, rate = lanes[first + parent]["heading"], lanes[first + parent]["turn_rate"]
        take_place(lane, course, rate, cfg)
        tell(lane, cfg)
        lane["t_go"], lane["link"], lane["seen"] = cfg["t_f"], 1.0, 1.0
        lane["separation"] = lane["min_separation"] = math.inf
        point(lane, r)
        measure(lane, cfg, r)


@kernel
def begin(lane, cfg, work):
    """Start the filter from the first sight."""
    filters.begin(lane["track"], lane, lane["sight"], cfg, work["filter"])
    write_row(lane, cfg, work)
    off_place(lane, work)


@kernel
def move(lane, action, cfg, work):
    """Obey the command for one period; the leader of a first follower flies on, too."""
    dt, command = cfg["dt"] / SUBSTEPS, work["command"]
    before, step = lane["heading"], SUBSTEPS * (lane["step"] - 1)
    limit(action, cfg, command)
    for i in range(SUBSTEPS):
        fly(lane, command, dt, cfg["lag"], lane["push"][i])
        rate = wrap_angle(lane["heading"] - before) / dt
        before = lane["heading"]
        lane["turn_rate"] += (rate - lane["turn_rate"]) * dt / (cfg["turn_smoothing"] + dt)
        # a follower that is followed is taken to fly straight on once it has ended
        leader, plan = lane["leader"], lane["plan"]
        v = leader["v_N"]
        wander(plan, v, dt, cfg, lane["seed"], lane["episode"], LEADER, step + i)
        lead(leader, plan, (step + i) * dt, dt, work["moved"])


@kernel
def meet(lanes, first, count, k, cfg, r):
    """Copy what a follower follows, and how near the nearest other vehicle is."""
    lane = lanes[k]
    parent = parent_of(k - first, cfg)
    if parent >= 0:
        other = lanes[first + parent]
        # numbers that are not finite any more are found out at the end of the step
        lane["gone"] = 1.0
        if other["outcome"] == RUNNING and math.isfinite(other["r_V_N"][0] + other["v_V_N"][0]):
            lane["gone"] = 0.0
            copy_leader(lane, other, cfg)
    point(lane, r)
    nearest = math.sqrt(r[0] * r[0] + r[1] * r[1] + r[2] * r[2])
    for j in range(first, first + count):
        if j != k and lanes[j]["outcome"] == RUNNING:
            square = 0.0
            for i in range(3):
                square += (lanes[j]["r_V_N"][i] - lane["r_V_N"][i]) ** 2
            nearest = min(nearest, math.sqrt(square))
    lane["separation"] = nearest
    lane["min_separation"] = min(lane["min_separation"], nearest)


@kernel
def copy_leader(lane, other, cfg):
    """Take another follower as the leader."""
    leader, a = lane["leader"], other["a_V_F"]
    c, s = math.cos(other["heading"]), math.sin(other["heading"])
    for i in range(3):
        leader["r_N"][i], leader["v_N"][i] = other["r_V_N"][i], other["v_V_N"][i]
    leader["a_N"][0], leader["a_N"][1] = c * a[0] - s * a[1], s * a[0] + c * a[1]
    leader["a_N"][2], leader["wingspan"] = a[2], cfg["wingspan"]
    lane["plan"]["profile"] = 0


@kernel
def look(lane, cfg, r):
    """Take an image, if there is one, and measure the leader in it."""
    seed, episode, step = lane["seed"], lane["episode"], lane["step"]
    lane["link"] = linked(lane["link"], cfg, seed, episode, CAMERA, step, lane["agent"])
    point(lane, r)
    seen = lane["link"] > 0.0 and in_view(r, lane["heading"], cfg) and not dark(lane, cfg)
    lane["seen"] = 1.0 if seen else 0.0
    if seen:
        measure(lane, cfg, r)


@kernel
def dark(lane, cfg):
    """Whether the camera has no image now, or no leader to look at."""
    since = lane["step"] * cfg["dt"] - lane["blackout"][0]
    return lane["gone"] > 0.0 or 0.0 <= since < lane["blackout"][1]


@kernel
def take_in(lane, cfg, work):
    """Give the filter what was seen, and score."""
    lane["age"] = 0.0 if lane["seen"] > 0.0 else lane["age"] + cfg["dt"]
    for i in range(3):
        lane["belief"]["innovation"][i] = 0.0
    if lane["seen"] > 0.0:
        filters.update(lane["track"], lane, lane["sight"], lane["belief"], cfg, work["filter"])
    write_row(lane, cfg, work)
    score(lane, cfg, work)


@kernel
def measure(lane, cfg, r):
    """Measure the leader at r (N, m)."""
    seed, episode, step, agent = lane["seed"], lane["episode"], lane["step"], lane["agent"]
    take_sight(
        r, lane["heading"], lane["leader"], cfg, seed, episode, CAMERA, step, agent, lane["sight"]
    )


@kernel
def write_row(lane, cfg, work):
    """Write belief, own motion and command in F."""
    belief, leader, C = lane["belief"], lane["leader"], lane["belief"]["C"]
    filters.describe(lane["track"], lane, leader, belief, cfg, work["filter"])
    c, s = math.cos(lane["heading"]), math.sin(lane["heading"])
    told = lane["step"] * cfg["dt"] - cfg["vision"][0]
    blend = cfg["vision"][1] - cfg["vision"][0]
    vision = 1.0 if blend == 0.0 else min(max(told / blend, 0.0), 1.0)
    r, v, a = belief["r_LV_N"], belief["v_LV_N"], belief["a_L_N"]
    if vision < 1.0:
        for i in range(3):
            r[i] += (1.0 - vision) * (leader["r_N"][i] - lane["r_V_N"][i] - r[i])
            v[i] += (1.0 - vision) * (leader["v_N"][i] - lane["v_V_N"][i] - v[i])
            a[i] += (1.0 - vision) * (leader["a_N"][i] - a[i])
    turn_into(c, s, r, lane["rhat_LV_F"])
    turn_into(c, s, v, lane["vhat_LV_F"])
    turn_into(c, s, a, lane["ahat_L_F"])
    turn_into(c, s, lane["v_V_N"], lane["v_V_F"])
    spread_into(c, s, C, 0, lane["sd_r_F"])
    spread_into(c, s, C, 3, lane["sd_v_F"])
    lane["sd_log_range"], lane["bhat"] = belief["sd_log_range"], belief["b"]
    lane["sd_b"] = belief["sd_b"]
    for i in range(3):
        lane["innovation"][i] = belief["innovation"][i]
    command_offset(lane, c, s, cfg)


@kernel
def command_offset(lane, c, s, cfg):
    """Write the commanded offset of this time in F."""
    k, t = 0, lane["step"] * cfg["dt"]
    for j in range(3):
        if t >= lane["offset_times"][j] - 1e-9:
            k = j + 1
    for i in range(3):
        lane["offset_F"][i] = lane["offsets"][k, i]
    lane["offset_rate"] = lane["turn_rate"]
    if cfg["offset_frame"] == INERTIAL:
        lane["offset_rate"] = 0.0
        off = lane["first_course"] - lane["heading"]
        x, y = lane["offsets"][k, 0], lane["offsets"][k, 1]
        lane["offset_F"][0] = math.cos(off) * x - math.sin(off) * y
        lane["offset_F"][1] = math.sin(off) * x + math.cos(off) * y


@kernel
def spread_into(c, s, C, k, out):
    """Write the standard deviations in F of the three from place k on of a covariance in N."""
    xx, xy, yy = C[k, k], C[k, k + 1], C[k + 1, k + 1]
    out[0] = math.sqrt(max(c * c * xx + 2.0 * c * s * xy + s * s * yy, 0.0))
    out[1] = math.sqrt(max(s * s * xx - 2.0 * c * s * xy + c * c * yy, 0.0))
    out[2] = math.sqrt(max(C[k + 2, k + 2], 0.0))


@kernel
def reset_lanes(lanes, config):
    """Start every team given."""
    work, team = np.zeros(1, WORK), config[0]["followers"]
    for i in range(0, lanes.shape[0], team):
        reset_team(lanes, i, team, config[0], work[0])


@kernel
def step_lanes(lanes, actions, config):
    """Advance every lane that is running."""
    work, team = np.zeros(1, WORK), config[0]["followers"]
    for i in range(0, lanes.shape[0], team):
        step_team(lanes, actions, i, team, config[0], work[0])


@kernel
def place_lanes(lanes, config):
    """Start every team given, as far as the first picture."""
    work, team = np.zeros(1, WORK), config[0]["followers"]
    for i in range(0, lanes.shape[0], team):
        place_team(lanes, i, team, config[0], work[0]["r"])


@kernel
def begin_lanes(lanes, config):
    """Go on from the first picture of every lane given."""
    work = np.zeros(1, WORK)
    for i in range(lanes.shape[0]):
        begin(lanes[i], config[0], work[0])


@kernel
def fly_lanes(lanes, actions, config):
    """Advance every lane that is running as far as its picture, and describe the prediction."""
    work, team = np.zeros(1, WORK), config[0]["followers"]
    for i in range(0, lanes.shape[0], team):
        fly_team(lanes, actions, i, team, config[0], work[0])
    for i in range(lanes.shape[0]):
        lane, cfg, w = lanes[i], config[0], work[0]["filter"]
        if lane["outcome"] == RUNNING:
            filters.describe(lane["track"], lane, lane["leader"], lane["belief"], cfg, w)


@kernel
def take_in_lanes(lanes, config):
    """Go on from its picture with every lane that is running."""
    work = np.zeros(1, WORK)
    for i in range(lanes.shape[0]):
        if lanes[i]["outcome"] == RUNNING:
            take_in(lanes[i], config[0], work[0])


def reset_seeing(lanes: Any, config: Any) -> None:
    """Start every team given, with a look at rendered pictures."""
    from visenvs.envs import _formation_images as images

    place_lanes(lanes, config)
    images.look(lanes, config)
    begin_lanes(lanes, config)


def step_seeing(lanes: Any, actions: Any, config: Any) -> None:
    """Advance every lane that is running, with a look at rendered pictures."""
    from visenvs.envs import _formation_images as images

    fly_lanes(lanes, actions, config)
    images.look(lanes, config)
    take_in_lanes(lanes, config)


def team_of(config: FormationConfig) -> int:
    """How many lanes fly together."""
    return config.followers


TASK = Task(
    id=ENV_ID,
    summary="keep a place behind a leader that one camera sees",
    scenarios=SCENARIOS,
    lane=LANE,
    observation=OBSERVATION,
    action=ACTION,
    costs=("cost_tracking", "cost_control", "cost_lost", "cost_collision"),
    metrics={
        "total_cost": "m^2/s^3",
        "control_cost": "m^2/s^3",
        "tracking_rms": "m",
        "position_rms": "m",
        "nees_mean": "",
        "seen_share": "",
        "min_separation": "m",
        "t_kept": "s",
    },
    reset_lanes=reset_lanes,
    step_lanes=step_lanes,
    perceptions={"images": (reset_seeing, step_seeing)},
    team=team_of,
    picture="visenvs.render.formation:draw",
    reference="follow",
    shown=("tracking_rms", "t_kept"),
)
