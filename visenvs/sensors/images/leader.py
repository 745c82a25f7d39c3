"""Finds an aircraft in a picture: image points of its centre and wing tips.

Every pixel of the search region has a distance to the background, which is drawn through from the
region's border: sky, haze or ground, whatever is there (`contrast`). What stands out is segmented,
by a threshold or by a morphological Chan-Vese contour (scikit-image, `pip install
'visenvs[vision]'`; Marquez-Neila, Baumela and Alvarez 2014); the wings are the long axis of that.
What does not stand out, such as a white aircraft before haze, or is cut off by the picture's edge,
is not registered.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Literal, cast

import cv2
import numpy as np
from numpy.typing import NDArray

from visenvs.sensors.images.contrast import BORDER, stand_out
from visenvs.sensors.images.optics import Image, Optics, Values
from visenvs.sensors.images.prior import Prior, Region, search_region, whole

Segmenter = Literal["threshold", "chan_vese"]
MARGIN = 10.0  # around what is expected, pixels
LEAST = 6  # pixels
FOUND = 5.5  # standard deviations of the highest distances: less is no aircraft
STANDS_OUT, SHARE = 4.0, 0.3  # of an area, standard deviations, and of the highest distances
THIN = 0.15  # variance across the wings over that along them: more is no aircraft
WIDER = 1.5  # a span this much wider or narrower than expected is another thing's
ITERATIONS = 20  # of the contour
END = 2.5  # length of a wing whose offset from the axis gives the tip's, pixels
CLOSE = np.ones((5, 5), np.uint8)  # fragments that touch when grown by this are one


@dataclass(frozen=True)
class LeaderView:
    """An aircraft as seen; image points (y, z), focal lengths.

    Attributes:
        centre: in the middle between the wing tips.
        left, right: wing tips.
    """

    centre: tuple[float, float]
    left: tuple[float, float]
    right: tuple[float, float]

    @property
    def subtended(self) -> float:
        """Angle between the directions to the wing tips, rad."""
        one, other = (np.array([1.0, *point]) for point in (self.left, self.right))
        cosine = one @ other / np.linalg.norm(one) / np.linalg.norm(other)
        return math.acos(min(float(cosine), 1.0))


def detect(
    image: Image, optics: Optics, prior: Prior | None = None, segmenter: Segmenter = "threshold"
) -> LeaderView | None:
    """The aircraft in the search region, or None where none is registered.

    Args:
        image: RGB, (height, width, 3).
        optics: the camera.
        prior: predicted centre, its deviation, and half the span; None to search everywhere, and
            infinite deviations to search everywhere for a span like this.
        segmenter: "threshold" or "chan_vese".
    """
    if segmenter not in ("threshold", "chan_vese"):
        raise ValueError(f'unknown segmenter {segmenter!r}; write "threshold" or "chan_vese"')
    if prior is not None and not all(map(math.isfinite, (*prior.point, prior.size))):
        prior = None
    if search_region(optics, prior, MARGIN) == whole(optics):
        rough = _detect(image, optics, prior, "threshold")
        if rough is None:
            return None
        half = 0.5 * math.hypot(*np.subtract(rough.right, rough.left))
        off = MARGIN / 3.0 / optics.focal
        prior = Prior(rough.centre, (off, off), half)
    return _detect(image, optics, prior, segmenter)


def _detect(
    image: Image, optics: Optics, prior: Prior | None, segmenter: Segmenter
) -> LeaderView | None:
    """The aircraft near a prediction, or what stands out most of the whole picture."""
    region = search_region(optics, prior, MARGIN)
    if region is None or min(region.width, region.height) < 4 * BORDER:
        return None
    part = image[region.top : region.bottom, region.left : region.right]
    distance = stand_out(part)
    span = 2.0 * optics.focal * prior.size if prior is not None else 20.0
    k = distance.size - 1 - min(int(span), distance.size - 1)
    peak = float(np.partition(distance, k, axis=None)[k])
    if peak < FOUND:
        return None
    middle = np.array(part.shape[1::-1]) / 2.0
    reach = math.inf
    if prior is not None:
        middle = optics.pixels(prior.point) - (region.left, region.top)
        deviation = optics.focal * max(prior.deviation)
        reach = 0.5 * span + 3.0 * deviation + MARGIN
    mask = _segment(distance, peak, segmenter)
    chosen = _choose(mask, middle, reach)
    if chosen is None or _cut(chosen, region, optics):
        return None
    found = _measure(distance, chosen, peak)
    if found is None or not _as_wide(found, span if prior is not None else None):
        return None
    corner = (region.left, region.top)
    points = [optics.points(pixel + corner) for pixel in found]
    centre, left, right = ((float(y), float(z)) for y, z in points)
    return LeaderView(centre, left, right)


def _as_wide(found: tuple[Values, Values, Values], span: float | None) -> bool:
    """Whether wing tips are about as far apart as expected, pixels."""
    wide = math.hypot(*(found[2] - found[1]))
    return span is None or 1.0 / WIDER < wide / span < WIDER


def _cut(chosen: NDArray[np.bool_], region: Region, optics: Optics) -> bool:
    """Whether an area of a region touches the edge of the picture."""
    cut = region.left == 0 and chosen[:, 0].any()
    cut = cut or (region.top == 0 and chosen[0].any())
    cut = cut or (region.right == optics.width and chosen[:, -1].any())
    return bool(cut or (region.bottom == optics.height and chosen[-1].any()))


def _segment(distance: NDArray[np.float32], peak: float, segmenter: Segmenter) -> Image:
    """What stands out, as 0 and 1."""
    mask = (distance > max(STANDS_OUT, SHARE * peak)).astype(np.uint8)
    if segmenter == "threshold":
        return mask
    try:
        from skimage.segmentation import morphological_chan_vese
    except ImportError:
        raise ImportError(
            "the segmenter 'chan_vese' needs scikit-image: write `pip install 'visenvs[vision]'`"
        ) from None
    level, first = np.minimum(distance / peak, 1.0), cast("Any", mask)
    found: Any = morphological_chan_vese(
        level, ITERATIONS, init_level_set=first, smoothing=0, lambda1=1, lambda2=1
    )
    return np.asarray(found, np.uint8)


def _choose(mask: Image, middle: Values, reach: float) -> NDArray[np.bool_] | None:
    """The area that is large and near the prediction, with its fragments; None for none."""
    _, labels, _, centroids = cv2.connectedComponentsWithStats(cv2.dilate(mask, CLOSE))
    areas = np.bincount(labels.ravel(), mask.ravel())
    off = np.hypot(*(centroids - middle).T) / reach
    worth = np.where(areas >= LEAST, areas * np.exp(-off * off), 0.0)
    worth[0] = 0.0  # what is in no area
    best = int(np.argmax(worth))
    return (labels == best) & (mask > 0) if worth[best] > 0.0 else None


def _measure(
    distance: NDArray[np.float32], chosen: NDArray[np.bool_], peak: float
) -> tuple[Values, Values, Values] | None:
    """Pixels of the centre and of the left and right tips of an area."""
    near = cv2.dilate(chosen.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    rows, columns = np.nonzero(near)
    weight = np.clip(distance[rows, columns] / peak, 0.0, 1.0).astype(float)
    places = np.stack([columns, rows], axis=1).astype(float)
    solid = weight > SHARE
    centre = weight @ places / weight.sum()
    off = places - centre
    spread = (off * (weight * solid)[:, None]).T @ off
    (thick, long), axes = np.linalg.eigh(spread)
    if thick > THIN * long:
        return None
    axis = axes[:, 1]
    axis = axis if axis[0] >= 0.0 else -axis
    along, across = off @ axis, off @ np.array([-axis[1], axis[0]])
    ends = [_end(sign * along, weight) for sign in (-1.0, 1.0)]
    if ends[0] is None or ends[1] is None:
        return None
    tips: list[Values] = []
    for sign, end in zip((-1.0, 1.0), (ends[0], ends[1]), strict=True):
        last = (sign * along > end - END) & (weight > 0.5 * SHARE)
        offset = float(np.average(across[last], weights=weight[last])) if last.any() else 0.0
        tips.append(centre + sign * end * axis + offset * np.array([-axis[1], axis[0]]))
    return 0.5 * (tips[0] + tips[1]), tips[0], tips[1]


def _end(along: Values, weight: Values) -> float | None:
    """Where the profile along the axis, the largest weight in every pixel of it, falls to a half.

    The half is of what the wing's outer part has, which is thin and covers its pixels in part.
    """
    cells = np.floor(along).astype(int)
    first = 0
    if cells.max(initial=-1) < 2:
        return None
    profile = np.zeros(cells.max() + 2)
    ahead = cells >= first
    np.maximum.at(profile, cells[ahead], weight[ahead])
    solid = np.flatnonzero(profile > SHARE)
    if not len(solid):
        return None
    last = int(solid[-1])
    level = 0.5 * float(np.median(profile[max(last - 4, 0) : last + 1]))
    k = int(np.flatnonzero(profile >= level)[-1])
    return k + 0.5 + (profile[k] - level) / max(profile[k] - profile[k + 1], 1e-9)
