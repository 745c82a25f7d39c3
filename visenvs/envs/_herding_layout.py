"""Lane record, observation rows and choices of the herding task."""

from __future__ import annotations

import numpy as np

from visenvs.core.lanes import lane_dtype
from visenvs.core.layout import Field, Layout
from visenvs.dynamics import ground_robot
from visenvs.dynamics.ground_robot import OBSTACLES, ROBOTS
from visenvs.envs import _herding_flight, _herding_landing
from visenvs.estimation.herd import bank_dtype, work_dtype
from visenvs.guidance.choices import CHOICES
from visenvs.guidance.interception import POSE
from visenvs.sensors.ground_camera import FALSE

N = len(CHOICES)
OTHERS = 3  # aircraft at most, beside one's own

LANE = lane_dtype([
    *ground_robot.COLUMNS,
    # aircraft, known to itself
    ("r_V_N", "f8", (2,)), ("v_V_N", "f8", (2,)), ("height", "f8"),
    ("off_N", "f8", (2,)),  # how far the place known to itself is off the true one, m
    ("stage", "f8"), ("stage_t", "f8"),  # CRUISE, DESCENT, GROUND or CLIMB, and since when, s
    ("service", "i8"), ("target", "i8"), ("delay", "f8"),  # what it is up to, s
    ("landed", "i8"),  # 1 + the robot that its last service met, or 0
    ("miss_N", "f8", (2,)),  # how far from its aim it comes down, m
    ("a_V_N", "f8", (2,)), ("aim_N", "f8", (2,)),
    *_herding_flight.KEPT, *_herding_landing.KEPT,
    ("command", "f8", (2,)), ("down", "f8"),  # velocity set-point, m/s; 1 to come down
    ("at_pole", "i8"), ("agent", "i8"),
    # belief
    ("bank", bank_dtype(ROBOTS)),
    ("noted", "i8"), ("touched_top", "i8"),  # a touch has been told to the filters; it was a tap
    ("track_r_N", "f8", (2 * ROBOTS,)),
    ("track_sin", "f8", (ROBOTS,)), ("track_cos", "f8", (ROBOTS,)),
    ("track_p_spin", "f8", (ROBOTS,)), ("track_phase", "f8", (ROBOTS,)),
    ("track_sd_r", "f8", (ROBOTS,)), ("track_sd_heading", "f8", (ROBOTS,)),
    ("track_sd_phase", "f8", (ROBOTS,)),
    ("track_age", "f8", (ROBOTS,)), ("track_status", "f8", (ROBOTS,)),
    ("t_contact", "f8", (ROBOTS,)),
    ("obstacle_r_N", "f8", (2 * OBSTACLES,)), ("obstacle_age", "f8", (OBSTACLES,)),
    ("others_N", "f8", (4 * OTHERS,)), ("others_first", "f8", (OTHERS,)),
    ("t_go", "f8"),
    ("allowed", "f8", (N,)),
    # score
    ("cost_lost", "f8"), ("cost_remained", "f8"), ("cost_time", "f8"),
    ("total_cost", "f8"),
    ("goaled", "f8"), ("removed", "f8"), ("remained", "f8"), ("touches", "f8"),
    ("blocks", "f8"), ("taps", "f8"), ("aborts", "f8"), ("pole_contacts", "f8"),
    ("herded", "f8"),  # of the goaled, those that were touched
    ("t_success", "f8"),  # when the last robot that success needs was goaled, s; t_f if never
])  # fmt: skip

TRACKS = (
    Field("track_r_N", 2 * ROBOTS, "m", "N", -20.0, 20.0, 10.0,
          "estimated places of the robots, north is the goal line", each=ROBOTS),
    Field("track_sin", ROBOTS, "", "N", -1.0, 1.0, 1.0, "sine of the headings", each=ROBOTS),
    Field("track_cos", ROBOTS, "", "N", -1.0, 1.0, 1.0, "and their cosine", each=ROBOTS),
    Field("track_p_spin", ROBOTS, "", "", 0.0, 1.0, 1.0,
          "probability that the robot turns in place", each=ROBOTS),
    Field("track_phase", ROBOTS, "s", "", 0.0, 60.0, 20.0,
          "time since the last reversal by the clock", each=ROBOTS),
    Field("track_sd_r", ROBOTS, "m", "", 0.0, 20.0, 2.0,
          "standard deviation of the place, each axis", each=ROBOTS),
    Field("track_sd_heading", ROBOTS, "rad", "", 0.0, 4.0, 1.0, "and of the heading", each=ROBOTS),
    Field("track_sd_phase", ROBOTS, "s", "", 0.0, 20.0, 5.0, "and of the phase", each=ROBOTS),
    Field("track_age", ROBOTS, "s", "", 0.0, 60.0, 10.0, "time since last seen", each=ROBOTS),
    Field("track_status", ROBOTS, "", "", 0.0, 2.0, 1.0,
          "0 no track, 1 tracked, 2 out of the arena", each=ROBOTS),
    Field("t_contact", ROBOTS, "s", "", 0.0, 60.0, 10.0,
          "time to the earliest bump against the landed aircraft", each=ROBOTS),
)  # fmt: skip
AIRCRAFT = (
    Field("r_V_N", 2, "m", "N", -20.0, 20.0, 10.0, "own place"),
    Field("aim_N", 2, "m", "N", -20.0, 20.0, 10.0, "where it is bound"),
    Field("v_V_N", 2, "m/s", "N", -5.0, 5.0, 2.0, "own velocity"),
    Field("height", 1, "m", "", 0.0, 10.0, 3.0, "own height"),
    Field("stage", 1, "", "", 0.0, 3.0, 1.0, "0 cruise, 1 descent, 2 on the ground, 3 climb"),
    Field("obstacle_r_N", 2 * OBSTACLES, "m", "N", -20.0, 20.0, 10.0,
          "where the obstacles were last seen"),
    Field("obstacle_age", OBSTACLES, "s", "", 0.0, 60.0, 10.0, "and how long ago"),
    Field("t_go", 1, "s", "", 0.0, 2000.0, 300.0, "time left"),
)  # fmt: skip
OBSERVATION = Layout((
    *TRACKS, *AIRCRAFT,
    Field("others_N", 4 * OTHERS, "m", "N", -20.0, 20.0, 10.0,
          "places of the other aircraft, each followed by where it is bound"),
    Field("others_first", OTHERS, "", "", 0.0, 1.0, 1.0,
          "1 for each of them whose business goes before one's own"),
    Field("allowed", N, "", "", 0.0, 1.0, 1.0, "1 where the choice may be taken"),
))  # fmt: skip
VELOCITY_ACTION = Layout((
    Field("v_command_N", 2, "v_max", "N", -1.0, 1.0, 1.0, "velocity set-point over the largest"),
    Field("descend", 1, "", "", -1.0, 1.0, 1.0, "above 0: come down, or stay down; else climb"),
))  # fmt: skip

WORK = np.dtype([
    ("pose", "f8", (POSE,)), ("aim", "f8", (2,)),
    ("camera", "f8", (4, 3)), ("C_BN", "f8", (3, 3)), ("active", "f8", (ROBOTS,)),
    ("seen", "f8", (ROBOTS + FALSE, 2)), ("labels", "f8", (ROBOTS + FALSE,)),
    ("herd", work_dtype(ROBOTS)), ("plan", _herding_landing.WORK),
    ("flight", _herding_flight.WORK),
])  # fmt: skip
