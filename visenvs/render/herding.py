"""The picture of herding: the arena from above with robots and tracks, and what the camera sees."""

from __future__ import annotations

import math
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from visenvs.core.lanes import Task
from visenvs.core.outcome import RUNNING, Outcome
from visenvs.dynamics.ground_robot import ACTIVE, ROBOTS
from visenvs.envs._herding_config import HerdingConfig
from visenvs.envs._herding_images import attitude, camera, picture
from visenvs.guidance.choices import GO, HOVER, LOOK
from visenvs.guidance.interception import TAP
from visenvs.render import style
from visenvs.render.canvas import Panel, Points
from visenvs.render.scene import ENDINGS, paper
from visenvs.render.style import Image, write
from visenvs.sensors.ground_camera import HEIGHT, HORIZON, WIDTH, depth, pixel_size

ARENA = (44, 66, 448, 448)  # left, top, width, height of the plot, pixels
CAMERA = (544, 66, 240, 180)
STATUS = (544, 280)
CLOCKS = (812, 84)
MARGIN = 0.6  # around the lines, m
SIGMAS = 2.0  # of the ellipses
VAGUE = 1.5  # deviation from which on an ellipse is not filled, m
HAND = 8  # radius of a clock, pixels
STAGES = ("cruise", "descent", "on the ground", "climb")


def draw(
    record: Any, config: HerdingConfig, task: Task, trail: NDArray[Any] | None = None
) -> Image:
    """Draw one lane record, or those of a team and what its first aircraft believes.

    Args:
        record: lane record of the herding task, or those of a team, shape (n,).
        config: its configuration.
        task: its card.
        trail: earlier records of the episode, shape (steps,) or (steps, n), for the paths flown;
            None for no paths.

    Returns:
        RGB, shape (540, 960, 3).
    """
    team = np.atleast_1d(record)
    record, seen = team[0], "Camera" if len(team) == 1 else "Camera of aircraft 0"
    image = paper("Herding", {"Arena, goal line at the top": ARENA, seen: CAMERA})
    past = () if trail is None else trail.reshape(-1, len(team))
    flown = np.array([*(flight["r_V_N"] for flight in past), team["r_V_N"]])
    with np.errstate(invalid="ignore", over="ignore"):  # the last record of a diverged lane
        draw_arena(image, team, config, flown)
        draw_camera(image, record, config)
        draw_clocks(image, record, config)
        draw_status(image, record, config)
    return image


def above(points: Any) -> Points:
    """Places (north, east) as (right, up)."""
    return np.asarray(points, float).reshape(-1, 2)[:, ::-1]


def ahead(heading: float) -> Points:
    """Unit vector of a heading as (right, up)."""
    return np.array([math.sin(heading), math.cos(heading)])


def tracks(record: np.void) -> list[tuple[int, Points, Points, float]]:
    """Number, place and direction (right, up), and deviation (m) of what is tracked."""
    places = above(record["track_r_N"])
    way = np.stack([record["track_sin"], record["track_cos"]], axis=1)
    return [
        (int(i), places[i], way[i], float(record["track_sd_r"][i]))
        for i in np.flatnonzero(record["track_status"] == 1.0)
    ]


def pose_of(record: np.void) -> NDArray[Any]:
    """The camera's pose as of `ground_camera`, where the aircraft believes to be, (4, 3)."""
    return np.vstack([(*record["r_V_N"], -record["height"]), attitude(record)])


def footprint(record: np.void, config: HerdingConfig) -> Points:
    """Corners of what the camera sees of the robots' tops, (right, up), m."""
    pose = pose_of(record)
    far, size = float(depth(pose)), 0.5 * float(pixel_size(pose, config_fov(config)))
    signs = np.array([[0, -1, 1], [0, 1, 1], [0, 1, -1], [0, -1, -1]])
    rays = ((far, 0.0, 0.0) + signs * (0.0, WIDTH * size, HEIGHT * size)) @ pose[1:]
    fall = np.maximum(rays[:, 2:], max(HORIZON * far, 1e-9))
    return above(record["r_V_N"] + rays[:, :2] * far / fall)


def in_picture(pose: NDArray[Any], places: Any) -> tuple[Points, NDArray[Any]]:
    """Where the picture shows places (right, up), and how large; NaN for those behind the camera.

    Both in m straight below a level camera: (right, up), (n, 2), and size of 1 m there, (n,).
    """
    far = float(depth(pose))
    r = np.insert(above(places) - pose[0, :2], 2, far, axis=1) @ pose[1:].T
    scale = far / np.where(r[:, 0] > 0.1 * far, r[:, 0], np.nan)
    return r[:, 1:] * (1.0, -1.0) * scale[:, None], scale


def config_fov(config: HerdingConfig) -> Any:
    """The camera's settings as the record that its kernels read."""
    out = np.zeros(1, [("fov", "f8")])
    out["fov"] = config.fov
    return out[0]


