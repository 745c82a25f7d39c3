"""The rows of formation flight: what a follower reads and commands.

F is the follower's heading frame: x forward along its course, y to its right, z down.
"""

from __future__ import annotations

from visenvs.core.layout import Field, Layout

OBSERVATION = Layout((
    Field("rhat_LV_F", 3, "m", "F", -300.0, 300.0, 20.0,
          "estimated position of the leader relative to the follower"),
    Field("vhat_LV_F", 3, "m/s", "F", -60.0, 60.0, 5.0, "estimated relative velocity, seen from N"),
    Field("ahat_L_F", 3, "m/s^2", "F", -20.0, 20.0, 2.0, "estimated acceleration of the leader"),
    Field("sd_r_F", 3, "m", "F", 0.0, 100.0, 2.0, "standard deviation of the position"),
    Field("sd_v_F", 3, "m/s", "F", 0.0, 30.0, 1.0, "and of the velocity"),
    Field("sd_log_range", 1, "", "", 0.0, 2.0, 0.1,
          "standard deviation of the logarithm of the range"),
    Field("bhat", 1, "m", "", 0.0, 30.0, 5.0, "estimated wingspan of the leader"),
    Field("sd_b", 1, "m", "", 0.0, 10.0, 0.2, "its standard deviation"),
    Field("v_V_F", 3, "m/s", "F", -100.0, 100.0, 25.0, "own velocity"),
    Field("a_V_F", 3, "m/s^2", "F", -20.0, 20.0, 5.0, "own acceleration"),
    Field("turn_rate", 1, "rad/s", "", -1.0, 1.0, 0.1,
          "own turn rate, smoothed, clockwise positive"),
    Field("offset_F", 3, "m", "F", -300.0, 300.0, 20.0,
          "commanded position of the leader relative to the follower"),
    Field("offset_rate", 1, "rad/s", "", -1.0, 1.0, 0.1,
          "rate at which the commanded offset turns in N"),
    Field("innovation", 3, "rad", "", -1.0, 1.0, 0.005,
          "last innovation of azimuth, elevation and wing-tip angle, 0 without an image"),
    Field("seen", 1, "", "", 0.0, 1.0, 1.0, "1 where the last image showed the leader"),
    Field("age", 1, "s", "", 0.0, 10.0, 1.0, "time since an image showed the leader"),
    Field("t_go", 1, "s", "", 0.0, 300.0, 60.0, "time to go"),
))  # fmt: skip
ACTION = Layout((
    Field("a_V_F", 3, "a_max", "F", -1.0, 1.0, 1.0,
          "commanded acceleration over the largest horizontal one; the vertical has its limit"),
))  # fmt: skip
