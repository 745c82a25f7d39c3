"""What the camera of a herding aircraft sees of the arena, and what is made of it.

A picture depends on the records of a team alone, so that it can be drawn anew from any snapshot.
The camera looks along the aircraft's down axis, its long side east and west: straight down, but
for a quadrotor that tilts. A track in sight tells where its robot
is expected, by its covariance, and at which heading; the whole picture is searched where a robot
may be of which that is not known, and now and then in any case (`searches`). What is found feeds
the same bank of tracks as points do; only here, headings are found too.

Obstacles are known as on points. The other aircraft of a team are not drawn.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from visenvs.core.layout import Row
from visenvs.dynamics import quadrotor
from visenvs.dynamics.ground_robot import ACTIVE, CIRCLES, ROBOTS
from visenvs.envs import _herding_navigation as navigation
from visenvs.envs._herding_belief import POLES_SEEN, due, see_obstacles, take_in
from visenvs.envs._herding_config import QUADROTOR, VIO
from visenvs.envs._herding_rules import FAR, POLES
from visenvs.estimation import mmae
from visenvs.estimation.robot_track import NONE, TRACKED
from visenvs.estimation.whereabouts import EAST, GONE, NORTH
from visenvs.sensors.ground_camera import FALSE, HEIGHT, WIDTH
from visenvs.sensors.images.arena import shared_arena
from visenvs.sensors.images.exposure import Exposure, expose
from visenvs.sensors.images.ground_robots import (
    LEAST_DEPTH,
    Expected,
    Finding,
    View,
    cascade,
    others,
    track,
)
from visenvs.sensors.images.optics import Image, Optics, Values
from visenvs.sensors.images.robots import NO_PLATE, ROBOT

PICTURE = POLES_SEEN + 4  # noise stream of the first aircraft's pictures; the others' follow
IMU, ALTIMETER = PICTURE + 4, PICTURE + 8  # and those of what it navigates by
FIRST_FLOOR, FLOORS = 4, 2  # seeds of the floors that episodes take turns with
LENS = Exposure()
NADIR = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])  # C_CB
LOWEST = 0.15  # from which a picture is drawn at least, m
SIGMA, RECALL = 1.0, 0.9  # what the filters are told of findings: noise, pixels, and how often
EVERY = 5  # pictures, one of which is searched as a whole in any case
MOST = ROBOTS + FALSE  # findings of a picture


def camera(config: Any) -> Optics:
    """The camera that finds robots."""
    return Optics(int(WIDTH), int(HEIGHT), 0.5 * WIDTH / math.tan(0.5 * float(config["fov"])))


def square(config: Any, side: int) -> Optics:
    """A square picture as wide as the camera's."""
    return Optics(side, side, 0.5 * side / math.tan(0.5 * float(config["fov"])))


def picture(lane: np.void, arena: np.void, optics: Optics) -> Image:
    """What the camera of one aircraft sees, RGB, (height, width, 3); black for absurd records."""
    r_V_N = np.array([*(lane["r_V_N"] - lane["off_N"]), -max(float(lane["height"]), LOWEST)])
    if not np.all(np.abs(r_V_N) < FAR):
        return np.zeros((optics.height, optics.width, 3), np.uint8)
    seed, episode, tick = (int(arena[name]) for name in ("seed", "episode", "tick"))
    floor = shared_arena(FIRST_FLOOR + (seed + episode) % FLOORS, True)
    frame = floor.render(optics, attitude(lane), r_V_N, fleet(arena))
    return expose(frame, LENS, seed, episode, PICTURE + int(lane["agent"]), tick)


def attitude(lane: np.void) -> Values:
    """Attitude C_CN of the camera, (3, 3)."""
    C_BN = np.empty((3, 3))
    quadrotor.attitude(lane["q_V"], C_BN)
    return NADIR @ C_BN


def fleet(arena: np.void) -> NDArray[Any]:
    """Robots and obstacles that are in the arena, as they are drawn."""
    out = np.zeros(CIRCLES, ROBOT)
    out["place"], out["heading"] = arena["r_R_N"], arena["heading"]
    out["plate"][:ROBOTS], out["plate"][ROBOTS:] = np.arange(ROBOTS) % NO_PLATE, NO_PLATE
    out["pole"][ROBOTS:] = POLES
    return out[(arena["fate"] == ACTIVE) & np.all(np.abs(arena["r_R_N"]) < FAR, axis=1)]


def frames(lanes: NDArray[Any], config: NDArray[Any], out: NDArray[np.uint8]) -> None:
    """Write the picture of every aircraft, (n, frame, frame, 3)."""
    optics, size = square(config[0], out.shape[1]), int(config[0]["aircraft"])
    for i in range(len(lanes)):
        out[i] = picture(lanes[i], lanes[i - i % size], optics)


def reset(lanes: NDArray[Any], config: NDArray[Any], begin: Callable[..., None]) -> None:
    """Start every team given; `begin` starts those that know where they are."""
    cfg = config[0]
    if cfg["navigation"] != VIO:
        begin(lanes, config)
        return
    part = navigation.known(lanes)
    begin(part, config)
    navigation.put_back(lanes, part)
    for i in range(len(lanes)):
        stream = IMU + int(lanes["agent"][i])
        navigation.start(lanes[i : i + 1], camera(cfg), NADIR, period(cfg), stream)


