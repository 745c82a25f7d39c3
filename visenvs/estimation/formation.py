"""Filters of a leader that a camera sees from a follower: one interface, chosen by name.

Every filter keeps its own record inside TRACK and has four kernels, all in N, SI and radians:

    begin(track, own, sight, cfg, work)     from the first image
    predict(track, own, cfg, work)          over one period, with the follower's known motion
    update(track, own, sight, cfg, work)    with one image
    describe(track, own, belief, cfg, work) what it believes, for the row

`own` (OWN) is the follower's perfect navigation: position and velocity at the start of the period
(`predict`) or now (the others), and the mean acceleration in each of the period's inner steps.
`sight` (SIGHT) is one image: the direction of the leader's centre and the angle between its wing
tips. `belief` (BELIEF) is common to all filters. `track` is the filter's part of TRACK.
"""

from __future__ import annotations

import numpy as np

SUBSTEPS = 5  # inner steps of a period

# the order of the codes
ESTIMATORS = ("ekf", "ekf-log", "ekf-natural", "cartesian", "ukf", "truth")

OWN = np.dtype([
    ("r_V_N", "f8", (3,)), ("v_V_N", "f8", (3,)),
    ("push", "f8", (SUBSTEPS, 3)),  # mean acceleration in each inner step, m/s^2
])  # fmt: skip
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
    ("innovation", "f8", (3,)),  # last one: azimuth, elevation, wing-tip angle, rad
    ("nis", "f8"),
])  # fmt: skip
