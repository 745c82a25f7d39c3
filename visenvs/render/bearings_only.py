"""The picture of a bearings-only episode: seen from above, with the estimate's ellipses."""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from visenvs.core.lanes import Task
from visenvs.envs.bearings_only import BearingsOnlyConfig
from visenvs.render import legend, style
from visenvs.render.canvas import Panel, Points
from visenvs.render.scene import ARROW_TIME, draw_figures, draw_marks, figures, first_record, paper
from visenvs.render.style import Image

TOP_VIEW = (60, 66, 690, 440)  # left, top, width, height of the plot, pixels
STATUS = (774, 66, 170, 440)

MARGIN = 0.15  # around both paths, in lengths of the window
REACH = 1.5  # length of the measured bearing's line, estimated ranges


def draw(
    record: np.void, config: BearingsOnlyConfig, task: Task, trail: NDArray[Any] | None = None
) -> Image:
    """Draw one lane record, RGB, shape (540, 960, 3).

    The window stays the same throughout an episode: it follows from the record's seed and episode.

    Args:
        record: lane record of the task.
        config: its configuration.
        task: its card, which finds the start of the episode again.
        trail: earlier records of the episode, shape (n,), for the paths flown; None for no paths.
    """
    image = background().copy()
    panel = window(image, record, config, task)
    past = np.zeros(0, task.lane) if trail is None else np.append(trail, record)
    with np.errstate(invalid="ignore", over="ignore"):  # the last record of a diverged lane
        draw_plane(panel, record, config, past)
        draw_status(image, record, config)
    panel.labels("east (m)", "north (m)")
    return image


@cache
def background() -> Image:
    """What no record changes: headings and legend."""
    image = paper("Bearings only", {"Top view": TOP_VIEW})
    legend.draw(
        image,
        (230, "observer", legend.vehicle),
        (330, "velocity", legend.velocity),
        (420, "target", legend.target),
        (500, "estimate, 1σ 3σ", legend.estimate),
        (640, "estimated velocity", mark_estimated_velocity),
        (800, "bearing", mark_bearing),
    )
    return image


def window(image: Image, record: np.void, config: BearingsOnlyConfig, task: Task) -> Panel:
    """Top view of the start, the first estimate, and the target's whole way, with a margin."""
    first = first_record(record, config, task)
    target = first["r_TV_N"]
    final = target + config.t_f * first["v_T_N"]
    points = np.array([np.zeros(2), first["rhat_TV_N"], target, final])[:, ::-1]
    low, high = points.min(axis=0), points.max(axis=0)
    margin = MARGIN * float(np.max(high - low))
    room = np.array(TOP_VIEW[2:])
    scale = float(np.min(room / (high - low + 2 * margin)))
    centre = (float(low[0] + high[0]) / 2, float(low[1] + high[1]) / 2)
    return Panel(image, *TOP_VIEW, centre, scale)


def draw_plane(
    panel: Panel, record: np.void, config: BearingsOnlyConfig, past: NDArray[Any]
) -> None:
    """Draw observer, target, estimate and last bearing in (east, north)."""
    observer = record["r_V_N"][::-1]
    target = observer + record["r_TV_N"][::-1]
    estimate = observer + record["rhat_TV_N"][::-1]
    covariance = record["P"][1::-1, 1::-1]
    wide, narrow = (panel.ellipse(estimate, covariance, n) for n in (3.0, 1.0))
    tau = ARROW_TIME * config.t_f
    panel.clear()
    panel.fill(wide, style.PALE_BLUE)
    panel.fill(narrow, style.MIDDLE_BLUE)
    panel.grid()
    panel.line(wide, style.BLUE, 1, closed=True)
    panel.line(narrow, style.BLUE, 1, closed=True)
    if record["seen"]:
        panel.line(sight(record), style.DARK_SAND, 2)
    panel.path(past["r_V_N"][:, ::-1], style.GREY)
    panel.path((past["r_V_N"] + past["r_TV_N"])[:, ::-1], style.VERMILLION)
    panel.arrow(observer, tau * record["v_V_N"][::-1], style.INK)
    panel.arrow(estimate, tau * record["vhat_T_N"][::-1], style.BLUE)
    panel.dart(observer, record["v_V_N"][::-1], style.INK)
    draw_marks(panel, observer, target, estimate, config.success_radius)


def sight(record: np.void) -> Points:
    """Ends (east, north) of the line along which the last bearing saw the target, shape (2, 2)."""
    angle, observer = float(record["bearing"][0]), record["r_V_N"][::-1]
    ahead = np.array([np.sin(angle), np.cos(angle)])
    return np.array([observer, observer + REACH * float(record["range_hat"]) * ahead])


def draw_status(image: Image, record: np.void, config: BearingsOnlyConfig) -> None:
    """Write time to go, estimate, error, cost and how the episode ended."""
    rhat = record["rhat_TV_N"]
    along = rhat / max(float(np.linalg.norm(rhat)), 1e-12)
    sigma = math.sqrt(max(float(along @ record["P"][:2, :2] @ along), 0.0))
    error = float(np.linalg.norm(rhat - record["r_TV_N"]))
    rows = (
        ("time to go", f"{record['t_go']:.0f} s", style.INK),
        ("estimated range", f"{figures(float(record['range_hat']))} m", style.BLUE),
        ("its standard deviation", f"{figures(sigma)} m", style.BLUE),
        ("position error", f"{figures(error)} m", style.VERMILLION),
        ("Mahalanobis distance", figures(float(record["mahalanobis"])), style.VERMILLION),
        ("cost so far", figures(float(record["total_cost"])), style.INK),
    )
    draw_figures(image, rows, record, config.t_f, STATUS)


def mark_estimated_velocity(icon: Panel) -> None:
    """An estimated velocity to the right, for the legend."""
    icon.arrow((-11.0, 0.0), (22.0, 0.0), style.BLUE)


def mark_bearing(icon: Panel) -> None:
    """A measured bearing, for the legend."""
    icon.line(np.array([[-10.0, -6.0], [10.0, 6.0]]), style.DARK_SAND, 2)
