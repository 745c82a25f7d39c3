"""The picture of a mapping episode: truth and map in space, and what the camera sees."""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from visenvs.core.lanes import Task
from visenvs.envs._mapping_config import SIDE, MappingConfig
from visenvs.render import style
from visenvs.render.canvas import NOTHING, Panel, Points
from visenvs.render.scene import draw_figures, figures, paper
from visenvs.render.style import Image, write

SPACE = (16, 66, 620, 458)  # left, top, width, height of the plot, pixels
CAMERA = (654, 66, 290, 290)
STATUS = (654, 372, 290, 152)

AZIMUTH, ELEVATION = math.radians(25.0), math.radians(38.0)  # of the view
ROUND = np.array(
    [  # maps N to (right, up)
        [-math.sin(AZIMUTH), math.cos(AZIMUTH), 0.0],
        [
            math.cos(AZIMUTH) * math.sin(ELEVATION),
            math.sin(AZIMUTH) * math.sin(ELEVATION),
            -math.cos(ELEVATION),
        ],
    ]
)
MARGIN = 1.08  # of the window about the area and the aircraft above it
NEAREST = 0.2  # depth at which lines are cut off in the camera's picture, m


def draw(
    record: np.void, config: MappingConfig, task: Task, trail: NDArray[Any] | None = None
) -> Image:
    """Draw one lane record, RGB, shape (540, 960, 3).

    Args:
        record: lane record of the mapping task.
        config: its configuration.
        task: its card.
        trail: earlier records of the episode, shape (n,), for the path flown; None for no path.
    """
    image = background().copy()
    path = np.zeros((0, 3)) if trail is None else np.vstack([trail["r_V_N"], record["r_V_N"]])
    with np.errstate(invalid="ignore", over="ignore", divide="ignore"):  # of a diverged lane
        draw_space(window(image, config), record, config, path)
        draw_camera(image, record, config)
        draw_status(image, record, config)
    return image


@cache
def background() -> Image:
    """What no record changes: headings and legend."""
    image = paper("Mapping", {"Truth and map, seen from the south": SPACE, "Camera": CAMERA})
    draw_legend(image)
    return image


def window(image: Image, config: MappingConfig) -> Panel:
    """The view of the area and of the air above it."""
    a = max(config.area, float(np.max(np.abs(config.start))) * 0.75)
    corners = [(n, e, d) for n in (-a, a) for e in (-a, a) for d in (0.0, -config.altitude)]
    points = np.array(corners) @ ROUND.T
    low, high = points.min(axis=0), points.max(axis=0)
    scale = float(np.min(np.array(SPACE[2:]) / (MARGIN * (high - low))))
    middle = (low + high) / 2.0
    return Panel(image, *SPACE, (float(middle[0]), float(middle[1])), scale)


def draw_space(panel: Panel, record: np.void, config: MappingConfig, path: Points) -> None:
    """Draw covered ground, true edges, lines, the aircraft and what its picture covers."""
    panel.clear()
    for corners in cells(record, config):
        panel.fill(corners @ ROUND.T, style.SAND)
    border = config.area * np.array([(1, 1, 0), (-1, 1, 0), (-1, -1, 0), (1, -1, 0)], float)
    panel.line(border @ ROUND.T, style.DARK_SAND, 1, closed=True)
    for edge in edges(record):
        panel.line(edge @ ROUND.T, style.VERMILLION, 2)
    for line, deviation in lines(record, config):
        panel.line(line @ ROUND.T, style.BLUE if deviation < 1.0 else style.MIDDLE_BLUE, 1)
    place = record["r_V_N"]
    ground = footprint(record, config)
    panel.line(ground @ ROUND.T, style.GREEN, 1, closed=True)
    for corner in ground:
        panel.line(np.array([place, corner]) @ ROUND.T, style.GRID, 1)
    panel.path(path @ ROUND.T, style.GREY)
    panel.line(np.array([place, place * (1.0, 1.0, 0.0)]) @ ROUND.T, style.GREY, 1)
    panel.dart(ROUND @ place, ROUND @ np.append(record["v_V_N"], 0.0), style.INK)
    panel.pointer(ROUND @ place, style.INK)
    panel.border()


def edges(record: np.void) -> Points:
    """True edges, m, N, (n, 2, 3)."""
    return record["edge"][: int(record["edges"])].reshape(-1, 2, 3)


