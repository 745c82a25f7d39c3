"""What the camera of a follower sees: its leader and the others of the team, in the open air.

A picture depends on the records of a team alone, so that it can be drawn anew from any snapshot.
The camera is level and looks along the follower's course; aircraft bank as coordinated turns want.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from visenvs.core.outcome import RUNNING
from visenvs.envs._formation_config import WHITE
from visenvs.envs.formation import CAMERA, dark
from visenvs.sensors.formation import NEAREST, NONE, banked
from visenvs.sensors.images.aircraft import draw_aircraft
from visenvs.sensors.images.exposure import Exposure, expose
from visenvs.sensors.images.leader import detect
from visenvs.sensors.images.optics import Image, Optics, Values
from visenvs.sensors.images.outdoor import outdoor_of
from visenvs.sensors.images.prior import Prior, predicted
from visenvs.sensors.images.scenes import attitude

EXPOSURE = CAMERA + 1  # noise stream of the first agent, after all others
LENS = Exposure()
RED_PAINT, WHITE_PAINT = (200.0, 60.0, 50.0), (240.0, 240.0, 240.0)
LOST = 1.0  # so long without an image, the whole picture is searched, s


def camera(config: Any) -> Optics:
    """A picture that shows just the view, with square pixels."""
    wide, high = np.tan(config["view"])
    focal = 0.5 * int(config["picture"]) / wide
    return Optics(int(config["picture"]), max(round(2.0 * focal * high), 8), float(focal))


def picture(team: NDArray[Any], agent: int, config: Any) -> Image:
    """What the camera of one of a team's records sees, RGB, (height, width, 3)."""
    lane, optics = team[agent], camera(config)
    C = attitude(float(lane["heading"]), 0.0, 0.0)
    seed, episode, step = (int(lane[name]) for name in ("seed", "episode", "step"))
    frame = outdoor_of(seed, episode).render(optics, C, lane["r_V_N"])
    paint = WHITE_PAINT if config["paint"] == WHITE else RED_PAINT
    for r, v, a in _others(team, agent):
        body, span = _flying(v, a), float(config["wingspan"])
        draw_aircraft(frame, optics, C, r - lane["r_V_N"], body, paint, span=span)
    return expose(frame, LENS, seed, episode, EXPOSURE + agent, step)


def _others(team: NDArray[Any], agent: int) -> list[tuple[Values, Values, Values]]:
    """Position, velocity and acceleration of all other aircraft, N, far ones first."""
    leader, own = team[0]["leader"], team[agent]["r_V_N"]
    out = [(leader["r_N"], leader["v_N"], leader["a_N"])]
    for k, other in enumerate(team):
        if k != agent and other["outcome"] == RUNNING:
            c, s = math.cos(other["heading"]), math.sin(other["heading"])
            x, y, z = other["a_V_F"]
            a = np.array([c * x - s * y, s * x + c * y, z])
            out.append((other["r_V_N"], other["v_V_N"], a))
    return sorted(out, key=lambda one: -float(np.linalg.norm(one[0] - own)))


def _flying(v: Values, a: Values) -> Values:
    """Attitude C_BN of an aircraft that moves so, (3, 3)."""
    one = np.zeros((), [("v_N", "f8", (3,)), ("a_N", "f8", (3,))])
    one["v_N"], one["a_N"] = v, a
    _, _, bank = banked(one[()])
    speed = math.hypot(v[0], v[1])
    return attitude(math.atan2(v[1], v[0]), math.atan2(v[2], speed), bank)


def look(lanes: NDArray[Any], config: NDArray[Any]) -> None:
    """Take the pictures of all lanes that run, and write what the detector finds of the leaders.

    Args:
        lanes: records of whole teams; `seen` and `sight` are written, but for the first picture,
            where nothing but what is found changes the sight.
        config: configuration record, (1,).
    """
    cfg, count = config[0], int(config[0]["followers"])
    optics = camera(cfg)
    for i in range(len(lanes)):
        lane, first = lanes[i], i - i % count
        if lane["outcome"] != RUNNING or (lane["step"] and dark(lane, cfg)):
            lane["seen"] = lane["seen"] if lane["outcome"] != RUNNING else 0.0
            continue
        C = attitude(float(lane["heading"]), 0.0, 0.0)
        image = picture(lanes[first : first + count], i % count, cfg)
        view = detect(image, optics, expected(lane, C))
        if lane["step"]:
            lane["seen"] = 0.0 if view is None else 1.0
        if view is not None:
            ray = np.array([1.0, *view.centre])
            lane["sight"]["u_N"] = ray / np.linalg.norm(ray) @ C
            lane["sight"]["alpha"] = 0.0 if cfg["wings"] == NONE else view.subtended


def expected(lane: np.void, C: Values) -> Prior | None:
    """Where the filter expects its leader: anywhere once it has lost it; None at first."""
    if lane["step"] == 0:
        return None
    belief = lane["belief"]
    r, half, P = belief["r_LV_N"], 0.5 * float(belief["b"]), belief["C"][:3, :3].copy()
    if lane["age"] > LOST:
        return Prior(
            (0.0, 0.0), (math.inf, math.inf), half / max(float(np.linalg.norm(r)), NEAREST)
        )
    return predicted(C, r, P, half, NEAREST)
