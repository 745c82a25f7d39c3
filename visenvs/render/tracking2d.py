"""The picture of tracking in a plane: seen from above, what the belief says of range, one image."""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from visenvs.core.lanes import Task
from visenvs.envs.tracking2d import Tracking2DConfig
from visenvs.render import legend, style
from visenvs.render.canvas import NOTHING, Panel, Points
from visenvs.render.scene import close_camera, draw_plane, draw_status, first_record, paper
from visenvs.render.style import Image

TOP_VIEW = (44, 66, 708, 300)  # left, top, width, height of the plot, pixels
RANGE = (44, 414, 708, 90)
CAMERA = (774, 66, 170, 90)
STATUS = (774, 256, 170, 250)

SEEN_FROM_ABOVE = np.array([[1.0, 0.0], [0.0, -1.0]])  # x to the right, y down
MARGIN = 0.12  # around start, target and estimate, in distances between start and target
SIGMAS = 4.0  # of the image point's noise and prediction to each side of the camera picture


def draw(
    record: np.void, config: Tracking2DConfig, task: Task, trail: NDArray[Any] | None = None
) -> Image:
    """Draw one lane record, RGB, shape (540, 960, 3).

    The window stays the same throughout an episode: it follows from the record's seed and episode.

    Args:
        record: lane record of the tracking task.
        config: its configuration.
        task: its card, which finds the start of the episode again.
        trail: earlier records of the episode, shape (n,), for the path flown; None for no path.
    """
    image = background().copy()
    first = first_record(record, config, task)
    top = window(image, first)
    path = np.zeros((0, 2)) if trail is None else np.vstack([trail["r_V_N"], record["r_V_N"]])
    with np.errstate(invalid="ignore", over="ignore"):  # the last record of a diverged lane
        draw_plane(top, SEEN_FROM_ABOVE, record, config, path, NOTHING)
        draw_range(
            Panel(image, *RANGE, (top.centre[0], RANGE[3] / 2 / top.scale), top.scale), record
        )
        draw_camera(image, record, config)
        draw_status(image, record, config, STATUS)
    top.labels("along the optical axis (m)", "to the left (m)")
    return image


@cache
def background() -> Image:
    """What no record changes: headings and legend."""
    belief = "Where the belief puts the target along the axis"
    image = paper("Tracking 2-D", {"Top view": TOP_VIEW, belief: RANGE, "Camera": CAMERA})
    legend.draw(
        image,
        (196, "vehicle", legend.vehicle),
        (284, "velocity", legend.velocity),
        (374, "acceleration", legend.acceleration),
        (492, "target", legend.target),
        (572, "estimate, 1σ 3σ", legend.estimate),
        (720, "image point", legend.measured),
    )
    return image


def window(image: Image, first: np.void) -> Panel:
    """Top view: start, target and first estimate with a margin about them."""
    points = np.array([np.zeros(2), first["r_T_N"], first["rhat_TV_N"]]) @ SEEN_FROM_ABOVE.T
    margin = MARGIN * float(np.linalg.norm(points[1]))
    low, high = points.min(axis=0) - margin, points.max(axis=0) + margin
    scale = float(np.min(np.array(TOP_VIEW[2:]) / (high - low)))
    middle = (low + high) / 2
    return Panel(image, *TOP_VIEW, (float(middle[0]), float(middle[1])), scale)


def draw_range(panel: Panel, record: np.void) -> None:
    """Draw the density of the target's abscissa (a normal one), the estimate and the truth."""
    estimate = float(record["r_V_N"][0] + record["rhat_TV_N"][0])
    sigma = max(math.sqrt(max(float(record["P"][0, 0]), 0.0)), 1.0 / panel.scale)
    top = 0.85 * panel.height / panel.scale
    offsets = np.linspace(-4.0, 4.0, 97)
    density = np.stack([estimate + sigma * offsets, top * np.exp(-0.5 * offsets**2)], axis=1)
    panel.clear()
    panel.fill(density, style.PALE_BLUE)
    panel.line(density, style.BLUE, 1)
    height = panel.height / panel.scale
    for x, colour in (
        (estimate, style.BLUE),
        (float(record["r_T_N"][0]), style.VERMILLION),
        (float(record["r_V_N"][0]), style.INK),
    ):
        panel.line([(x, 0.0), (x, height)], colour, 2)
    panel.border()


def draw_camera(image: Image, record: np.void, config: Tracking2DConfig) -> None:
    """Draw the line that is the image: the target, what was measured, where it was expected.

    The picture is so wide that the noise and the prediction fit in.
    """
    X, seen = max(float(record["rhat_TV_N"][0]), config.min_range), bool(record["seen"])
    expected = float(record["rhat_TV_N"][1]) / X
    slope = np.array([-expected, 1.0]) / X
    sigma = math.sqrt(max(float(slope @ record["P"] @ slope), 0.0))
    noise = math.hypot(config.sigma_range / X, config.sigma_angle)
    shown = abs(expected) + SIGMAS * math.hypot(sigma, noise)
    shown = shown if 0.0 < shown < math.inf else 1.0
    panel = Panel(image, *CAMERA, (0.0, 0.0), CAMERA[2] / 2 / shown)
    depth, across = record["r_TV_N"]
    panel.clear(style.WHITE if seen else style.GRID)
    for n, colour in ((3.0, style.PALE_BLUE), (1.0, style.MIDDLE_BLUE)):
        panel.fill(strip(expected, n * sigma, 20.0 / panel.scale), colour)
    panel.line([(-shown, 0.0), (shown, 0.0)], style.FRAME)
    if depth > config.min_range:
        panel.disc((across / depth, 0.0), 4.5, style.VERMILLION)
    panel.reticle((expected, 0.0), style.BLUE, 1)
    if seen:
        panel.cross((record["pixel"], 0.0), style.INK)
        panel.pointer((record["pixel"], 0.0), style.INK)
    close_camera(panel, seen, f"±{shown:.2g}")


def strip(middle: float, half: float, height: float) -> Points:
    """Corners of an upright strip about a point of the axis, shape (4, 2)."""
    low, high = middle - half, middle + half
    return np.array([(low, -height), (high, -height), (high, height), (low, height)])
