"""Filters of a leader that a camera sees from a follower: one interface, chosen by name.

Every filter has its own record inside TRACK and scratch inside SCRATCH, and four kernels, in N, SI
and radians:

    begin      from the first image
    predict    over one period `cfg["dt"]`, with the follower's known motion
    update     with one image
    describe   what it believes, for the row

The kernels below hand each of them to the filter that `cfg["estimator"]` names. Their arguments:

    track      TRACK record: the filters' states
    own        record with r_V_N and v_V_N, the follower's position and velocity now; push, its
               mean acceleration in each inner step that led here, (SUBSTEPS, 3); size_told and
               range_told, what it was told of the leader, m
    sight      SIGHT record: one image
    belief     BELIEF record, common to all filters
    leader     LEADER record, the truth, for perfect information only
    cfg        record with dt (s); sigma_image (rad), the noise of every image point; sd_size and
               sd_range, relative uncertainty of what was told; sd_velocity (m/s); sd_lat, sd_up
               (m/s^2) and the process noise q_a (m^2/s^3), q_lat, q_up (m^2/s^5); q_velocity
               (m^2/s^3), q_jerk (m^2/s^5), singer_rate (1/s), adapt_gain (1/s) and adapt_decay
               (s^2/m) of the adaptive filters
    work       SCRATCH record

To add a filter: its name in ESTIMATORS, its records in TRACK and SCRATCH, its line in each kernel.
"""

from __future__ import annotations

import numpy as np

from visenvs.core.compile import kernel
from visenvs.estimation import adaptive, cartesian, polar

SUBSTEPS = 5  # inner steps of a period

# the order of the codes
ESTIMATORS = ("ekf", "ekf-log", "ekf-natural", "cartesian", "ukf", "truth", *adaptive.KINDS)
EKF, EKF_LOG, EKF_NATURAL, CARTESIAN, UKF, TRUTH, ADAPTIVE = range(7)  # and more beyond the last

SIGHT = np.dtype([
    ("u_N", "f8", (3,)),  # measured direction of the leader's centre, a unit vector
    ("alpha", "f8"),  # measured angle between its wing tips, rad; 0 where the camera has none
])  # fmt: skip
BELIEF = np.dtype([
    ("r_LV_N", "f8", (3,)), ("v_LV_N", "f8", (3,)),  # of the leader relative to the follower
    ("a_L_N", "f8", (3,)),  # of the leader itself
    ("C", "f8", (6, 6)),  # covariance of position and velocity
    ("sd_log_range", "f8"),
    ("b", "f8"), ("sd_b", "f8"),  # wingspan, m
    ("innovation", "f8", (3,)),  # last one: right, down, wing-tip angle, rad
    ("nis", "f8"),
])  # fmt: skip
LEADER = np.dtype([
    ("r_N", "f8", (3,)), ("v_N", "f8", (3,)), ("a_N", "f8", (3,)),
    ("wingspan", "f8"),  # m
])  # fmt: skip
TRACK = np.dtype([("polar", polar.TRACK), ("cartesian", cartesian.TRACK),
                  ("adaptive", adaptive.TRACK)])  # fmt: skip
SCRATCH = np.dtype([("polar", polar.SCRATCH), ("cartesian", cartesian.SCRATCH),
                    ("adaptive", adaptive.SCRATCH)])  # fmt: skip


@kernel
def begin(track, own, sight, cfg, work):
    """Start from the first image."""
    kind = cfg["estimator"]
    if kind <= EKF_NATURAL:
        polar.begin(track["polar"], own, sight, kind == EKF_NATURAL, cfg)
    elif kind in (CARTESIAN, UKF):
        cartesian.begin(track["cartesian"], own, sight, cfg, work["cartesian"])
    elif kind >= ADAPTIVE:
        adaptive.begin(track["adaptive"], kind - ADAPTIVE, own, sight, cfg, work["adaptive"])


@kernel
def predict(track, own, cfg, work):
    """Predict over one period."""
    kind = cfg["estimator"]
    if kind <= EKF_NATURAL:
        polar.predict(track["polar"], own, kind == EKF_NATURAL, cfg, work["polar"])
    elif kind == CARTESIAN:
        cartesian.predict_extended(track["cartesian"], own, cfg, work["cartesian"])
    elif kind == UKF:
        cartesian.predict_unscented(track["cartesian"], own, cfg, work["cartesian"])
    elif kind >= ADAPTIVE:
        adaptive.predict(track["adaptive"], kind - ADAPTIVE, cfg)


@kernel
def update(track, own, sight, belief, cfg, work):
    """Use one image; writes the innovation and the NIS."""
    kind = cfg["estimator"]
    if kind <= EKF_NATURAL:
        natural, consider = kind == EKF_NATURAL, kind == EKF
        polar.update(track["polar"], sight, natural, consider, belief, cfg, work["polar"])
    elif kind == CARTESIAN:
        cartesian.update_extended(track["cartesian"], sight, belief, cfg, work["cartesian"])
    elif kind == UKF:
        cartesian.update_unscented(track["cartesian"], sight, belief, cfg, work["cartesian"])
    elif kind >= ADAPTIVE:
        f, w = track["adaptive"], work["adaptive"]
        adaptive.update(f, kind - ADAPTIVE, own, sight, belief, cfg, w)


@kernel
def describe(track, own, leader, belief, cfg, work):
    """Write what is believed: all of BELIEF but the innovation and the NIS."""
    kind = cfg["estimator"]
    if kind == TRUTH:
        reveal(own, leader, belief)
    elif kind <= EKF_NATURAL:
        polar.describe(track["polar"], own, kind == EKF_NATURAL, belief, work["polar"])
    elif kind >= ADAPTIVE:
        adaptive.describe(track["adaptive"], own, belief)
    else:
        cartesian.describe(track["cartesian"], own, belief)


@kernel
def reveal(own, leader, belief):
    """Perfect information: the truth, without uncertainty."""
    for i in range(3):
        belief["r_LV_N"][i] = leader["r_N"][i] - own["r_V_N"][i]
        belief["v_LV_N"][i] = leader["v_N"][i] - own["v_V_N"][i]
        belief["a_L_N"][i] = leader["a_N"][i]
    belief["b"] = leader["wingspan"]
