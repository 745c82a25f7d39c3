"""The picture of a rendezvous: seen from above, from the side, and by the camera."""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from visenvs.core.lanes import Task
from visenvs.core.pinhole import project
from visenvs.envs.rendezvous import RendezvousConfig
from visenvs.render import legend, style
from visenvs.render.canvas import NOTHING, Panel, Points
from visenvs.render.scene import (
    close_camera,
    draw_plane,
    draw_status,
    first_record,
    paper,
    predicted_point,
)
from visenvs.render.style import Image

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
    legend.draw(
        image,
        (196, "vehicle", legend.vehicle),
        (284, "velocity", legend.velocity),
        (374, "acceleration", legend.acceleration),
        (492, "target", legend.target),
        (572, "estimate, 1σ 3σ", legend.estimate),
        (720, "field of view", mark_view),
        (836, "image point", legend.measured),
    )
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
    point, spread = predicted_point(C, record["rhat_TV_N"], record["P"], config.min_range)
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
    close_camera(panel, seen, f"±{math.degrees(math.atan(shown)):.0f}°")


def mark_view(icon: Panel) -> None:
    """A field of view to the right, for the legend."""
    icon.fill(icon.sector((-9.0, 0.0), (1.0, 0.0), (1.0, 0.5), 20.0), style.DARK_SAND)
