"""Figure 27 of the thesis (3.5.2): what the image processor finds of red spheres, and the flight.

- `spheres`: still pictures, two spheres of 20 ft radius each, 110 to 2000 ft away, anywhere in the
  picture but not cut by its border and not one before the other.
- `flight`: the flight of figure 30 on rendered pictures at 8 Hz, one obstacle an image. It aims at
  1.05 d as judged there.
"""

from __future__ import annotations

import math

import numpy as np

from visenvs.core.units import FOOT
from visenvs.sensors.images.optics import Optics
from visenvs.sensors.images.spheres import detect

from . import Row
from ._avoidance import fly, mean
from ._pictures import Values, outside, rms, taken

CASE = "fig27"
LAW = "cone-meg-x1.05"
RADIUS, NEAR, FAR = 20 * FOOT, 110 * FOOT, 2000 * FOOT
OPTICS = Optics(320, 240, 277.0)
RED = (200.0, 30.0, 30.0)


def rows(episodes: int) -> list[Row]:
    """Misses, false alarms and errors of still pictures; tracks and separations of the flight."""
    count = 3 * episodes
    shown, missed, false, errors, radii = still_pictures(count)
    at = f"{CASE}/spheres"
    out = [
        Row(f"{at}/misses", None, missed, 0.0, shown, high=0.0),
        Row(f"{at}/false_alarms", None, false, 0.0, count, high=0.0),
        Row(f"{at}/centre_rms_px", None, rms(errors), 0.0, len(errors), high=0.3),
        Row(f"{at}/radius_error_mean", None, float(np.mean(radii)), 0.0, len(radii)),
        Row(f"{at}/radius_error_sd", None, float(np.std(radii)), 0.0, len(radii)),
    ]
    records, at = fly("thesis-3.5.2", LAW, episodes, ("perception", "images")), f"{CASE}/flight"
    made = records["tracks"]["made"]
    out.append(mean(f"{at}/two_tracks", made == 2, 1.0, 0.97))
    second = records["t_made"][made >= 2, 1]
    if len(second):
        out.append(mean(f"{at}/second_track_s", second, 4.6, 4.0, 5.2))
    out.append(mean(f"{at}/wrong_updates", records["tracks"]["wrong"], 0.0))
    for i in range(2):
        out.append(mean(f"{at}/closest_{i + 1}_ft", records["closest"][:, i] / FOOT, 100.0))
    out.append(mean(f"{at}/keeps_d", records["min_separation"] >= 1.0, 1.0, 0.98))
    return out


def still_pictures(count: int) -> tuple[int, int, int, list[float], list[float]]:
    """Spheres shown, missed, false ones, errors of centres (px) and of radii (relative)."""
    shown, missed, false = 0, 0, 0
    errors: list[float] = []
    radii: list[float] = []
    for k in range(count):
        rng = np.random.default_rng(k)
        world, frame, C = outside(rng, OPTICS)
        places = spheres(rng)
        pixels, _ = OPTICS.project(np.eye(3), places)
        angles = np.arcsin(RADIUS / np.linalg.norm(places, axis=1))
        world.balls(frame, OPTICS, C, places @ C, np.full(len(places), RADIUS), RED)
        balls = detect(taken(frame, k), OPTICS)
        shown += len(places)
        for pixel, angle in zip(pixels, angles, strict=True):
            gaps = [float(np.hypot(*(OPTICS.pixels(ball.point) - pixel))) for ball in balls]
            if not gaps or min(gaps) > 5.0:
                missed += 1
                continue
            ball = balls.pop(int(np.argmin(gaps)))
            errors.append(min(gaps))
            radii.append(ball.angle / angle - 1.0)
        false += len(balls)
    return shown, missed, false, errors, radii


def spheres(rng: np.random.Generator) -> Values:
    """Two places in C, m, (2, 3), whole in the picture and apart from each other."""
    while True:
        depth = np.exp(rng.uniform(math.log(NEAR), math.log(FAR), 2))
        size = 1.2 * RADIUS / depth * OPTICS.focal + 3.0
        room = np.stack([0.5 * OPTICS.width - size, 0.5 * OPTICS.height - size], axis=1)
        if (room <= 0.0).any():
            continue
        points = rng.uniform(-room, room) / OPTICS.focal
        if np.hypot(*(points[0] - points[1])) * OPTICS.focal > size.sum():
            return depth[:, None] * np.concatenate([np.ones((2, 1)), points], axis=1)
