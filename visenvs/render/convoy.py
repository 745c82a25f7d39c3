"""The picture of a team in formation: everybody from above and from behind, in the leader's frame.

The frame turns with the leader's course, so that the formation stands still and what moves is the
error. A cross and its ellipse are what a follower believes of the one that it follows.
"""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from visenvs.core.outcome import Outcome
from visenvs.envs.formation import FormationConfig
from visenvs.render import style
from visenvs.render.canvas import Panel, Points
from visenvs.render.scene import ENDINGS, figures, paper
from visenvs.render.style import Image, write

TOP_VIEW = (60, 66, 400, 440)  # left, top, width, height of the plots, pixels
CHASE_VIEW = (520, 66, 240, 200)
STATUS = (520, 330)  # left and top of the table
COLUMNS = (0, 110, 205, 300, 390)  # right ends of its columns but the first, from its left, pixels
MOST = 7  # followers in the table
SLOW = 8.0  # m/s; who moves no faster in a plane flies out of it
ARROW_TIME = 0.5  # arrows show the displacement of this time, s
ROOM = 1.3  # height of the top view in depths of the formation
BESIDE = 10.0  # to either side, m
PLANES = {"top": np.array([[0.0, 1, 0], [1, 0, 0]]), "chase": np.array([[0.0, 1, 0], [0, 0, -1]])}


def draw(team: NDArray[Any], config: FormationConfig, trail: NDArray[Any] | None = None) -> Image:
    """Draw the lane records of a team (n,), RGB, shape (540, 960, 3).

    Args:
        team: their records.
        config: the configuration.
        trail: earlier records of the episode, shape (steps, n), for the paths; None for no paths.
    """
    image = background().copy()
    deep, wide = extent(config)
    top = Panel(image, *TOP_VIEW, (0.0, -0.42 * deep), TOP_VIEW[3] / (ROOM * deep))
    chase = Panel(image, *CHASE_VIEW, (0.0, 0.0), 0.5 * CHASE_VIEW[2] / wide)
    with np.errstate(invalid="ignore", over="ignore"):  # records of a diverged lane
        for panel, name in ((top, "top"), (chase, "chase")):
            draw_plane(panel, PLANES[name] @ course_axes(team[0]), team, trail, config)
        draw_table(image, team)
    top.labels("right (m)", "ahead (m)")
    chase.labels("right (m)", "up (m)")
    return image


@cache
def background() -> Image:
    """What no record changes: headings and legend."""
    image = paper("Formation", {"Top view": TOP_VIEW, "From behind": CHASE_VIEW})
    icons = [Panel(image, left, 12, 26, 24) for left in (150, 250, 340, 500, 680)]
    names = ("follower", "leader", "believed leader, 2σ", "commanded place", "follows")
    icons[0].dart((0.0, -2.0), (0.0, 1.0), style.INK)
    icons[1].dart((0.0, -2.0), (0.0, 1.0), style.VERMILLION)
    icons[2].fill(icons[2].ellipse((0.0, 0.0), np.diag([15.0, 10.0]), 3.0), style.MIDDLE_BLUE)
    icons[2].cross((0.0, 0.0), style.BLUE)
    icons[3].disc((0.0, 0.0), 7.0, style.GREEN, 2)
    icons[4].line(np.array([[-10.0, 0.0], [10.0, 0.0]]), style.DARK_SAND, 1)
    for icon, name in zip(icons, names, strict=True):
        write(image, name, (icon.left + 30, 29), 13, style.GREY)
    return image


def extent(config: FormationConfig) -> tuple[float, float]:
    """How far the formation reaches back, and to either side with some room, m."""
    behind = config.followers if config.formation == "chain" else (config.followers + 1) // 2
    drawn = config.offset_drawn if config.start == "drawn" else (0.0, 0.0, 0.0)
    wide = behind * max(abs(config.offset[1]), drawn[1], abs(config.offset[2]), drawn[2])
    return behind * (config.offset[0] + drawn[0]), wide + BESIDE


