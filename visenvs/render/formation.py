"""The picture of a formation flight: from above, from behind, and through the camera.

All views are in the follower's heading frame F, so that the commanded place of the leader stands
still and what moves is the error.
"""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from visenvs.core.config import to_record
from visenvs.core.lanes import Task
from visenvs.envs.formation import FormationConfig
from visenvs.render import convoy, style
from visenvs.render.canvas import Panel, Points
from visenvs.render.scene import Box, draw_figures, figures, paper
from visenvs.render.style import Image, write
from visenvs.sensors.formation import half_wing

TOP_VIEW = (60, 66, 400, 440)  # left, top, width, height of the plots, pixels
CHASE_VIEW = (520, 66, 240, 200)
CAMERA = (520, 306, 240, 200)
STATUS = (790, 66, 154, 440)

BACK = 0.2  # of the height of the top view is behind the follower
ARROW_TIME = 1.0  # arrows show the displacement of this time, s
ROOM = 1.45  # height ahead, in lengths of the longest commanded distance
PLANES = {"top": np.array([[0.0, 1, 0], [1, 0, 0]]), "chase": np.array([[0.0, 1, 0], [0, 0, -1]])}


def draw(
    record: Any, config: FormationConfig, task: Task, trail: NDArray[Any] | None = None
) -> Image:
    """Draw one lane record, or those of a team, RGB, shape (540, 960, 3).

    Args:
        record: lane record of the task, or an array of them, which `convoy` draws.
        config: its configuration.
        task: its card; unused.
        trail: earlier records of the episode, shape (n,), for the paths flown; None for no paths.
    """
    if record.ndim:
        return convoy.draw(record, config, trail)
    image = background().copy()
    past = np.zeros(0, task.lane) if trail is None else np.append(trail, record)
    with np.errstate(invalid="ignore", over="ignore"):  # the last record of a diverged lane
        top, chase = windows(image, config)
        draw_plane(top, "top", record, past, config)
        draw_plane(chase, "chase", record, past, config)
        draw_camera(Panel(image, *CAMERA, scale=picture_scale(config)), record, config)
        draw_status(image, record, config)
    top.labels("right (m)", "ahead (m)")
    chase.labels("right (m)", "up (m)")
    return image


@cache
def background() -> Image:
    """What no record changes: headings and legend."""
    plots: dict[str, Box] = {"Top view": TOP_VIEW, "From behind": CHASE_VIEW, "Camera": CAMERA}
    image = paper("Formation", plots)
    draw_legend(image)
    return image


def windows(image: Image, config: FormationConfig) -> tuple[Panel, Panel]:
    """Top view and chase view, which stay the same whatever happens."""
    commands = [config.offset, config.step_1, config.step_2, config.step_3]
    reach = max(math.hypot(*command) for command in commands)
    if config.start == "drawn":
        reach += config.offset_drawn[0]
    high = TOP_VIEW[3] / (ROOM * reach)
    middle = (0.5 - BACK) * TOP_VIEW[3] / high
    top = Panel(image, *TOP_VIEW, (0.0, middle), high)
    return top, Panel(image, *CHASE_VIEW, (0.0, 0.0), CHASE_VIEW[2] / (0.9 * reach))


def picture_scale(config: FormationConfig) -> float:
    """Pixels per unit of the image plane, so that the whole picture is shown."""
    wide, high = (math.tan(angle) for angle in config.view)
    return 0.46 * min(CAMERA[2] / wide, CAMERA[3] / high)


def into_heading(record: np.void) -> Points:
    """The matrix that turns vectors of N into the follower's heading frame, (3, 3)."""
    c, s = np.cos(record["heading"]), np.sin(record["heading"])
    return np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])


def draw_plane(
    panel: Panel, plane: str, record: np.void, past: NDArray[Any], config: FormationConfig
) -> None:
    """Draw follower, leader, estimate and command in a plane of F."""
    rows, turn = PLANES[plane], into_heading(record)
    own, leader = record["r_V_N"], record["leader"]
    true, hat = turn @ (leader["r_N"] - own), record["rhat_LV_F"]
    covariance = rows @ turn @ record["belief"]["C"][:3, :3] @ turn.T @ rows.T
    wide, narrow = (panel.ellipse(rows @ hat, covariance, n) for n in (3.0, 1.0))
    command = rows @ record["offset_F"]
    panel.clear()
    if plane == "top":
        ahead, side = np.array([0.0, 1.0]), np.array([math.tan(config.view[0]), 1.0])
        wedge = panel.sector((0.0, 0.0), ahead, side, 2.0 * TOP_VIEW[3])
        panel.fill(wedge, style.SAND)
    panel.fill(wide, style.PALE_BLUE)
    panel.fill(narrow, style.MIDDLE_BLUE)
    panel.grid()
    panel.line(wide, style.BLUE, 1, closed=True)
    panel.line(narrow, style.BLUE, 1, closed=True)
    both = rows @ turn
    wing = turn @ np.array(half_wing(leader))
    panel.disc(command, 7.0, style.GREEN, 2)
    panel.line(np.array([rows @ (true - wing), rows @ (true + wing)]), style.VERMILLION, 3)
    panel.disc(rows @ true, 4.5, style.VERMILLION)
    if plane == "top":
        panel.path((past["r_V_N"] - own) @ both.T, style.GREY)
        panel.path((past["leader"]["r_N"] - own) @ both.T, style.VERMILLION)
        panel.arrow(rows @ true, ARROW_TIME * both @ leader["v_N"], style.VERMILLION)
        panel.arrow((0.0, 0.0), ARROW_TIME * both @ record["v_V_N"], style.INK)
        panel.dart((0.0, 0.0), (0.0, 1.0), style.INK)
    else:
        panel.disc((0.0, 0.0), 5.0, style.INK)
    panel.reticle(rows @ hat, style.BLUE)
    panel.pointer(rows @ true, style.VERMILLION)
    panel.pointer(rows @ hat, style.BLUE)
    panel.border()


