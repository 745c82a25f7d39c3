"""What an aircraft believes: the truth, or what its camera and its filters make of it."""

from __future__ import annotations

import math

from visenvs.core.compile import kernel
from visenvs.dynamics.ground_robot import ABSENT, ACTIVE, OBSTACLES, ROBOTS, spinning
from visenvs.envs._herding_aircraft import CRUISE, TRACKED
from visenvs.envs._herding_config import BLOCK_ONLY
from visenvs.guidance.choices import LAST, number_of, look_at, DELAYS
from visenvs.guidance.interception import BLOCK, TAP, meet

NONE, FINISHED = 0.0, 2.0  # status of a track


@kernel
def tell_truth(lane, arena):
    """The tracks as they are, without deviation."""
    for k in range(ROBOTS):
        fate = arena["fate"][k]
        if fate == ACTIVE:
            lane["track_status"][k] = TRACKED
        else:
            lane["track_status"][k] = NONE if fate == ABSENT else FINISHED
        for i in range(2):
            lane["track_r_N"][2 * k + i] = arena["r_R_N"][k, i]
        lane["track_sin"][k] = math.sin(arena["heading"][k])
        lane["track_cos"][k] = math.cos(arena["heading"][k])
        lane["track_p_spin"][k] = 1.0 if spinning(arena, k) else 0.0
        lane["track_phase"][k] = arena["t"] - arena["reversal_t"][k]
    for k in range(OBSTACLES):
        for i in range(2):
            lane["obstacle_r_N"][2 * k + i] = arena["r_R_N"][ROBOTS + k, i]


@kernel
def describe(lane, cfg, work):
    """Write what follows from the tracks: times to contact, and which choices there are."""
    free = lane["stage"] == CRUISE
    allowed = lane["allowed"]
    allowed[0] = 1.0 if free else 0.0
    allowed[LAST] = 0.0 if free else 1.0
    for i in range(ROBOTS):
        tracked = lane["track_status"][i] == TRACKED
        lane["t_contact"][i] = 0.0
        if tracked:
            lane["t_contact"][i] = meet(lane, i, BLOCK, 0.0, cfg, work["pose"], work["aim"])
        able = 1.0 if free and tracked else 0.0
        for k in range(len(DELAYS)):
            allowed[number_of(i, BLOCK, k)] = able
            allowed[number_of(i, TAP, k)] = 0.0 if cfg["services"] == BLOCK_ONLY else able
        allowed[look_at(i)] = able
