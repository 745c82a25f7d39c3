"""Template matching of ground robots (IARC, normalised correlation): where they are and head.

The paper gives no figures. Scenes as in `iarc-fig3`; robots whole in the picture, the colour of
their plates known, predicted to 4 px and, but for `sixteen`, to 0.1 rad (standard deviations).
`one` heading is tried, `three` as by a track that is sure of it, or all round the circle (sixteen).
A match more than 8 px off is an outlier, a heading more than 90 deg off a flip; the errors are of
what is left.
"""

from __future__ import annotations

import math

import numpy as np

from visenvs.core.frames import wrap_angle
from visenvs.sensors.images.ground_robots import COARSE, FINE, View
from visenvs.sensors.images.scenes import OPTICS, draw_scene
from visenvs.sensors.images.templates import detect

from . import Row
from ._avoidance import mean
from ._pictures import Values, rms
from .iarc_fig3 import CAMERAS, FIRST_SEED, FLOOR, ROBOTS, error, whole_robots

CASE = "ncc"
OFF, TURN, GATE = 4.0, 0.1, 14.0  # deviations of the prediction, px and rad; px searched around it
OUTLIER, FLIP = 8.0, 0.5 * math.pi  # px, rad
HEADINGS = {"one": np.zeros(1), "three": FINE, "sixteen": COARSE}
CENTRE = {"nadir": 0.70, "tilted": 0.87}  # at most, px
OUTLIERS = {
    "nadir": {"one": 0.088, "three": 0.088, "sixteen": 0.13},
    "tilted": {"one": 0.16, "three": 0.16, "sixteen": 0.22},
}
HEADING = {"nadir": (6.4, 0.11), "tilted": (7.5, 0.22)}  # median error, deg, and flips of sixteen


def rows(episodes: int) -> list[Row]:
    """Registered share, outliers, error of the centre (px) and of the heading (deg), flips."""
    out: list[Row] = []
    for camera in CAMERAS:
        for name in HEADINGS:
            found, centres, headings = match(camera, name, episodes)
            at, n = f"{CASE}/{camera}/{name}", len(centres)
            out.append(mean(f"{at}/registered", found))
            far = float(np.mean(centres > OUTLIER))
            out.append(
                Row(f"{at}/outliers", None, far, error(far, n), n, None, OUTLIERS[camera][name])
            )
            near = centres <= OUTLIER
            off = rms(centres[near])
            at_most = CENTRE[camera]
            out.append(Row(f"{at}/centre_rms_px", None, off, 0.0, int(near.sum()), None, at_most))
            if name != "one":
                judged = HEADING[camera] if name == "sixteen" else (None, None)
                out += heading_rows(at, headings[near], *judged)
    return out


def heading_rows(at: str, off: Values, degrees: float | None, flips: float | None) -> list[Row]:
    """Median error of the headings that are not flipped, and how many are; off in rad."""
    flipped = off > FLIP
    share, n = float(np.mean(flipped)), len(off)
    middle = float(np.degrees(np.median(off[~flipped])))
    return [
        Row(f"{at}/heading_median_deg", None, middle, 0.0, int((~flipped).sum()), None, degrees),
        Row(f"{at}/flips", None, share, error(share, n), n, None, flips),
    ]


def match(camera: str, name: str, scenes: int) -> tuple[Values, Values, Values]:
    """Which robots were registered; of these, errors of the centre (px) and the heading (rad)."""
    found: list[bool] = []
    centres: list[float] = []
    headings: list[float] = []
    for k in range(scenes):
        rng = np.random.default_rng(k)
        scene = draw_scene(FIRST_SEED + k, CAMERAS[camera], ROBOTS, floor=FLOOR)
        view = View(scene.image, OPTICS, scene.C, scene.r_V_N)
        pixels, _, whole = whole_robots(scene)
        for robot, pixel, seen in zip(scene.robots, pixels, whole, strict=True):
            place = view.place(pixel + rng.normal(0.0, OFF, 2)).tolist()
            off = rng.normal(0.0, TURN) if name != "sixteen" else rng.uniform(-math.pi, math.pi)
            tried = float(robot["heading"]) + off + HEADINGS[name]
            if not seen:
                continue
            plate = int(robot["plate"])
            got = detect(
                scene.image, OPTICS, scene.C, scene.r_V_N, place, tried.tolist(), plate, GATE
            )
            found.append(got is not None)
            if got is not None:
                centres.append(float(np.hypot(*(pixel - got.pixel))))
                headings.append(abs(wrap_angle(got.heading - float(robot["heading"]))))
    return np.array(found), np.array(centres), np.array(headings)
