"""The picture of obstacle avoidance: seen from above, from the side, and by the camera."""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from visenvs.core.config import to_record
from visenvs.core.frames import rotate
from visenvs.core.lanes import Task
from visenvs.core.pinhole import project
from visenvs.dynamics.quadrotor import attitude
from visenvs.envs.avoidance import AvoidanceConfig
from visenvs.render import legend, style
from visenvs.render.canvas import Panel, Points
from visenvs.render.scene import (
    close_camera,
    draw_figures,
    figures,
    first_record,
    paper,
    predicted_point,
)
from visenvs.render.style import Image

TOP_VIEW = (44, 66, 708, 206)  # left, top, width, height of the plot, pixels
SIDE_VIEW = (44, 312, 708, 192)
CAMERA = (774, 66, 170, 170)
STATUS = (774, 256, 170, 250)

FROM_ABOVE = np.array([[1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])  # maps N to (right, up)
FROM_THE_SIDE = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
MARGIN = 0.04  # around what is shown, in lengths of the flight
WIDEST = 1.0  # half width of the camera picture for lenses that see more, focal lengths
ARROW_TIME = 0.06  # arrows show the displacement in this share of the flight


def draw(
    record: np.void, config: AvoidanceConfig, task: Task, trail: NDArray[Any] | None = None
) -> Image:
    """Draw one lane record, RGB, shape (540, 960, 3).

    The window stays the same throughout an episode: it follows from the record's seed and episode.

    Args:
        record: lane record of the avoidance task.
        config: its configuration.
        task: its card, which finds the start of the episode again.
        trail: earlier records of the episode, shape (n,), for the path flown; None for no path.
    """
    image = background().copy()
    top, side = windows(image, first_record(record, config, task), config)
    path = np.zeros((0, 3)) if trail is None else np.vstack([trail["r_V_N"], record["r_V_N"]])
    with np.errstate(invalid="ignore", over="ignore"):  # the last record of a diverged lane
        for panel, rows in ((top, FROM_ABOVE), (side, FROM_THE_SIDE)):
            draw_plane(panel, rows, record, config, path)
        draw_camera(image, record, config)
        draw_status(image, record, config)
    top.labels("along the flight (m)", "to the left (m)")
    side.labels("along the flight (m)", "height (m)")
    return image


@cache
def background() -> Image:
    """What no record changes: headings and legend."""
    image = paper("Avoidance", {"Top view": TOP_VIEW, "Side view": SIDE_VIEW, "Camera": CAMERA})
    legend.draw(
        image,
        (150, "vehicle", legend.vehicle),
        (236, "velocity", legend.velocity),
        (320, "acceleration", legend.acceleration),
        (436, "waypoint", mark_waypoint),
        (530, "safety sphere", mark_sphere),
        (660, "estimate 1σ 3σ", legend.estimate),
        (796, "measured", legend.measured),
    )
    return image


def windows(image: Image, first: np.void, config: AvoidanceConfig) -> tuple[Panel, Panel]:
    """Top and side view at one scale: start, waypoint and all spheres with a margin about them."""
    n, waypoint = int(first["count"]), np.array(config.waypoint)
    points, reach = first["r_O_N"][:n], first["radius"][:n, None]
    ends = np.stack([np.zeros(3), waypoint])
    margin = MARGIN * float(np.linalg.norm(waypoint))
    low = np.minimum((points - reach).min(axis=0), ends.min(axis=0)) - margin
    high = np.maximum((points + reach).max(axis=0), ends.max(axis=0)) + margin
    panels: list[tuple[tuple[float, float], float]] = []
    for rows, (_, _, width, height) in ((FROM_ABOVE, TOP_VIEW), (FROM_THE_SIDE, SIDE_VIEW)):
        middle = rows @ (low + high) / 2
        extent = np.abs(rows @ (high - low))
        scale = float(np.min(np.array([width, height]) / extent))
        panels.append(((float(middle[0]), float(middle[1])), scale))
    scale = min(scale for _, scale in panels)
    (above, _), (beside, _) = panels
    return Panel(image, *TOP_VIEW, above, scale), Panel(image, *SIDE_VIEW, beside, scale)


def tracks(record: np.void, config: AvoidanceConfig) -> list[tuple[Points, Points, float]]:
    """What the row tells: estimates relative to the vehicle (3,), covariances (3, 3), radii."""
    out: list[tuple[Points, Points, float]] = []
    if config.observation == "pixels":
        return out
    for k in np.flatnonzero(record["valid_O"] == 1.0):
        L = np.zeros((3, 3))
        L[np.tril_indices(3)] = record["chol_OV"][k]
        out.append((record["rhat_OV_N"][k], L @ L.T, float(record["radius_O"][k])))
    return out


def draw_plane(
    panel: Panel, rows: Points, record: np.void, config: AvoidanceConfig, path: Points
) -> None:
    """Draw spheres, estimates, waypoint, the path flown and the vehicle in a plane.

    Args:
        panel: where.
        rows: maps N to (right, up), shape (2, 3).
        record: lane record.
        config: its configuration.
        path: positions flown in N, shape (n, 3).
    """
    vehicle, velocity = rows @ record["r_V_N"], rows @ record["v_V_N"]
    found = [(vehicle + rows @ r, rows @ P @ rows.T, d) for r, P, d in tracks(record, config)]
    waypoint = rows @ np.array(config.waypoint)
    panel.clear()
    for point, radius in obstacles(record):
        panel.disc(rows @ point, radius * panel.scale, style.SAND)
    ellipses = [[panel.ellipse(at, P, n) for at, P, _ in found] for n in (3.0, 1.0)]
    for shapes, colour in zip(ellipses, (style.PALE_BLUE, style.MIDDLE_BLUE), strict=True):
        for shape in shapes:
            panel.fill(shape, colour)
    panel.grid()
    for point, radius in obstacles(record):
        panel.disc(rows @ point, radius * panel.scale, style.VERMILLION, 1)
        panel.disc(rows @ point, 3.5, style.VERMILLION)
    for shape in (*ellipses[0], *ellipses[1]):
        panel.line(shape, style.BLUE, 1, closed=True)
    for at, _, radius in found:
        panel.disc(at, radius * panel.scale, style.BLUE, 1)
        panel.reticle(at, style.BLUE, 1)
    panel.path(path @ rows.T, style.GREY)
    panel.disc(waypoint, max(config.success_radius * panel.scale, 4.0), style.GREEN, 2)
    tau = ARROW_TIME * config.waypoint[0] / config.velocity[0]
    panel.arrow(vehicle, tau * velocity, style.INK)
    panel.arrow(vehicle, tau**2 / 2 * (rows @ record["a_V_N"]), style.GREEN)
    panel.dart(vehicle, velocity, style.INK)
    panel.pointer(vehicle, style.INK)
    panel.border()


def obstacles(record: np.void) -> list[tuple[Points, float]]:
    """True centres (3,) and radii of the safety spheres, m."""
    n = int(record["count"])
    return [(record["r_O_N"][i], float(record["radius"][i])) for i in range(n)]


def draw_camera(image: Image, record: np.void, config: AvoidanceConfig) -> None:
    """Draw what the camera sees: safety spheres, what was measured, and what was expected."""
    shown = min(config.half_width, WIDEST)
    panel = Panel(image, *CAMERA, (0.0, 0.0), CAMERA[2] / 2 / shown)
    pixels, C = image_points(record, config), np.empty((3, 3))
    attitude(record["q_V"], C)
    panel.clear(style.WHITE if len(pixels) else style.GRID)
    if config.observation == "pixels":
        show_picture(panel, record, config, config.frame)
        close_camera(panel, True, f"±{math.degrees(math.atan(shown)):.0f}°")
        return
    if config.perception == "images":
        show_picture(panel, record, config, config.picture)
    for r, P, _ in tracks(record, config):
        if rotate(C, r)[0] > config.min_range:
            point, spread = predicted_point(C, r, P, config.min_range)
            if config.perception == "points":
                panel.fill(panel.ellipse(point, spread, 3.0), style.PALE_BLUE)
                panel.fill(panel.ellipse(point, spread, 1.0), style.MIDDLE_BLUE)
            panel.reticle(point, style.BLUE, 1)
    for point, radius in obstacles(record):
        depth, y, z = project(C, point - record["r_V_N"], config.min_range)
        if depth > config.min_range:
            panel.disc((y, -z), radius / depth * panel.scale, style.VERMILLION, 1)
            panel.disc((y, -z), 2.5, style.VERMILLION)
    if config.dynamics == "quadrotor":
        draw_horizon(panel, C)
    for pixel in pixels:
        panel.cross(pixel, style.INK)
        panel.pointer(pixel, style.INK)
    close_camera(panel, len(pixels) > 0, f"±{math.degrees(math.atan(shown)):.0f}°")


def draw_horizon(panel: Panel, C: Points) -> None:
    """Draw where a tilted camera C_CN sees the horizon, (1, y, z) C d = 0, and write the tilt."""
    ahead, normal = C[0, 2], C[1:, 2] * (1.0, -1.0)  # d is down in N; (right, up)
    square = float(normal @ normal)
    if square > 1e-6:
        along = np.array([-normal[1], normal[0]]) / math.sqrt(square)
        reach = 2.0 * panel.width / panel.scale
        middle = -ahead / square * normal
        panel.line([middle - reach * along, middle + reach * along], style.GREEN, 1)
    tilt = f"tilt {math.degrees(math.acos(min(max(C[2, 2], -1.0), 1.0))):.0f}°"
    style.write(panel.view, tilt, (5, panel.height - 7), 12, style.GREY)


def show_picture(panel: Panel, record: np.void, config: AvoidanceConfig, side: int) -> None:
    """Draw the picture that the detector or the policy read, so many pixels wide."""
    from visenvs.envs._avoidance_images import picture

    half = config.half_width * np.ones(2)
    panel.show(picture(record, to_record(config)[0], side), -half, half)


def image_points(record: np.void, config: AvoidanceConfig) -> Points:
    """What the last image gave, as (right, up) in focal lengths, shape (n, 2)."""
    found: Points = record["sightings"][: int(np.nan_to_num(record["sighted"]))] * (1.0, -1.0)
    if config.sensor == "image":
        return found
    theta, phi = found.T
    return np.stack([np.tan(theta), np.tan(phi) / np.cos(theta)], axis=1)


def draw_status(image: Image, record: np.void, config: AvoidanceConfig) -> None:
    """Write time to go, the nearest approach, cost and the end of the episode."""
    separation = float(record["min_separation"])
    inside = separation < 1.0 - config.margin
    rows = (
        ("time to go", f"{max(float(record['t_go']), 0.0):.1f} s", style.INK),
        (
            "closest approach",
            f"{figures(separation)} radii",
            style.VERMILLION if inside else style.INK,
        ),
        ("obstacles tracked", f"{len(tracks(record, config))}", style.BLUE),
        ("cost so far", f"{figures(float(record['total_cost']))} m²/s³", style.INK),
    )
    draw_figures(image, rows, record, config.waypoint[0] / config.velocity[0], STATUS)


def mark_waypoint(icon: Panel) -> None:
    """A waypoint, for the legend."""
    icon.disc((5.0, 0.0), 4.5, style.GREEN, 2)


def mark_sphere(icon: Panel) -> None:
    """A safety sphere, for the legend."""
    icon.disc((2.0, 0.0), 9.0, style.SAND)
    icon.disc((2.0, 0.0), 9.0, style.VERMILLION, 1)
    icon.disc((2.0, 0.0), 3.0, style.VERMILLION)