def lines(record: np.void, config: MappingConfig) -> list[tuple[Points, float]]:
    """Ends of the map's lines, m, N, (2, 3), and their deviations over error_scale."""
    m = record["map"]
    out = []
    for j in np.flatnonzero(m["alive"] > 0.0):
        spread = 0.5 * float(np.trace(m["P"][j])) / config.error_scale**2
        out.append((m["x"][j].reshape(2, 3), math.sqrt(spread) if spread > 0.0 else 0.0))
    return out


def cells(record: np.void, config: MappingConfig) -> list[Points]:
    """Corners of the cells that images have shown, m, N, (4, 3)."""
    width, out = 2.0 * config.area / SIDE, []
    for c in np.flatnonzero(record["covered"] > 0.0):
        n, e = c // SIDE * width - config.area, c % SIDE * width - config.area
        corners = [(n, e), (n + width, e), (n + width, e + width), (n, e + width)]
        out.append(np.array([(*corner, 0.0) for corner in corners]))
    return out


def footprint(record: np.void, config: MappingConfig) -> Points:
    """Where the corners of the picture lie on the ground, m, N, (4, 3); empty if not all do."""
    w = config.half_width
    rays = np.array([(1, w, w), (1, -w, w), (1, -w, -w), (1, w, -w)]) @ record["C"]
    place = record["r_V_N"]
    if not (rays[:, 2] > 0.05).all():
        return np.zeros((0, 3))
    return place + rays * (-place[2] / rays[:, 2])[:, None]


def draw_camera(image: Image, record: np.void, config: MappingConfig) -> None:
    """Draw the segments of the last picture over the lines of the map."""
    panel = Panel(image, *CAMERA, (0.0, 0.0), CAMERA[2] / 2 / config.half_width)
    panel.clear()
    for line, _ in lines(record, config):
        panel.line(projected(line, record), style.MIDDLE_BLUE, 3)
    for segment in record["segment"][: int(np.nan_to_num(record["seen"]))]:
        panel.line(segment.reshape(2, 2) * (1.0, -1.0), style.INK, 1)
    angle = f"±{math.degrees(math.atan(config.half_width)):.0f}°"
    write(panel.view, angle, (panel.width - 5, panel.height - 7), 12, style.GREY, "right")
    panel.border()


def projected(line: Points, record: np.void) -> Points:
    """A line (2, 3) in the picture, (right, up), focal lengths, (2, 2); empty behind the camera."""
    q = (line - record["r_V_N"]) @ record["C"].T
    if not np.isfinite(q).all() or q[:, 0].max() <= NEAREST:
        return NOTHING
    if q[:, 0].min() < NEAREST:
        behind = int(q[1, 0] < q[0, 0])
        share = (NEAREST - q[behind, 0]) / (q[1 - behind, 0] - q[behind, 0])
        q[behind] += share * (q[1 - behind] - q[behind])
    return q[:, 1:] / q[:, :1] * (1.0, -1.0)


def draw_status(image: Image, record: np.void, config: MappingConfig) -> None:
    """Write time to go, what the map is worth, cost and the end of the episode."""
    error, cover = float(record["map_error"]), float(record["coverage"])
    rows = (
        ("time to go", f"{record['t_go']:.0f} s", style.INK),
        ("mean error, shown", f"{figures(error * config.error_scale)} m, {cover:.0%}", style.BLUE),
        ("cost so far", figures(float(record["total_cost"])), style.INK),
    )
    draw_figures(image, rows, record, config.t_f, STATUS)


def draw_legend(image: Image) -> None:
    """Name the marks along the top."""
    icons = [Panel(image, left, 12, 26, 24) for left in (130, 224, 326, 392, 490, 614, 706)]
    names = ("aircraft", "true edge", "line", "uncertain", "shown ground", "picture", "segment")
    icons[0].dart((3.0, 0.0), (1.0, 0.0), style.INK)
    ends = np.array([[-10.0, -5.0], [10.0, 5.0]])
    icons[1].line(ends, style.VERMILLION, 2)
    icons[2].line(ends, style.BLUE, 1)
    icons[3].line(ends, style.MIDDLE_BLUE, 1)
    box = np.array([[-10.0, -6.0], [10.0, -6.0], [10.0, 6.0], [-10.0, 6.0]])
    icons[4].fill(box, style.SAND)
    icons[4].line(box, style.DARK_SAND, 1, closed=True)
    icons[5].line(box, style.GREEN, 1, closed=True)
    icons[6].line(ends, style.INK, 1)
    for icon, name in zip(icons, names, strict=True):
        write(image, name, (icon.left + 30, 29), 13, style.GREY)