def course_axes(record: np.void) -> Points:
    """The matrix that turns vectors of N into the frame of the leader's course, (3, 3)."""
    north, east = record["leader"]["v_N"][:2]
    speed = max(math.hypot(north, east), 1e-9)
    c, s = north / speed, east / speed
    return np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])


def draw_plane(
    panel: Panel,
    rows: Points,
    team: NDArray[Any],
    trail: NDArray[Any] | None,
    config: FormationConfig,
) -> None:
    """Draw the team in a plane whose two axes are the rows of a matrix on N, (2, 3)."""
    first = team[0]["leader"]
    places = (team["r_V_N"] - first["r_N"]) @ rows.T
    leaders = (team["leader"]["r_N"] - first["r_N"]) @ rows.T
    panel.clear()
    for record, place in zip(team, places, strict=True):
        covariance = rows @ record["belief"]["C"][:3, :3] @ rows.T
        panel.fill(
            panel.ellipse(place + rows @ believed(record), covariance, 2.0), style.MIDDLE_BLUE
        )
    panel.grid()
    if trail is not None:
        for k in range(len(team)):
            panel.path((trail["r_V_N"][:, k] - first["r_N"]) @ rows.T, style.FRAME)
    for record, place, leader in zip(team, places, leaders, strict=True):
        panel.line(np.array([place, leader]), style.DARK_SAND, 1)
        c, s = math.cos(record["heading"]), math.sin(record["heading"])
        offset = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]) @ record["offset_F"]
        panel.disc(leader - rows @ offset, 7.0, style.GREEN, 2)
    draw_vehicle(panel, (0.0, 0.0), rows @ first["v_N"], style.VERMILLION)
    for record, place in zip(team, places, strict=True):
        gone = record["outcome"] not in (Outcome.RUNNING, Outcome.SUCCESS)
        draw_vehicle(panel, place, rows @ record["v_V_N"], style.FRAME if gone else style.INK)
        panel.pointer(place, style.FRAME if gone else style.INK)
        panel.cross(place + rows @ believed(record), style.BLUE)
    panel.border()


def believed(record: np.void) -> Points:
    """Where a follower believes its leader to be, relative to itself in N, m."""
    c, s = math.cos(record["heading"]), math.sin(record["heading"])
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]) @ record["rhat_LV_F"]


def draw_vehicle(panel: Panel, place: Any, velocity: Points, colour: style.Colour) -> None:
    """Draw a vehicle with its velocity in the plane; a disc where it flies out of the plane."""
    panel.arrow(place, ARROW_TIME * velocity, colour, 1)
    slow = float(np.hypot(*velocity)) < SLOW
    panel.dart(place, (0.0, 0.0) if slow else velocity, colour, 7.0)


def draw_table(image: Image, team: NDArray[Any]) -> None:
    """Write who is how far off its place, how wrong about its leader, at what cost, and lost."""
    left, top = STATUS
    titles = ("follower", "off (m)", "wrong (m)", "cost", "")
    turn = np.cos(team["heading"]), np.sin(team["heading"])
    true = team["leader"]["r_N"] - team["r_V_N"]
    ahead = turn[0] * true[:, 0] + turn[1] * true[:, 1]
    right = turn[0] * true[:, 1] - turn[1] * true[:, 0]
    wrong = team["rhat_LV_F"] - np.stack([ahead, right, true[:, 2]], axis=1)
    write(image, f"time to go {team['t_go'].min():.1f} s", (left, top - 28), 15, style.INK)
    for k, title in enumerate(titles):
        write(image, title, (left + COLUMNS[k], top), 13, style.GREY, "right" if k else "left")
    for row, record in enumerate(team[:MOST]):
        y = top + 24 * (row + 1)
        outcome = Outcome(int(record["outcome"]))
        end, colour = ENDINGS.get(outcome, ("", style.INK))
        off = float(np.linalg.norm(record["tracking_error"]))
        values = (off, float(np.linalg.norm(wrong[row])), float(record["total_cost"]))
        cells = (str(row), *(figures(value) for value in values), end)
        for k, cell in enumerate(cells):
            align = "right" if k else "left"
            write(image, cell, (left + COLUMNS[k], y), 14, colour if k == 4 else style.INK, align)
