"""Navigation by pictures of the floor: which corner is which landmark, and the filter on them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from visenvs.estimation import vio
from visenvs.sensors.images import corners
from visenvs.sensors.images.optics import Image, Optics, Values

ALIKE = 0.6  # correlation of the patches of one landmark
REACH = 14.0  # a corner is sought so near the predicted pixel
NEAREST = 3  # corners whose patches are compared
FAILS = 3  # pictures in a row, in view, after which a landmark is dropped
APART = 22.0  # new landmarks are at least so far from the others, pixels
BORDER = 6.0  # of the picture, in which nothing is expected, pixels
START = np.array([0.01, 0.01, 0.005, 0.05, 0.005])  # deviations at the start, as in `vio.begin`

SETTINGS = np.dtype(
    [
        (name, "f8")
        for name in (
            "sigma_force",
            "sigma_rate",
            "walk_force",
            "walk_rate",
            "dt",
            "sigma_pixel",
            "gate",
            "min_range",
            "sigma_height",
        )
    ]
)


def settings(optics: Optics, dt: float = 0.01, sigma_pixel: float = 0.7) -> NDArray[Any]:
    """What a small MEMS unit and corners are like, one record; `sigma_pixel` in pixels."""
    out = np.zeros(1, SETTINGS)
    out["sigma_force"], out["sigma_rate"] = 0.004, 0.0006
    out["walk_force"], out["walk_rate"] = 0.0005, 0.00005
    out["dt"], out["sigma_pixel"], out["gate"] = dt, sigma_pixel / optics.focal, 9.2
    out["min_range"], out["sigma_height"] = 0.2, 0.02
    return out


@dataclass
class Navigator:
    """The filter of one vehicle with the patches of its landmarks.

    Attributes:
        optics: the camera.
        C_CB: its attitude on the vehicle, (3, 3).
        settings: one record of SETTINGS.
        nav: one record of `vio.NAVIGATION`.
        patches: of the landmarks, (SLOTS, PATCH * PATCH).
        steps: those of the filter: `vio`, or what watches them and has functions like it.
    """

    optics: Optics
    C_CB: Values
    settings: NDArray[Any]
    nav: NDArray[Any]
    patches: NDArray[np.float32]
    steps: Any = vio

    @classmethod
    def start(
        cls, optics: Optics, C_CB: Values, settings: NDArray[Any], p: Values, v: Values, C: Values
    ) -> Navigator:
        """A filter at a known place, with no landmarks yet."""
        nav = np.zeros(1, vio.NAVIGATION)
        vio.begin(nav[0], p, v, C, START)
        patches = np.zeros((vio.SLOTS, corners.PATCH**2), np.float32)
        return cls(optics, C_CB, settings, nav, patches)

    def feel(self, samples: Values) -> None:
        """Integrate IMU samples (n, 2, 3): specific force and turn rate in B."""
        integrate_all(self.nav, samples, float(self.settings["dt"][0]), np.zeros(1, vio.SCRATCH))

    def see(self, image: Image, height: float | None = None, mask: Image | None = None) -> int:
        """Use a grey picture and, perhaps, a measured height; returns how many landmarks it used.

        Args:
            image: (height, width).
            height: above the floor, m.
            mask: 0 where nothing is looked at.
        """
        nav, cfg, scratch = self.nav[0], self.settings[0], np.zeros(1, vio.SCRATCH)[0]
        steps = self.steps
        pixels, patches = corners.detect(image, mask)
        points = self.optics.points(pixels)
        steps.predict(nav, cfg, scratch)
        if height is not None:
            steps.use_height(nav, height, cfg["sigma_height"], scratch)
        used, taken, seen = 0, np.zeros(len(pixels), bool), np.empty(2)
        held: list[Values] = []
        for j in np.flatnonzero(nav["alive"]):
            ahead = steps.expect(nav, j, self.C_CB, cfg["min_range"], scratch, seen)
            place = self.optics.pixels(seen)
            if not ahead or not self.optics.shows(place, BORDER):
                nav["alive"][j] = 0.0
                continue
            i = self._corner(int(j), place, pixels, patches, taken)
            point = points[i] if i >= 0 else seen
            if i >= 0 and steps.use_landmark(nav, j, self.C_CB, point, cfg, scratch, seen):
                taken[i], nav["missed"][j] = True, 0.0
                used += 1
                held.append(pixels[i])
                self.patches[j] = patches[i]
            else:
                nav["missed"][j] += 1.0
                nav["alive"][j] = 1.0 if nav["missed"][j] < FAILS else 0.0
                held.append(place)
        steps.correct(nav, scratch)
        self._add(pixels, patches, points, taken, held, scratch)
        return used

    def _corner(
        self, j: int, place: Values, pixels: Values, patches: corners.Patches, taken: NDArray[Any]
    ) -> int:
        """The corner that looks like landmark j near its predicted pixel, or -1."""
        if not len(pixels):
            return -1
        gaps = np.hypot(*(pixels - place).T)
        gaps[taken] = np.inf
        near = np.argsort(gaps)[:NEAREST]
        near = near[gaps[near] < REACH]
        if not len(near):
            return -1
        alike = patches[near] @ self.patches[j]
        best = int(np.argmax(alike))
        return int(near[best]) if alike[best] > ALIKE else -1

    def _add(
        self,
        pixels: Values,
        patches: corners.Patches,
        points: Values,
        taken: NDArray[Any],
        held: list[Values],
        scratch: Any,
    ) -> None:
        """Fill free slots with corners that are far from the landmarks."""
        nav, free = self.nav[0], list(np.flatnonzero(self.nav[0]["alive"] == 0.0))
        seen, steps = np.empty(2), self.steps
        for i in np.flatnonzero(~taken):
            if not free:
                break
            if held and np.hypot(*(np.array(held) - pixels[i]).T).min() < APART:
                continue
            j = free[0]
            cfg = self.settings[0]
            if steps.add_landmark(nav, j, self.C_CB, points[i], cfg, scratch, seen):
                self.patches[free.pop(0)] = patches[i]
                held.append(pixels[i])
        steps.correct(nav, scratch)


def integrate_all(nav: NDArray[Any], samples: Values, dt: float, scratch: NDArray[Any]) -> None:
    """Use IMU samples (n, 2, 3) one after the other."""
    for force, rate in samples:
        vio.integrate(nav[0], force, rate, dt, scratch[0])
