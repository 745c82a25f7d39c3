"""Formation flight: keep a commanded place relative to a leader that is seen, not told.

F is the follower's heading frame: x forward along its course, y to its right, z down. The relative
position X is that of the leader, the commanded one is the layout's `offset_F`. It stands still in a
frame that turns at `offset_rate`, so that its velocity in space is w x X_c and its acceleration
w x (w x X_c).

Laws in a chain, each following the one ahead, pass disturbances on: with a constant offset every
hop of PD tracking enlarges slow ones. A headway h asks for more room at more speed, X_c = offset +
h (own speed - the leader's usual one), and stops that where h is long enough.
"""

from __future__ import annotations

import re
from functools import partial

import numpy as np

from visenvs.core.compile import kernel
from visenvs.core.registry import Law

# Gains of the position and velocity errors, 1/s^2 and 1/s: critically damped at 0.4 and at 0.6
# rad/s (the tracking paper's section 5 needs the firmer ones), and at 0.75 for short headways.
GENTLE, FIRM, CLOSE = (0.16, 0.8), (0.36, 1.2), (0.5625, 1.5)
NEEDS = ("rhat_LV_F", "vhat_LV_F", "ahat_L_F", "offset_F", "offset_rate")


@kernel
def track_path(belief, a, kp, kd, c, rate, accel, out):
    """Own acceleration in F that keeps a commanded place, m/s^2, (3,).

    a = a_L - X_c'' + kp (X - X_c) + kd (X' - X_c'), the leader's acceleration fed forward.

    Args:
        belief: record with rhat_LV_F, vhat_LV_F and offset_rate.
        a: the leader's acceleration in F, m/s^2, (3,).
        kp, kd: gains, 1/s^2 and 1/s.
        c, rate, accel: the commanded place of the leader relative to the follower in F, m, and its
            derivatives in the frame that turns at offset_rate, (3,).
    """
    r, v, w = belief["rhat_LV_F"], belief["vhat_LV_F"], belief["offset_rate"]
    out[0] = a[0] - accel[0] + w * (2.0 * rate[1] + w * c[0])
    out[1] = a[1] - accel[1] - w * (2.0 * rate[0] - w * c[1])
    out[2] = a[2] - accel[2] + kp * (r[2] - c[2]) + kd * (v[2] - rate[2])
    out[0] += kp * (r[0] - c[0]) + kd * (v[0] - rate[0] + w * c[1])
    out[1] += kp * (r[1] - c[1]) + kd * (v[1] - rate[1] - w * c[0])


@kernel
def follow(kp, kd, beliefs, settings, commands):
    """Track the offset with the leader's acceleration fed forward."""
    still = np.zeros(3)
    for i in range(beliefs.shape[0]):
        belief = beliefs[i]
        track_path(
            belief, belief["ahat_L_F"], kp, kd, belief["offset_F"], still, still, commands[i]
        )


@kernel
def follow_turning(kp, kd, beliefs, settings, commands):
    """Track the offset as if the leader turned as the follower does: its acceleration is w x V."""
    a, still = np.zeros(3), np.zeros(3)
    for i in range(beliefs.shape[0]):
        belief = beliefs[i]
        w, own, relative = belief["turn_rate"], belief["v_V_F"], belief["vhat_LV_F"]
        a[0], a[1] = -w * (own[1] + relative[1]), w * (own[0] + relative[0])
        track_path(belief, a, kp, kd, belief["offset_F"], still, still, commands[i])


@kernel
def follow_headway(kp, kd, headway, beliefs, settings, commands):
    """Track an offset that grows ahead with the own speed, by `headway` seconds of it.

    Its rate is `headway` times the own acceleration ahead, which the command itself decides on.
    """
    c, still = np.zeros(3), np.zeros(3)
    usual = 0.5 * (settings[0]["speed"][0] + settings[0]["speed"][1])
    for i in range(beliefs.shape[0]):
        belief = beliefs[i]
        for j in range(3):
            c[j] = belief["offset_F"][j]
        c[0] += headway * (belief["v_V_F"][0] - usual)
        track_path(belief, belief["ahat_L_F"], kp, kd, c, still, still, commands[i])
        commands[i, 0] /= 1.0 + kd * headway
        commands[i, 1] -= 2.0 * belief["offset_rate"] * headway * commands[i, 0]


def headway_law(seconds: str) -> Law:
    """The card of `follow-headway-SECONDS`."""
    return Law(
        name=f"follow-headway-{seconds}",
        summary=f"follow, with {seconds} s more room per speed: for chains",
        source="string stability by headway (Swaroop and Hedrick 1999)",
        needs=(*NEEDS, "v_V_F"),
        settings=("a_max", "speed"),
        decide=partial(follow_headway, *CLOSE, float(seconds)),
    )


def member(name: str) -> Law | None:
    """`follow-headway-H` with H seconds of headway, such as 2 or 1.5; None for other names."""
    found = re.fullmatch(r"follow-headway-(\d{1,3}(?:\.\d{1,3})?)", name)
    return None if found is None else headway_law(found[1])


LAWS = (
    Law(
        name="follow",
        summary="PD tracking of the offset, leader acceleration fed forward",
        source="thesis 2.3.3; tracking paper 3.2",
        needs=NEEDS,
        settings=("a_max",),
        decide=partial(follow, *GENTLE),
    ),
    Law(
        name="follow-firm",
        summary="the same with higher gains",
        source="gains for the tracking paper's section 5",
        needs=NEEDS,
        settings=("a_max",),
        decide=partial(follow, *FIRM),
    ),
    Law(
        name="follow-ff",
        summary="follow, taking the leader's acceleration from the own turn rate",
        source="control experiment to the tracking paper's section 5",
        needs=(*NEEDS, "turn_rate", "v_V_F"),
        settings=("a_max",),
        decide=partial(follow_turning, *GENTLE),
    ),
    Law(
        name="follow-firm-ff",
        summary="the same with higher gains",
        source="control experiment to the tracking paper's section 5",
        needs=(*NEEDS, "turn_rate", "v_V_F"),
        settings=("a_max",),
        decide=partial(follow_turning, *FIRM),
    ),
    headway_law("2"),
)
