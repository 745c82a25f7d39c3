"""Corners of a picture with the patches that tell them apart (Harris and Stephens 1988)."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from visenvs.sensors.images.optics import Image, Values

MOST, QUALITY, APART, SENSITIVITY = 80, 0.004, 9, 0.04
PATCH = 13  # side, pixels
REFINE = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 8, 0.05)
Patches = NDArray[np.float32]  # (n, PATCH * PATCH), mean 0 and length 1


def detect(image: Image, mask: Image | None = None) -> tuple[Values, Patches]:
    """Pixels (n, 2) of at most MOST corners, and the patches around them.

    Args:
        image: grey, (height, width).
        mask: 0 where no corner is wanted; None for anywhere.
    """
    found: Any = cv2.goodFeaturesToTrack(
        image, MOST, QUALITY, APART, mask=mask, useHarrisDetector=True, k=SENSITIVITY
    )
    if found is None:
        return np.empty((0, 2)), np.empty((0, PATCH * PATCH), np.float32)
    found = found.reshape(-1, 2)
    half = PATCH // 2 + 1
    height, width = image.shape
    inside = (found >= half).all(axis=1) & (found < (width - half, height - half)).all(axis=1)
    found = np.ascontiguousarray(found[inside])
    if not len(found):
        return np.empty((0, 2)), np.empty((0, PATCH * PATCH), np.float32)
    patches = np.array([_patch(image, *corner) for corner in np.rint(found).astype(int)])
    refined = cv2.cornerSubPix(image, found, (4, 4), (-1, -1), REFINE)
    return np.asarray(refined, float), patches


def _patch(image: Image, u: int, v: int) -> NDArray[np.float32]:
    half = PATCH // 2
    part = image[v - half : v + half + 1, u - half : u + half + 1].astype(np.float32).ravel()
    part -= part.mean()
    return part / max(float(np.sqrt(part @ part)), 1e-6)
