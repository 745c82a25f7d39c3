"""An image processor that finds the leader: how often, and the angle that it subtends.

No published figure: the papers show that the processor of their flight tests follows a leader, and
take its errors from there. A wing of 8.75 ft, 60 to 200 ft ahead, roll within 40 deg, aspect within
10 deg, a field of view of 40 deg, predicted to 3 px (standard deviation). A `white` leader before
haze, clouds and ground often is not registered. `red-chan-vese` is the red one segmented by a
contour, on the same pictures; its rows need scikit-image (`pip install 'visenvs[vision]'`).
"""

from __future__ import annotations

import math
from importlib.util import find_spec

import numpy as np

from visenvs.core.units import FOOT
from visenvs.sensors.images.aircraft import SPAN, WING_TIPS, draw_aircraft
from visenvs.sensors.images.leader import LeaderView, Segmenter, detect
from visenvs.sensors.images.optics import Optics
from visenvs.sensors.images.prior import Prior

from . import Row, standard_error
from ._avoidance import mean
from ._pictures import Values, outside, rms, taken, turned

CASE = "leader"
OPTICS = Optics(320, 240, 160.0 / math.tan(math.radians(20.0)))
COLOURS = {"red": (200.0, 60.0, 50.0), "white": (240.0, 240.0, 240.0)}
LOOKS: dict[str, tuple[str, Segmenter]] = {  # colour and segmenter
    "red": ("red", "threshold"),
    "white": ("white", "threshold"),
    "red-chan-vese": ("red", "chan_vese"),
}
RANGES = {
    "60-100ft": (60, 100),
    "100ft": (98, 102),
    "100-150ft": (100, 150),
    "150-200ft": (150, 200),
}
FOUND = {"60-100ft", "100-150ft"}  # where a coloured leader must be
OFF = 3.0  # standard deviation of the prediction, pixels
WRONG = 0.2  # a relative error of the angle that counts as another thing found


def rows(episodes: int) -> list[Row]:
    """Registered share, wrong ones among them, errors of centre (px) and angle (relative)."""
    out: list[Row] = []
    for kind, (colour, segmenter) in LOOKS.items():
        if segmenter == "chan_vese" and find_spec("skimage") is None:
            continue
        for name, (near, far) in RANGES.items():
            paint, red = COLOURS[colour], colour == "red"
            found, errors, centres = look(episodes, paint, near * FOOT, far * FOOT, segmenter)
            at = f"{CASE}/{kind}/{name}"
            least = 0.99 if red and name in FOUND else None
            out.append(mean(f"{at}/registered", found, None, least))
            if not len(errors):
                continue
            wrong = np.abs(errors) > WRONG
            out.append(mean(f"{at}/wrong", wrong))
            right = errors[~wrong]
            if len(right) > 1:
                sd, error = float(right.std()), standard_error(right, np.std)
                most = 0.02 if red and name == "100ft" else None
                out.append(Row(f"{at}/angle_sd", None, sd, error, len(right), None, most))
                out.append(mean(f"{at}/angle_bias", right))
                most = 0.65 if red and name in FOUND else None
                centre = rms(centres[~wrong])
                out.append(Row(f"{at}/centre_rms_px", None, centre, 0.0, len(right), None, most))
    return out


def look(
    count: int,
    paint: tuple[float, float, float],
    near: float,
    far: float,
    segmenter: Segmenter = "threshold",
) -> tuple[Values, ...]:
    """Which pictures were registered (count,); of these, errors of the angle and the centre."""
    found = np.zeros(count, bool)
    errors: list[float] = []
    centres: list[float] = []
    for k in range(count):
        rng = np.random.default_rng(k)
        _, frame, C = outside(rng, OPTICS)
        depth, point = rng.uniform(near, far), rng.uniform((-0.23, -0.16), (0.23, 0.16))
        r = depth * np.array([1.0, *point]) @ C
        yaw, pitch, roll = np.radians(rng.uniform((-10, -9, -40), (10, 11, 40)))
        C_BN = turned(yaw, pitch, roll) @ C
        draw_aircraft(frame, OPTICS, C, r, C_BN, paint)
        guess = point + rng.normal(0.0, OFF, 2) / OPTICS.focal
        deviation = OFF / OPTICS.focal
        prior = Prior((guess[0], guess[1]), (deviation, deviation), 0.5 * SPAN / depth)
        view = detect(taken(frame, k), OPTICS, prior, segmenter)
        if view is not None:
            found[k] = True
            tips = (WING_TIPS @ C_BN + r) @ C.T
            true = [(float(y / x), float(z / x)) for x, y, z in tips]
            truth = LeaderView((0.0, 0.0), true[0], true[1]).subtended
            errors.append(view.subtended / truth - 1.0)
            centres.append(float(np.hypot(*(np.array(view.centre) - point))) * OPTICS.focal)
    return found, np.array(errors), np.array(centres)
