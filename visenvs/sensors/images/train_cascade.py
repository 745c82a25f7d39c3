"""Trains the cascade of ground robots that ships: `python -m visenvs.sensors.images.train_cascade`.

500 windows with a robot and 600 pictures without one, all drawn: nadir and tilted cameras at 1 to
3.2 m, both plates, every heading, and clutter. Writes robot.xml and its card.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from visenvs.core.provenance import provenance
from visenvs.sensors.images.boosting import Patches, Recipe, train, windows_of
from visenvs.sensors.images.cascade_file import SHIPPED, to_xml
from visenvs.sensors.images.haar import SIDE, STEP, Cascade, scan
from visenvs.sensors.images.optics import Image
from visenvs.sensors.images.scenes import NADIR, TILTED, Draws, draw_scene

PROGRAM = "visenvs.sensors.images.train_cascade"
FOLDER = Path(__file__).with_name("cascades")
POSITIVES, NEGATIVES, MINED = 500, 600, 1000
SIZES = (20.0, 110.0)  # of windows that negatives are mined in, pixels
LOOKS = 5  # sizes a picture at every stage
NOTHING = np.zeros(3)


def positives(count: int, seed: int = 1) -> Patches:
    """Windows with a robot in the middle, off by up to 3 % and 7 % too large or small."""
    out: list[Image] = []
    k = 0
    while len(out) < count:
        draws, k = Draws(seed, 1000 + k), k + 1
        scene = draw_scene(seed * 100_000 + k, NADIR if k % 2 else TILTED, 1)
        (pixel,), (size,) = scene.tops()
        size *= draws.between(0.93, 1.07)
        scale = SIDE / size
        height, width = scene.image.shape
        shape = round(width * scale), round(height * scale)
        small = _resized(scene.image, shape)
        x, y = (
            round((p + 0.5 + size * draws.between(-0.03, 0.03)) * s / n - SIDE / 2)
            for p, s, n in zip(pixel, shape, (width, height), strict=True)
        )
        if 0 <= x <= shape[0] - SIDE and 0 <= y <= shape[1] - SIDE:
            out.append(small[y : y + SIDE, x : x + SIDE])
    return np.array(out)


class Mine:
    """Pictures without a robot, and the windows in them that a cascade still takes for one.

    Args:
        pictures, windows: how many there are, and how many windows are wanted of them.
    """

    def __init__(self, pictures: int, windows: int, seed: int = 2) -> None:
        self._windows, self._seed, self._turn = windows, seed, 0
        self._frames = [
            draw_scene(seed * 100_000 + k, NADIR if k % 2 else TILTED, 0, clutter=6).image
            for k in range(pictures)
        ]

    def __call__(self, cascade: Cascade) -> Patches:
        """Windows that pass, from all pictures alike."""
        self._turn += 1
        draws, share = Draws(self._seed, self._turn), 3 * self._windows // len(self._frames) + 1
        found: list[Patches] = []
        for frame in self._frames:
            for _ in range(LOOKS):
                size = float(np.exp(draws.between(*np.log(SIZES))))
                found.append(_hits(frame, cascade, size, draws, share))
        windows = np.concatenate(found)
        picked = np.linspace(0, len(windows) - 1, min(self._windows, len(windows))).astype(int)
        return windows[picked]


def _hits(frame: Image, cascade: Cascade, size: float, draws: Draws, most: int) -> Patches:
    """At most so many windows of one size that pass, drawn from all that do."""
    height, width = frame.shape
    small = _resized(frame, (round(width * SIDE / size), round(height * SIDE / size)))
    if min(small.shape) <= SIDE:
        return np.empty((0, SIDE, SIDE), np.uint8)
    sums, squares = cv2.integral2(small, sdepth=cv2.CV_32S, sqdepth=cv2.CV_64F)
    hits = np.empty((20_000, 3))
    middle = np.array([0.5 - SIDE / 2, 0.5 - SIDE / 2, 1.0, 1.0])  # so that u, v are x, y
    count = scan(sums, squares, cascade.parts, STEP, NOTHING, size, middle, hits)
    picked = {draws.whole(count) for _ in range(most)} if count else set[int]()
    places: NDArray[np.int64] = np.rint(hits[sorted(picked), :2]).astype(np.int64)
    return windows_of(small, places.reshape(-1, 2))


def _resized(frame: Image, shape: tuple[int, int]) -> Image:
    mode = cv2.INTER_AREA if shape[0] < frame.shape[1] else cv2.INTER_LINEAR
    return np.asarray(cv2.resize(frame, shape, interpolation=mode), np.uint8)


def main(arguments: list[str] | None = None) -> None:
    """Train, and write the cascade and its card."""
    parser = argparse.ArgumentParser(prog=f"python -m {PROGRAM}", description=__doc__)
    parser.add_argument("--out", type=Path, default=FOLDER, help="folder for the two files")
    parser.add_argument("--positives", type=int, default=POSITIVES)
    parser.add_argument("--negatives", type=int, default=NEGATIVES, help="pictures")
    parser.add_argument("--stages", type=int, default=Recipe.stages)
    chosen = parser.parse_args(arguments)
    began, recipe = time.process_time(), Recipe(stages=chosen.stages)
    mine = Mine(chosen.negatives, MINED)
    cascade = train(positives(chosen.positives), mine, recipe, print)
    seconds = time.process_time() - began
    chosen.out.mkdir(parents=True, exist_ok=True)
    (chosen.out / SHIPPED).write_text(to_xml(cascade), encoding="utf-8")
    card = {
        "what": "Haar cascade of the arena's ground robots, 24 by 24 windows, OpenCV's format",
        "algorithm": "Gentle AdaBoost on stumps, negatives mined at every stage",
        "data": f"{chosen.positives} windows and {chosen.negatives} pictures, all rendered",
        "stages": len(cascade.ends),
        "stumps": len(cascade.thresholds),
        "cpu_seconds": round(seconds, 1),
        "command": " ".join([f"python -m {PROGRAM}", *(arguments or sys.argv[1:])]),
        "meta": provenance(PROGRAM),
    }
    (chosen.out / "card.json").write_text(json.dumps(card, indent=2) + "\n", encoding="utf-8")
    print(f"{card['stages']} stages, {card['stumps']} stumps, {seconds:.0f} s of CPU time")


if __name__ == "__main__":
    main()
