"""What pictures share: the paper, the scene of one vehicle and one target, and the status."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from visenvs.core.config import to_record
from visenvs.core.lanes import Task
from visenvs.core.outcome import Outcome
from visenvs.core.pinhole import jacobian, project
from visenvs.render import style
from visenvs.render.canvas import Panel, Points
from visenvs.render.style import Image, head, write

Box = tuple[int, int, int, int]  # left, top, width, height, pixels

WIDTH, HEIGHT = 960, 540
ARROW_TIME = 0.1  # arrows show the displacement in this fraction of the episode

ENDINGS = {
    Outcome.SUCCESS: ("success", style.GREEN),
    Outcome.MISS: ("miss", style.VERMILLION),
    Outcome.COLLISION: ("collision", style.VERMILLION),
    Outcome.LOST: ("leader lost", style.VERMILLION),
    Outcome.TIME_LIMIT: ("time limit", style.VERMILLION),
    Outcome.DIVERGED: ("diverged", style.VERMILLION),
}


def paper(title: str, plots: Mapping[str, Box]) -> Image:
    """A sheet with its title and the headings of its plots, RGB, shape (HEIGHT, WIDTH, 3)."""
    image = np.empty((HEIGHT, WIDTH, 3), np.uint8)
    style.paint(image, style.PAPER)
    head(image, title, (16, 29), 19)
    for name, (left, top, _, _) in plots.items():
        head(image, name, (left, top - 8))
    return image


def predicted_point(C: Points, r: Points, P: Points, nearest: float) -> tuple[Points, Points]:
    """Image point of an estimate, (right, up), and its covariance H P H' (2, 2), focal lengths."""
    H = np.zeros((2, 3))
    X, y, z = project(C, r, nearest)
    jacobian(C, X, y, z, H)
    H[1] = -H[1]
    return np.array([y, -z]), H @ P @ H.T


def close_camera(panel: Panel, seen: bool, half_width: str) -> None:
    """Write the half width of a camera picture, and draw its border: another one if it is empty."""
    write(panel.view, half_width, (panel.width - 5, panel.height - 7), 12, style.GREY, "right")
    if not seen:
        write(panel.view, "no detection", (panel.width / 2, 22), 13, style.VERMILLION, "middle")
    panel.border(style.FRAME if seen else style.VERMILLION)


def first_record(record: np.void, config: Any, task: Task) -> np.void:
    """The record at the start of an episode, from any record of it."""
    first = np.zeros(1, task.lane)
    first["seed"], first["episode"] = record["seed"], record["episode"]
    task.reset_lanes(first, to_record(config))
    return first[0]


def draw_plane(
    panel: Panel, rows: Points, record: np.void, config: Any, path: Points, wedge: Points
) -> None:
    """Draw vehicle, target, estimate and the path flown in a plane.

    Args:
        panel: where.
        rows: maps N to (right, up), shape (2, D).
        record: lane record with r_V_N, r_T_N, v_V_N, a_V_N, rhat_TV_N, P.
        config: configuration with t_f and success_radius.
        path: positions flown in N, shape (n, D).
        wedge: outline of the field of view (right, up); empty for none.
    """
    vehicle, target = rows @ record["r_V_N"], rows @ record["r_T_N"]
    estimate = vehicle + rows @ record["rhat_TV_N"]
    velocity, acceleration = rows @ record["v_V_N"], rows @ record["a_V_N"]
    wide, narrow = (panel.ellipse(estimate, rows @ record["P"] @ rows.T, n) for n in (3.0, 1.0))
    tau = ARROW_TIME * config.t_f
    panel.clear()
    panel.fill(wedge, style.SAND)
    panel.fill(wide, style.PALE_BLUE)
    panel.fill(narrow, style.MIDDLE_BLUE)
    panel.grid()
    panel.line(wedge, style.DARK_SAND, 1, closed=True)
    panel.line(wide, style.BLUE, 1, closed=True)
    panel.line(narrow, style.BLUE, 1, closed=True)
    panel.path(path @ rows.T, style.GREY)
    panel.arrow(vehicle, tau * velocity, style.INK)
    panel.arrow(vehicle, tau**2 / 2 * acceleration, style.GREEN)
    panel.dart(vehicle, velocity, style.INK)
    draw_marks(panel, vehicle, target, estimate, config.success_radius)


def draw_marks(
    panel: Panel, vehicle: Points, target: Points, estimate: Points, radius: float
) -> None:
    """Draw target, its circle of success (m) and the estimate; point at what lies outside."""
    panel.disc(target, radius * panel.scale, style.VERMILLION, 1)
    panel.disc(target, 5.5, style.WHITE)
    panel.disc(target, 4.5, style.VERMILLION)
    panel.reticle(estimate, style.BLUE)
    panel.pointer(vehicle, style.INK)
    panel.pointer(target, style.VERMILLION)
    panel.pointer(estimate, style.BLUE)
    panel.border()


def draw_status(image: Image, record: np.void, config: Any, box: Box) -> None:
    """Write time to go, ranges, cost and the end of the episode."""
    rhat = record["rhat_TV_N"]
    distance = float(np.linalg.norm(rhat))
    sight = rhat / max(distance, 1e-12)
    sigma = math.sqrt(max(float(sight @ record["P"] @ sight), 0.0))
    true_range = float(np.linalg.norm(record["r_TV_N"]))
    rows = (
        ("time to go", f"{record['t_go']:.1f} s", style.INK),
        ("estimated range", f"{figures(distance)} ± {figures(sigma)} m", style.BLUE),
        ("true range", f"{figures(true_range)} m", style.VERMILLION),
        ("cost so far", f"{figures(float(record['total_cost']))} m²/s³", style.INK),
    )
    draw_figures(image, rows, record, config.t_f, box)


def draw_figures(
    image: Image, rows: tuple[tuple[str, str, Any], ...], record: np.void, whole: float, box: Box
) -> None:
    """Write rows of (name, text, colour) and the end of the episode.

    The first row gets a bar: the time to go as a share of the `whole` time (s).
    """
    left, top, width, height = box
    for line, (name, value, colour) in enumerate(rows):
        y = top + 12 + 46 * line
        write(image, name, (left, y), 13, style.GREY)
        write(image, value, (left, y + 21), 19, colour)
    bar = Panel(image, left + 80, top + 22, width - 80, 5)
    bar.clear(style.GRID)
    share = min(max(float(np.nan_to_num(record["t_go"])) / whole, 0.0), 1.0)
    style.paint(bar.view[:, : round(bar.width * share)], style.INK)
    write(image, f"seed {record['seed']}", (left, top + 12 + 46 * len(rows)), 13, style.GREY)
    outcome = Outcome(int(record["outcome"]))
    if outcome in ENDINGS:
        name, colour = ENDINGS[outcome]
        chip = Panel(image, left, top + height - 30, width, 30)
        chip.clear(colour)
        text = name
        named = record.dtype.names or ()
        if outcome in (Outcome.SUCCESS, Outcome.MISS) and "miss_distance" in named:
            text = f"{name}: {figures(float(record['miss_distance']))} m off"
        write(image, text, (left + 10, chip.top + 20), 15, style.WHITE)


def figures(value: float) -> str:
    """A number for display: two decimals below ten, one below a thousand; "?" if not finite."""
    if not math.isfinite(value):
        return "?"
    size = abs(value)
    if size >= 1e6:
        return f"{value:.2e}"
    return f"{value:,.{2 if size < 10 else 1 if size < 1000 else 0}f}"
