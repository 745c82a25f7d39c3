"""The picture of a rendezvous: seen from above, from the side, and by the camera."""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from visenvs.core.lanes import Task
from visenvs.core.pinhole import jacobian, project
from visenvs.envs.rendezvous import RendezvousConfig
from visenvs.render import style
from visenvs.render.canvas import NOTHING, Panel, Points
from visenvs.render.scene import draw_plane, draw_status, first_record, paper
from visenvs.render.style import Image, write

TOP_VIEW = (44, 66, 330, 440)  # left, top, width, height of the plot, pixels
SIDE_VIEW = (422, 66, 330, 440)
CAMERA = (774, 66, 170, 170)
STATUS = (774, 256, 170, 250)

EAST_NORTH = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0]])
MARGIN = 0.25  # around start and target, in distances between them
WIDEST = 1.5  # half width of the camera picture for lenses that see more, focal lengths
WEDGE = 100.0  # reach of the field of view in the plots, pixels


def draw(
    record: np.void, config: RendezvousConfig, task: Task, trail: NDArray[Any] | None = None
) -> Image:
    """Draw one lane record, RGB, shape (540, 960, 3).

    The window stays the same throughout an episode: it follows from the record's seed and episode.

    Args:
        record: lane record of the rendezvous.
        config: its configuration.
        task: its card, which finds the start of the episode again.
        trail: earlier records of the episode, shape (n,), for the path flown; None for no path.
    """
    image = background().copy()
    along = bearing(record["r_T_N"])
    top, side = windows(image, record, config, task, along)
    path = np.zeros((0, 3)) if trail is None else np.vstack([trail["r_V_N"], record["r_V_N"]])
    with np.errstate(invalid="ignore", over="ignore"):  # the last record of a diverged lane
        for panel, rows in ((top, EAST_NORTH), (side, along)):
            wedge = field_of_view(panel, rows, record, config)
            draw_plane(panel, rows, record, config, path, wedge)
        draw_camera(image, record, config)
        draw_status(image, record, config, STATUS)
    top.labels("east (m)", "north (m)")
    side.labels("towards the target (m)", "height (m)")
    return image


@cache
def background() -> Image:
    """What no record changes: headings and legend."""
    image = paper("Rendezvous", {"Top view": TOP_VIEW, "Side view": SIDE_VIEW, "Camera": CAMERA})
    draw_legend(image)
    return image


def bearing(r_T_N: Points) -> Points:
    """Rows that map N to (right, up) in the vertical plane of start and target, shape (2, 3)."""
    azimuth = math.atan2(r_T_N[1], r_T_N[0])
    return np.array([[math.cos(azimuth), math.sin(azimuth), 0.0], [0.0, 0.0, -1.0]])


def windows(
    image: Image, record: np.void, config: RendezvousConfig, task: Task, along: Points
) -> tuple[Panel, Panel]:
    """Top and side view at one scale: start, target and first estimate with a margin about them."""
    first = first_record(record, config, task)
    points = np.nan_to_num(np.array([np.zeros(3), record["r_T_N"], first["rhat_TV_N"]]))
    margin = max(MARGIN * float(np.linalg.norm(points[1])), config.success_radius)
    centres: list[tuple[float, float]] = []
    scale = math.inf
    for rows, (_, _, width, height) in ((EAST_NORTH, TOP_VIEW), (along, SIDE_VIEW)):
        start, target, guess = points @ rows.T
        low = np.minimum(np.minimum(start, target) - margin, guess - margin / 4)
        high = np.maximum(np.maximum(start, target) + margin, guess + margin / 4)
        centres.append((float(low[0] + high[0]) / 2, float(low[1] + high[1]) / 2))
        scale = min(scale, *(np.array([width, height]) / (high - low)).tolist())
    return Panel(image, *TOP_VIEW, centres[0], scale), Panel(image, *SIDE_VIEW, centres[1], scale)