def draw_camera(panel: Panel, record: np.void, config: FormationConfig) -> None:
    """Draw the picture's frame, the true wing, and what was measured of it, upright."""
    turn, leader = into_heading(record), record["leader"]
    r, wing = turn @ (leader["r_N"] - record["r_V_N"]), turn @ np.array(half_wing(leader))
    wide, high = (math.tan(angle) for angle in config.view)
    frame = np.array([[-wide, -high], [wide, -high], [wide, high], [-wide, high]])
    panel.clear(style.GRID)
    panel.fill(frame, style.WHITE)
    if config.perception == "images":
        from visenvs.envs._formation_images import picture

        panel.show(picture(np.array([record]), 0, to_record(config)[0]), frame[0], frame[2])
    panel.line(frame, style.FRAME, 1, closed=True)
    if config.perception == "points" and r[0] > 0.0:
        tips = np.array([image_point(r - wing), image_point(r + wing)])
        panel.line(tips, style.VERMILLION, 3)
        panel.disc(image_point(r), 4.0, style.VERMILLION)
    if record["seen"]:
        point = image_point(turn @ record["sight"]["u_N"])
        if config.perception == "images":
            panel.disc(
                point, 8.0 + 0.5 * float(record["sight"]["alpha"]) * panel.scale, style.INK, 1
            )
        else:
            panel.reticle(point, style.DARK_SAND)
    else:
        where = (panel.left + panel.width / 2, panel.top + panel.height - 12)
        write(panel.image, "no image", where, 13, style.VERMILLION, "middle")
    panel.border()


def image_point(r: Points) -> Points:
    """Image point (right, up) of a place in F, shape (2,)."""
    return np.array([r[1], -r[2]]) / max(float(r[0]), 0.1)


def draw_status(image: Image, record: np.void, config: FormationConfig) -> None:
    """Write time to go, errors, age of the last image, cost and how the episode ended."""
    far = float(np.linalg.norm(record["rhat_LV_F"]))
    spread = far * float(record["sd_log_range"])
    off = float(np.linalg.norm(record["tracking_error"]))
    true = into_heading(record) @ (record["leader"]["r_N"] - record["r_V_N"])
    guess = float(np.linalg.norm(record["rhat_LV_F"] - true))
    rows = (
        ("time to go", f"{record['t_go']:.1f} s", style.INK),
        ("estimated range", f"{figures(far)} ± {figures(spread)} m", style.BLUE),
        ("error of the estimate", f"{figures(guess)} m", style.VERMILLION),
        ("off the commanded place", f"{figures(off)} m", style.GREEN),
        ("since the last image", f"{figures(float(record['age']))} s", style.INK),
        ("cost so far", f"{figures(float(record['total_cost']))} m²/s³", style.INK),
    )
    draw_figures(image, rows, record, config.t_f, STATUS)


def draw_legend(image: Image) -> None:
    """Name the marks along the top."""
    icons = [Panel(image, left, 12, 26, 24) for left in (150, 250, 340, 480, 640, 730)]
    names = ("follower", "leader", "estimate, 1σ 3σ", "commanded place", "velocity", "measured")
    icons[0].dart((0.0, -2.0), (0.0, 1.0), style.INK)
    icons[1].line(np.array([[-9.0, 0.0], [9.0, 0.0]]), style.VERMILLION, 3)
    icons[1].disc((0.0, 0.0), 4.5, style.VERMILLION)
    ellipse = icons[2].ellipse((0.0, 0.0), np.diag([15.0, 10.0]), 3.0)
    icons[2].fill(ellipse, style.PALE_BLUE)
    icons[2].line(ellipse, style.BLUE, 1, closed=True)
    icons[2].reticle((0.0, 0.0), style.BLUE)
    icons[3].disc((0.0, 0.0), 7.0, style.GREEN, 2)
    icons[4].arrow((-11.0, 0.0), (22.0, 0.0), style.INK)
    icons[5].reticle((0.0, 0.0), style.DARK_SAND)
    for icon, name in zip(icons, names, strict=True):
        write(image, name, (icon.left + 30, 29), 13, style.GREY)
