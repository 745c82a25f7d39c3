"""Trains a cascade of Haar features: Gentle AdaBoost, stage by stage, on ever harder negatives.

Friedman, Hastie and Tibshirani (2000), "Additive logistic regression: a statistical view of
boosting". Each round fits the stump with the least weighted squared error over all features and all
thresholds. A stage ends when its threshold, which lets nearly all positives pass, stops enough of
the negatives; the next is trained on what still passes.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from visenvs.core.compile import kernel
from visenvs.sensors.images.haar import SIDE, Cascade, feature, judge, spread
from visenvs.sensors.images.optics import Image

STRIDE = 2  # between places and sizes of features, pixels
Patches = NDArray[np.uint8]  # (n, SIDE, SIDE)
Stump = tuple[float, float, float]  # threshold, left, right


@dataclass(frozen=True)
class Recipe:
    """How to train.

    Attributes:
        stages: at most so many.
        stumps: in one stage at most.
        hit: part of the positives that a stage lets pass, at least.
        false_alarm: part of its negatives that it lets pass, at most.
    """

    stages: int = 14
    stumps: int = 40
    hit: float = 0.997
    false_alarm: float = 0.4


@dataclass
class Stumps:
    """What has been trained so far, in lists."""

    features: list[int] = field(default_factory=list[int])
    values: list[Stump] = field(default_factory=list[Stump])
    ends: list[int] = field(default_factory=list[int])
    limits: list[float] = field(default_factory=list[float])

    def cascade(self, rects: NDArray[np.int32], weights: NDArray[np.float32]) -> Cascade:
        """The finished stages as a cascade."""
        numbers = np.array(self.values, np.float32).reshape(-1, 3)
        limits = np.array(self.limits, np.float32)
        threshold, left, right = (np.ascontiguousarray(numbers[:, k]) for k in range(3))
        chosen, ends = np.array(self.features, np.int64), np.array(self.ends, np.int64)
        return Cascade(rects[chosen], weights[chosen], threshold, left, right, ends, limits)


def train(
    positives: Patches,
    mine: Callable[[Cascade], Patches],
    recipe: Recipe,
    report: Callable[[str], None] = lambda _line: None,
) -> Cascade:
    """A cascade that tells the positives from what `mine` finds.

    Args:
        positives: windows with the object.
        mine: gives windows without it that pass the cascade so far, few or none at the end.
        recipe: how.
        report: called with a line after each stage.
    """
    rects, weights = feature_pool()
    trained = Stumps()
    seen = values_of(positives, rects, weights)
    cascade = trained.cascade(rects, weights)
    for stage in range(recipe.stages):
        negatives = mine(cascade)
        if len(negatives) < 20:
            break
        alarms = _train_stage(seen, values_of(negatives, rects, weights), recipe, trained)
        cascade = trained.cascade(rects, weights)
        kept = passing(positives, cascade)
        report(
            f"stage {stage}: {len(negatives)} negatives, {len(trained.features)} stumps, "
            f"false alarms {alarms:.3f}, positives kept {kept.mean():.3f}"
        )
        seen, positives = np.ascontiguousarray(seen[:, kept]), positives[kept]
    return cascade


def feature_pool() -> tuple[NDArray[np.int32], NDArray[np.float32]]:
    """Edges, lines of three and four, two by two, centre and surround, at all places and sizes."""
    shapes = [
        ((2, 1), [((1, 0, 1, 1), 2.0)]),
        ((1, 2), [((0, 1, 1, 1), 2.0)]),
        ((3, 1), [((1, 0, 1, 1), 3.0)]),
        ((1, 3), [((0, 1, 1, 1), 3.0)]),
        ((4, 1), [((1, 0, 2, 1), 2.0)]),
        ((1, 4), [((0, 1, 1, 2), 2.0)]),
        ((2, 2), [((0, 0, 1, 1), 2.0), ((1, 1, 1, 1), 2.0)]),
        ((3, 3), [((1, 1, 1, 1), 9.0)]),
    ]
    rects: list[NDArray[Any]] = []
    weights: list[list[float]] = []
    for (columns, rows), parts in shapes:
        for w in range(STRIDE, SIDE // columns + 1, STRIDE):
            for h in range(STRIDE, SIDE // rows + 1, STRIDE):
                for x in range(0, SIDE - columns * w + 1, STRIDE):
                    for y in range(0, SIDE - rows * h + 1, STRIDE):
                        one = np.zeros((3, 4), np.int32)
                        one[0] = (x, y, columns * w, rows * h)
                        weight = [-1.0, 0.0, 0.0]
                        for k, ((i, j, m, n), value) in enumerate(parts, start=1):
                            one[k] = (x + i * w, y + j * h, m * w, n * h)
                            weight[k] = value
                        rects.append(one)
                        weights.append(weight)
    return np.array(rects), np.array(weights, np.float32)


def integrals(patches: Patches) -> tuple[NDArray[np.int32], NDArray[np.float64]]:
    """Integral images of windows and of their squares, (n, SIDE + 1, SIDE + 1)."""
    both = [cv2.integral2(patch, sdepth=cv2.CV_32S, sqdepth=cv2.CV_64F) for patch in patches]
    return np.array([one for one, _ in both]), np.array([two for _, two in both])


def values_of(
    patches: Patches, rects: NDArray[np.int32], weights: NDArray[np.float32]
) -> NDArray[np.float32]:
    """Every feature of every window, (features, n)."""
    out = np.empty((len(rects), len(patches)), np.float32)
    fill_values(*integrals(patches), rects, weights, out)
    return out


@kernel
def fill_values(sums, squares, rects, weights, out):
    """Write every feature (m) of every window (n): out (m, n)."""
    for i in range(sums.shape[0]):
        sigma = max(spread(sums[i], squares[i], 0, 0), 1.0)
        for k in range(rects.shape[0]):
            out[k, i] = feature(sums[i], rects[k], weights[k], 0, 0) / sigma


def passing(patches: Patches, cascade: Cascade) -> NDArray[np.bool_]:
    """Which windows pass a cascade, (n,)."""
    out = np.zeros(len(patches), np.bool_)
    if len(patches):
        judge_all(*integrals(patches), cascade.parts, out)
    return out


@kernel
def judge_all(sums, squares, parts, out):
    """Write which windows (n) pass."""
    for i in range(sums.shape[0]):
        out[i] = judge(sums[i], squares[i], parts, 0, 0) >= 0.0


def _train_stage(
    positives: NDArray[np.float32],
    negatives: NDArray[np.float32],
    recipe: Recipe,
    trained: Stumps,
) -> float:
    """Add one stage to what is trained; returns its false alarm rate on its own negatives."""
    values = np.concatenate([positives, negatives], axis=1)
    labels = np.concatenate([np.ones(positives.shape[1]), -np.ones(negatives.shape[1])])
    order = np.argsort(values, axis=1).astype(np.int32)
    weight, total = np.empty(len(labels)), np.zeros(len(labels))
    weight[labels > 0] = 0.5 / positives.shape[1]
    weight[labels < 0] = 0.5 / negatives.shape[1]
    best, limit, alarms = np.empty(4), 0.0, 1.0
    for _ in range(recipe.stumps):
        fit_stump(values, order, labels, weight, best)
        chosen, threshold = int(best[0]), float(best[1])
        given = np.where(values[chosen] < np.float32(threshold), best[2], best[3])
        total += given
        weight *= np.exp(-labels * given)
        weight /= weight.sum()
        trained.features.append(chosen)
        trained.values.append((threshold, float(best[2]), float(best[3])))
        ranked = np.sort(total[labels > 0])
        limit = float(ranked[int((1.0 - recipe.hit) * len(ranked))]) - 1e-4
        alarms = float((total[labels < 0] >= limit).mean())
        if alarms <= recipe.false_alarm:
            break
    trained.ends.append(len(trained.features))
    trained.limits.append(limit)
    return alarms


@kernel
def fit_stump(values, order, labels, weight, best):
    """Find the stump with the least weighted squared error: feature, threshold, left, right.

    Args:
        values: features of all windows, (m, n).
        order: windows sorted by each feature, (m, n).
        labels: +1 or -1, (n,).
        weight: of the windows, (n,).
        best: written, (4,).
    """
    n = labels.shape[0]
    total, both, most = 0.0, 0.0, -1.0
    for i in range(n):
        total += weight[i]
        both += weight[i] * labels[i]
    for k in range(values.shape[0]):
        w, s = 0.0, 0.0
        for i in range(n - 1):
            j = order[k, i]
            w += weight[j]
            s += weight[j] * labels[j]
            here, after = values[k, j], values[k, order[k, i + 1]]
            if after > here and w > 1e-9 and total - w > 1e-9:
                gain = s * s / w + (both - s) * (both - s) / (total - w)
                if gain > most:
                    most = gain
                    best[0], best[1] = k, 0.5 * (here + after)
                    best[2], best[3] = s / w, (both - s) / (total - w)


def windows_of(image: Image, places: NDArray[Any]) -> Patches:
    """The windows of a resized picture with these top left corners (x, y), (n, 2)."""
    parts = [image[y : y + SIDE, x : x + SIDE] for x, y in places]
    return np.array(parts, np.uint8).reshape(-1, SIDE, SIDE)
