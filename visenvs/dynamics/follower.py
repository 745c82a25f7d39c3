"""A follower as a point mass in its heading frame F, behind a first-order lag and its limits."""

from __future__ import annotations

import math

from visenvs.core.compile import kernel

LEAST_SPEED = 1.0  # m/s; a slower follower is taken to turn as one at this speed


@kernel
def limit(action, cfg, out):
    """Write a commanded acceleration in F, m/s^2, (3,): horizontal to length, vertical to size.

    Args:
        action: over the largest horizontal one, (3,).
        cfg: record with a_max and a_max_down, m/s^2.
    """
    across = math.sqrt(action[0] * action[0] + action[1] * action[1])
    gain = cfg["a_max"] / max(across, 1.0)
    out[0], out[1] = gain * action[0], gain * action[1]
    down = cfg["a_max"] * action[2]
    out[2] = min(max(down, -cfg["a_max_down"]), cfg["a_max_down"])


@kernel
def fly(lane, command, dt, lag, push):
    """Obey a command in F for one inner step; the lag is integrated exactly, F held at mid-turn.

    Args:
        lane: record with r_V_N, v_V_N, a_V_F (3,), changed in place, and heading, rad, which
            becomes the new course.
        command: m/s^2, (3,).
        dt, lag: s.
        push: receives the mean acceleration over the step in N, (3,).
    """
    r, v, a = lane["r_V_N"], lane["v_V_N"], lane["a_V_F"]
    left = math.exp(-dt / lag)
    mean = lag * (1.0 - left)  # integral of the decay
    twice = lag * (dt - mean)  # and of that integral
    speed = max(math.hypot(v[0], v[1]), LEAST_SPEED)
    middle = lane["heading"] + 0.5 * dt * a[1] / speed
    c, s = math.cos(middle), math.sin(middle)
    forward = dt * command[0] + mean * (a[0] - command[0])
    right = dt * command[1] + mean * (a[1] - command[1])
    down = dt * command[2] + mean * (a[2] - command[2])
    ahead = 0.5 * dt * dt * command[0] + twice * (a[0] - command[0])
    aside = 0.5 * dt * dt * command[1] + twice * (a[1] - command[1])
    r[0] += dt * v[0] + c * ahead - s * aside
    r[1] += dt * v[1] + s * ahead + c * aside
    r[2] += dt * v[2] + 0.5 * dt * dt * command[2] + twice * (a[2] - command[2])
    push[0], push[1], push[2] = c * forward - s * right, s * forward + c * right, down
    for i in range(3):
        v[i] += push[i]
        push[i] /= dt
        a[i] = command[i] + left * (a[i] - command[i])
    lane["heading"] = math.atan2(v[1], v[0])
