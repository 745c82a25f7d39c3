"""Formation flight: keep a commanded place relative to a leader that is seen, not told.

F is the follower's heading frame: x forward along its course, y to its right, z down. The relative
position X is that of the leader, the commanded one is the layout's `offset_F`. It stands still in a
frame that turns at `offset_rate`, so that its velocity in space is w x X_c and its acceleration
w x (w x X_c).
"""

from __future__ import annotations

from visenvs.core.compile import kernel
from visenvs.core.registry import Law

# Gains of the position and velocity errors, 1/s^2 and 1/s: critically damped at 0.4 rad/s.
KP, KD = 0.16, 0.8


@kernel
def track_offset(belief, kp, kd, out):
    """Own acceleration in F that keeps the commanded offset, m/s^2, (3,).

    a = a_L - X_c'' + kp (X - X_c) + kd (X' - X_c'), the leader's acceleration fed forward.

    Args:
        belief: record with rhat_LV_F, vhat_LV_F, ahat_L_F, offset_F and offset_rate.
        kp, kd: gains, 1/s^2 and 1/s.
    """
    r, v, a = belief["rhat_LV_F"], belief["vhat_LV_F"], belief["ahat_L_F"]
    c, w = belief["offset_F"], belief["offset_rate"]
    out[0] = a[0] + w * w * c[0] + kp * (r[0] - c[0]) + kd * (v[0] + w * c[1])
    out[1] = a[1] + w * w * c[1] + kp * (r[1] - c[1]) + kd * (v[1] - w * c[0])
    out[2] = a[2] + kp * (r[2] - c[2]) + kd * v[2]


@kernel
def follow(beliefs, settings, commands):
    """Proportional and derivative tracking with the leader's acceleration fed forward."""
    for i in range(beliefs.shape[0]):
        track_offset(beliefs[i], KP, KD, commands[i])


LAWS = (
    Law(
        name="follow",
        summary="PD tracking of the offset, leader acceleration fed forward",
        source="thesis 2.3.3; tracking paper 3.2",
        needs=("rhat_LV_F", "vhat_LV_F", "ahat_L_F", "offset_F", "offset_rate"),
        settings=("a_max",),
        decide=follow,
    ),
)
