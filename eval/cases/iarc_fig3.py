"""The Haar detector of the IARC paper (figure 3): recall and precision, with its window of sizes.

The paper shows pictures only. 320 by 240 pixels, four robots, balls and boxes, another floor than
the detector was trained on. `depth`: windows of the size that the depth at their place gives;
`altitude`: the printed (7), which is right for a camera that looks straight down; `all`: every
size. `roc` counts more or fewer agreeing windows. Robots that the border cuts are not counted.
"""

from __future__ import annotations

from functools import cache

import numpy as np

from visenvs.sensors.images.cascade_file import shipped_cascade
from visenvs.sensors.images.haar import SizeWindow, floor_sizes, group, raw_hits
from visenvs.sensors.images.scenes import NADIR, OPTICS, TILTED, WINDOW, Scene, draw_scene

from . import Row
from ._pictures import Values, rms

CASE = "iarc-fig3"
FIRST_SEED = 900_000  # training draws 100,001 to 100,999 and 200,000 to 200,599
ROBOTS, FLOOR = 4, 1
CAMERAS = {"nadir": NADIR, "tilted": TILTED}
JUDGED = {"nadir": (0.96, 0.98), "tilted": (0.95, None)}  # recall, precision
ALL_SIZES = (18.0, 115.0)


def rows(episodes: int) -> list[Row]:
    """Recall, precision and error of the centre (px), and recall against precision by votes."""
    out: list[Row] = []
    for camera in CAMERAS:
        for how in ("depth", "altitude", "all"):
            found, false, visible, errors = count(camera, how, 2, episodes)
            least = JUDGED[camera] if how == "depth" else (None, None)
            at = f"{CASE}/{camera}/{how}"
            recall, precision = found / visible, found / max(found + false, 1)
            out.append(Row(f"{at}/recall", None, recall, error(recall, visible), visible, least[0]))
            shown = found + false
            out.append(
                Row(f"{at}/precision", None, precision, error(precision, shown), shown, least[1])
            )
            out.append(Row(f"{at}/centre_rms_px", None, rms(errors), 0.0, len(errors)))
        for how in ("depth", "all"):
            for votes in (1, 3, 5):
                found, false, visible, _ = count(camera, how, votes, episodes)
                at = f"{CASE}/{camera}/roc/{how}/{votes}"
                out.append(Row(f"{at}/recall", None, found / visible, 0.0, visible))
                shown = max(found + false, 1)
                out.append(Row(f"{at}/precision", None, found / shown, 0.0, shown))
    return out


def error(share: float, n: int) -> float:
    """Standard error of a share of n."""
    return float(np.sqrt(share * (1.0 - share) / max(n, 1)))


@cache
def hits(camera: str, how: str, k: int) -> tuple[Scene, Values]:
    """A scene and the raw hits in it."""
    scene = draw_scene(FIRST_SEED + k, CAMERAS[camera], ROBOTS, floor=FLOOR)
    sizes: SizeWindow | tuple[float, float] = ALL_SIZES
    if how == "depth":
        sizes = floor_sizes(OPTICS, scene.C, scene.height, WINDOW)
    elif how == "altitude":
        sizes = SizeWindow(WINDOW * OPTICS.focal / scene.height, 0.0, 0.0)
    return scene, raw_hits(scene.image, shipped_cascade(), sizes)


def whole_robots(scene: Scene) -> tuple[Values, Values, Values]:
    """Pixels (n, 2) and windows' sides (n,) of the robots, and which the border does not cut."""
    pixels, sizes = scene.tops()
    whole = [OPTICS.shows(p[None], 0.42 * s)[0] for p, s in zip(pixels, sizes, strict=True)]
    return pixels, sizes, OPTICS.shows(pixels) & np.array(whole)


def count(camera: str, how: str, votes: int, scenes: int) -> tuple[int, int, int, list[float]]:
    """Robots found, false alarms, robots visible, and errors of the centres, px."""
    found, false, visible = 0, 0, 0
    errors: list[float] = []
    for k in range(scenes):
        scene, raw = hits(camera, how, k)
        pixels, sizes, whole = whole_robots(scene)
        visible += int(whole.sum())
        used: set[int] = set()
        for detection in group(raw, votes):
            gaps = np.hypot(*(pixels - detection.pixel).T)
            i = int(np.argmin(gaps))
            if gaps[i] < 0.3 * sizes[i] + 2.0 and i not in used:
                used.add(i)
                if whole[i]:
                    found += 1
                    errors.append(float(gaps[i]))
            else:
                false += 1
    return found, false, visible, errors