def draw_arena(
    image: Image, team: NDArray[Any], config: HerdingConfig, flown: NDArray[Any]
) -> None:
    """Draw lines, footprint, tracks, robots, obstacles, aircraft and where they flew, (., n, 2)."""
    record, half = team[0], 0.5 * config.side
    panel = Panel(image, *ARENA, (0.0, 0.0), ARENA[2] / (config.side + 2 * MARGIN))
    view, size = footprint(record, config), config.robot_radius * panel.scale
    panel.clear()
    panel.fill(view, style.SAND)
    for _, at, _, sd in tracks(record):
        if sd < VAGUE:
            panel.fill(panel.ellipse(at, np.eye(2) * sd**2, SIGMAS), style.PALE_BLUE)
    panel.grid()
    panel.line(view, style.DARK_SAND, 1, closed=True)
    west, east = np.array([-half, half]), np.array([half, half])
    panel.line(np.array([west, east]), style.GREEN, 3)
    panel.line(np.array([-west, -east]), style.VERMILLION, 3)
    for side in (-half, half):
        panel.line(np.array([[side, -half], [side, half]]), style.GREY, 1)
    places = above(record["r_R_N"])
    for k in np.flatnonzero(record["fate"] == ACTIVE):
        colour = style.VERMILLION if k < ROBOTS else style.INK
        panel.disc(places[k], size, colour, -1 if k < ROBOTS else 1)
        tip = places[k] + 0.55 * ahead(float(record["heading"][k]))
        panel.line(np.array([places[k], tip]), colour, 1)
    for _, at, way, sd in tracks(record):
        panel.line(panel.ellipse(at, np.eye(2) * sd**2, SIGMAS), style.BLUE, 1, closed=True)
        panel.reticle(at, style.BLUE, 1)
        panel.line(np.array([at, at + 0.8 * way]), style.BLUE, 1)
    for k, aircraft in enumerate(team):
        panel.path(above(flown[:, k]), style.GREY)
        (here,), (aim,) = above(aircraft["r_V_N"]), above(aircraft["aim_N"])
        panel.line(np.array([here, aim]), style.GREEN, 1)
        panel.disc(here, config.aircraft_radius * panel.scale + 1, style.INK, 2)
        panel.pointer(here, style.INK)
    panel.border()
    panel.labels("east (m)", "north (m)")


def draw_camera(image: Image, record: np.void, config: HerdingConfig) -> None:
    """Draw the picture of the camera, or the true robots in view, and what is tracked there."""
    pose = pose_of(record)
    width = max(WIDTH * float(pixel_size(pose, config_fov(config))), 1e-3)
    panel = Panel(image, *CAMERA, (0.0, 0.0), CAMERA[2] / width)
    panel.clear(style.WHITE)
    if config.perception == "images":
        frame = picture(record, record, camera(vars(config)))
        panel.view[:] = cv2.resize(frame, CAMERA[2:], interpolation=cv2.INTER_AREA)
    else:
        places, scales = in_picture(pose, above(record["r_R_N"]))
        for k in np.flatnonzero((record["fate"] == ACTIVE) & np.isfinite(scales)):
            colour = style.VERMILLION if k < ROBOTS else style.INK
            panel.disc(places[k], config.robot_radius * panel.scale * float(scales[k]), colour, 2)
    for i, place, way, sd in tracks(record):
        (at, tip), (scale, _) = in_picture(pose, [place, place + 0.4 * way])
        if not np.isfinite(at).all():
            continue
        size = np.eye(2) * (sd * scale) ** 2
        panel.line(panel.ellipse(at, size, SIGMAS), style.BLUE, 1, closed=True)
        panel.reticle(at, style.BLUE, 1)
        turning = float(record["track_p_spin"][i]) > 0.5
        panel.line(np.array([at, tip]), style.GREEN if turning else style.BLUE, 2)
    panel.border()


def draw_clocks(image: Image, record: np.void, config: HerdingConfig) -> None:
    """Draw a clock for each track: how far its 20 s are gone."""
    left, top = CLOCKS
    write(image, "20 s clocks", (left - HAND, top - 6), 12, style.GREY)
    for i in range(ROBOTS):
        panel = Panel(image, left, top + i * 22, 2 * HAND, 2 * HAND, (0.0, 0.0), HAND)
        status = float(np.nan_to_num(record["track_status"][i]))
        colour = style.BLUE if status == 1.0 else style.FRAME
        panel.disc(np.zeros(2), HAND - 1, colour, 1)
        if status == 1.0:
            turn = 2.0 * math.pi * float(record["track_phase"][i]) / config.period
            panel.line(np.array([np.zeros(2), 0.8 * ahead(turn)]), colour, 2)
        age = float(record["track_age"][i])
        seen = ("no track", f"seen {age:.1f} s ago", "out")[int(status)]
        write(image, f"{i}  {seen}", (left + 24, top + 13 + i * 22), 12, style.GREY)


def draw_status(image: Image, record: np.void, config: HerdingConfig) -> None:
    """Write time, score, and what the aircraft is doing."""
    left, top = STATUS
    outcome = Outcome(int(record["outcome"]))
    lines = [
        ("time left", f"{float(record['t_go']):.0f} s"),
        ("goaled / removed", f"{int(record['goaled'])} / {int(record['removed'])}"),
        ("bumps / touches", f"{int(record['blocks'])} / {int(record['taps'])}"),
        ("height", f"{float(record['height']):.2f} m, {stage(record)}"),
        ("bound for", business(record)),
        ("cost", f"{float(record['total_cost']):.2f} thousand points"),
    ]
    for i, (name, text) in enumerate(lines):
        write(image, name, (left, top + i * 22), 13, style.GREY)
        write(image, text, (left + 120, top + i * 22), 13)
    if outcome != RUNNING:
        text, colour = ENDINGS[outcome]
        write(image, text, (left, top + len(lines) * 22 + 8), 16, colour)
    write(image, "red: robots, with obstacles in black; blue: tracks", (left, 500), 12, style.GREY)
    write(image, "with 2 sigma; sand: what the camera sees", (left, 516), 12, style.GREY)


def stage(record: np.void) -> str:
    """The stage in words."""
    number = float(record["stage"])
    return STAGES[int(number)] if math.isfinite(number) else ""


def business(record: np.void) -> str:
    """What the aircraft has chosen, in words."""
    service, target = int(record["service"]), int(record["target"])
    if service == HOVER:
        return "nothing"
    if service == GO:
        return f"place {target}"
    what = "a look at" if service == LOOK else "the top of" if service == TAP else "the front of"
    return f"{what} {target}"
