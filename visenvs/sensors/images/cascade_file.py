"""Cascades as OpenCV's XML files (its new format), and the cascade that ships."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from functools import cache
from importlib import resources

import numpy as np

from visenvs.sensors.images.haar import SIDE, Cascade

SHIPPED = "robot.xml"


@cache
def shipped_cascade() -> Cascade:
    """The cascade of ground robots that comes with visenvs; `cascades/card.json` says how made."""
    text = resources.files("visenvs.sensors.images.cascades").joinpath(SHIPPED).read_text("utf-8")
    return from_xml(text)


def to_xml(cascade: Cascade) -> str:
    """A cascade as OpenCV's `CascadeClassifier` loads it."""
    root = ET.Element("opencv_storage")
    top = ET.SubElement(root, "cascade", type_id="opencv-cascade-classifier")
    longest = int(np.diff(cascade.ends, prepend=0).max())
    settings = {"stageType": "BOOST", "featureType": "HAAR", "height": SIDE, "width": SIDE}
    for name, value in settings.items():
        ET.SubElement(top, name).text = str(value)
    ET.SubElement(ET.SubElement(top, "stageParams"), "maxWeakCount").text = str(longest)
    ET.SubElement(ET.SubElement(top, "featureParams"), "maxCatCount").text = "0"
    ET.SubElement(top, "stageNum").text = str(len(cascade.ends))
    stages, start = ET.SubElement(top, "stages"), 0
    for end, limit in zip(cascade.ends.tolist(), cascade.limits, strict=True):
        stage = ET.SubElement(stages, "_")
        ET.SubElement(stage, "maxWeakCount").text = str(end - start)
        ET.SubElement(stage, "stageThreshold").text = f"{limit:.9g}"
        stumps = ET.SubElement(stage, "weakClassifiers")
        for n in range(start, end):
            stump = ET.SubElement(stumps, "_")
            ET.SubElement(stump, "internalNodes").text = f"0 -1 {n} {cascade.thresholds[n]:.9g}"
            leaves = f"{cascade.left[n]:.9g} {cascade.right[n]:.9g}"
            ET.SubElement(stump, "leafValues").text = leaves
        start = end
    features = ET.SubElement(top, "features")
    for rects, weights in zip(cascade.rects, cascade.weights, strict=True):
        one = ET.SubElement(features, "_")
        listed = ET.SubElement(one, "rects")
        for rect, weight in zip(rects.tolist(), weights.tolist(), strict=True):
            if weight:
                ET.SubElement(listed, "_").text = f"{' '.join(map(str, rect))} {weight:g}."
        ET.SubElement(one, "tilted").text = "0"
    ET.indent(root)
    return '<?xml version="1.0"?>\n' + ET.tostring(root, encoding="unicode") + "\n"


def from_xml(text: str) -> Cascade:
    """The cascade of an OpenCV file: upright Haar features, boosted stumps, a 24 by 24 window.

    Raises:
        ValueError: it is another kind of file.
    """
    try:
        top = ET.fromstring(text).find("cascade")
    except ET.ParseError as error:
        raise ValueError(f"not an XML file: {error}; expected OpenCV's cascade format") from None
    if top is None:
        raise ValueError("the file has no <cascade>; expected OpenCV's new cascade format")
    kind = tuple(_text(top, name) for name in ("stageType", "featureType", "height", "width"))
    if kind != ("BOOST", "HAAR", str(SIDE), str(SIDE)):
        raise ValueError(
            f"a cascade must be of BOOST stages of HAAR features in a {SIDE} by {SIDE} window, "
            f"got {' '.join(kind)}"
        )
    pool = [_feature(one) for one in top.findall("features/_")]
    chosen: list[int] = []
    values: list[tuple[float, float, float]] = []
    ends: list[int] = []
    limits: list[float] = []
    for stage in top.findall("stages/_"):
        for stump in stage.findall("weakClassifiers/_"):
            nodes, leaves = (
                _text(stump, "internalNodes").split(),
                _text(stump, "leafValues").split(),
            )
            if len(nodes) != 4 or len(leaves) != 2:
                raise ValueError("a weak classifier with more than one node; expected stumps")
            chosen.append(int(nodes[2]))
            values.append((float(nodes[3]), float(leaves[0]), float(leaves[1])))
        ends.append(len(chosen))
        limits.append(float(_text(stage, "stageThreshold")))
    numbers = np.array(values, np.float32).reshape(-1, 3)
    threshold, left, right = (np.ascontiguousarray(numbers[:, k]) for k in range(3))
    return Cascade(
        np.array([pool[n][0] for n in chosen], np.int32),
        np.array([pool[n][1] for n in chosen], np.float32),
        threshold,
        left,
        right,
        np.array(ends, np.int64),
        np.array(limits, np.float32),
    )


def _text(node: ET.Element, name: str) -> str:
    return (node.findtext(name) or "").strip()


def _feature(node: ET.Element) -> tuple[list[list[int]], list[float]]:
    """Rectangles and weights of one feature, filled up to three."""
    if _text(node, "tilted") not in ("", "0"):
        raise ValueError("a cascade with tilted features; expected upright ones")
    rects, weights = [[0, 0, 0, 0] for _ in range(3)], [0.0] * 3
    for k, rect in enumerate(node.findall("rects/_")):
        *numbers, weight = (rect.text or "").split()
        rects[k], weights[k] = [int(number) for number in numbers], float(weight)
    return rects, weights