def field_of_view(panel: Panel, rows: Points, record: np.void, config: RendezvousConfig) -> Points:
    """Outline of the camera's field of view in a plane; empty where the camera looks across it."""
    C = record["C_CN"]
    edge = C[1] if rows is EAST_NORTH else C[2]
    side = rows @ (C[0] + config.half_width * edge)
    return panel.sector(rows @ record["r_V_N"], rows @ C[0], side, WEDGE)


def draw_camera(image: Image, record: np.void, config: RendezvousConfig) -> None:
    """Draw what the camera sees and where the filter expects it."""
    shown = min(config.half_width, WIDEST)
    panel = Panel(image, *CAMERA, (0.0, 0.0), CAMERA[2] / 2 / shown)
    C, seen = record["C_CN"], bool(record["seen"])
    point, spread = predicted_point(record, config)
    expected = float(C[0] @ record["rhat_TV_N"]) > 0.0
    wide, narrow = (panel.ellipse(point, spread, n) if expected else NOTHING for n in (3.0, 1.0))
    panel.clear(style.WHITE if seen else style.GRID)
    panel.fill(wide, style.PALE_BLUE)
    panel.fill(narrow, style.MIDDLE_BLUE)
    for end in np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]]):
        panel.line([0.2 * shown * end, shown * end], style.FRAME)
    panel.line(wide, style.BLUE, 1, closed=True)
    panel.line(narrow, style.BLUE, 1, closed=True)
    depth, y, z = project(C, record["r_TV_N"], config.min_range)
    if depth > config.min_range:
        panel.disc((y, -z), config.success_radius / depth * panel.scale, style.VERMILLION, 2)
    if expected:
        panel.reticle(point, style.BLUE, 1)
        panel.pointer(point, style.BLUE)
    if seen:
        pixel = record["pixel"] * (1.0, -1.0)
        panel.cross(pixel, style.INK)
        panel.pointer(pixel, style.INK)
    angle = f"±{math.degrees(math.atan(shown)):.0f}°"
    write(panel.view, angle, (panel.width - 5, panel.height - 7), 12, style.GREY, "right")
    if not seen:
        write(panel.view, "no detection", (panel.width / 2, 22), 13, style.VERMILLION, "middle")
    panel.border(style.FRAME if seen else style.VERMILLION)


def predicted_point(record: np.void, config: RendezvousConfig) -> tuple[Points, Points]:
    """Image point of the estimate, (right, up), and its covariance H P H' (2, 2), focal lengths."""
    H = np.zeros((2, 3))
    X, y, z = project(record["C_CN"], record["rhat_TV_N"], config.min_range)
    jacobian(record["C_CN"], X, y, z, H)
    H[1] = -H[1]
    return np.array([y, -z]), H @ record["P"] @ H.T


def draw_legend(image: Image) -> None:
    """Name the marks along the top."""
    icons = [Panel(image, left, 12, 26, 24) for left in (196, 284, 374, 492, 572, 720, 836)]
    names = (
        "vehicle",
        "velocity",
        "acceleration",
        "target",
        "estimate, 1σ 3σ",
        "field of view",
        "image point",
    )
    icons[0].dart((3.0, 0.0), (1.0, 0.0), style.INK)
    icons[1].arrow((-11.0, 0.0), (22.0, 0.0), style.INK)
    icons[2].arrow((-11.0, 0.0), (22.0, 0.0), style.GREEN)
    icons[3].disc((5.0, 0.0), 4.5, style.VERMILLION)
    ellipse = icons[4].ellipse((0.0, 0.0), np.diag([15.0, 10.0]), 3.0)
    icons[4].fill(ellipse, style.PALE_BLUE)
    icons[4].line(ellipse, style.BLUE, 1, closed=True)
    icons[4].reticle((0.0, 0.0), style.BLUE)
    icons[5].fill(icons[5].sector((-9.0, 0.0), (1.0, 0.0), (1.0, 0.5), 20.0), style.DARK_SAND)
    icons[6].cross((3.0, 0.0), style.INK)
    for icon, name in zip(icons, names, strict=True):
        write(image, name, (icon.left + 30, 29), 13, style.GREY)