def step(
    lanes: NDArray[Any], actions: Row, config: NDArray[Any], advance: Callable[..., None]
) -> None:
    """Advance every team that is running; `advance` does so and asks for pictures."""
    told = config.copy()
    told["sigma_pixel"], told["p_detect"] = SIGMA, RECALL
    if config[0]["navigation"] != VIO:
        advance(lanes, actions, told, sense)
        return
    part = navigation.known(lanes)
    advance(part, actions, told, partial(navigate, lanes))
    navigation.put_back(lanes, part)


def period(cfg: Any) -> float:
    """From one sample of the IMU to the next, s."""
    parts = cfg["substeps"] if cfg["dynamics"] == QUADROTOR else navigation.SAMPLES
    return float(cfg["tick"] / parts)


def sense(team: NDArray[Any], _first: int, cfg: Any, work: Any) -> None:
    """Take the pictures of a team that knows where it is, and let the filters use them."""
    for lane in team:
        perceive(lane, team[0], take(lane, team[0], cfg), cfg, work)


def navigate(own: NDArray[Any], team: NDArray[Any], first: int, cfg: Any, work: Any) -> None:
    """A tick of a team that navigates by pictures; its records of `own` are from `first` on."""
    tick, arena = float(cfg["tick"]), team[0]
    parts = int(cfg["substeps"]) if cfg["dynamics"] == QUADROTOR else 0
    for m, lane in enumerate(team):
        record, agent = own[first + m : first + m + 1], int(lane["agent"])
        filter_ = navigation.navigator(record, camera(cfg), NADIR, period(cfg))
        navigation.feel(record, lane, arena, filter_, tick, IMU + agent, parts)
        if due(arena, cfg):
            view = take(lane, arena, cfg)
            navigation.see(lane, arena, filter_, view.grey, ALTIMETER + agent)
            perceive(lane, arena, navigation.believed(view, filter_), cfg, work)


def take(lane: np.void, arena: np.void, cfg: Any) -> View:
    """The picture of one aircraft, and its true pose."""
    optics = camera(cfg)
    r_V_N = np.array([*(lane["r_V_N"] - lane["off_N"]), -lane["height"]])
    return View(picture(lane, arena, optics), optics, attitude(lane), r_V_N)


def perceive(lane: np.void, arena: np.void, view: View, cfg: Any, work: Any) -> None:
    """Let the tracks of one aircraft use its picture."""
    pose = work["camera"]
    pose[0], pose[1:] = (*(lane["r_V_N"] - lane["off_N"]), -lane["height"]), attitude(lane)
    see_obstacles(lane, arena, pose, cfg)
    pose[0], pose[1:] = view.r_V_N, view.C
    count = 0
    if LEAST_DEPTH < view.depth < FAR:
        count = tell(find(view, lane["bank"], cfg), work)
    take_in(lane, count, cfg, work)


def find(view: View, bank: np.void, cfg: Any) -> list[Finding]:
    """The robots of a picture: those expected, and, where it is due, all others."""
    hits = cascade(view) if searches(view, bank) else None
    found: list[Finding] = []
    for j in np.flatnonzero((bank["status"] == TRACKED) & (bank["away"] == 0.0)):
        finding = track(view, expected(bank, int(j), cfg), hits)
        if finding is not None:
            found.append(finding)
    return [*found, *others(hits or (), found)][:MOST]


def expected(bank: np.void, j: int, cfg: Any) -> Expected:
    """Where track j will be at the next picture, by its likelier model."""
    x, P = bank["x"][j].copy(), bank["P"][j].copy()
    mmae.predict(x, P, cfg["camera_every"], cfg)
    model = mmae.SPIN if bank["p_spin"][j] > 0.5 else mmae.STRAIGHT
    (north, east, heading), variance = x[model].tolist(), np.diag(P[model])
    deviation = math.sqrt(0.5 * float(variance[0] + variance[1]))
    return Expected((north, east), deviation, heading, math.sqrt(float(variance[2])))


def searches(view: View, bank: np.void) -> bool:
    """Whether a robot may be in the picture that no track in sight tells of."""
    unknown = (bank["status"] == NONE).any() or (bank["c_filled"] > 0.0).any()
    if unknown or bank["picture"] % EVERY == 0.0:
        return True
    away = (bank["status"] == TRACKED) & (bank["away"] > 0.0)
    guesses = bank["guesses"][away].reshape(-1, GONE + 1)
    r = np.insert(guesses[:, [NORTH, EAST]] - view.r_V_N[:2], 2, view.depth, axis=1)
    shown = view.optics.shows(view.optics.project(view.C, r)[0], -0.5)
    return bool((shown & (guesses[:, GONE] == 0.0)).any())


def tell(found: list[Finding], work: Any) -> int:
    """Write findings for the filters; returns how many there are."""
    for i, finding in enumerate(found):
        work["seen"][i] = finding.place
        work["herd"]["turned"][i] = finding.heading, finding.heading_deviation**2
    return len(found)
