"""Colours and text that every picture shares."""

from __future__ import annotations

from functools import cache
from typing import Any, Literal

import cv2
import numpy as np
from numpy.typing import NDArray

Image = NDArray[np.uint8]
Colour = tuple[int, int, int]

# Hues of Okabe and Ito (2008), which colour-blind readers can tell apart, and greys
INK: Colour = (38, 38, 38)
GREY: Colour = (118, 118, 118)
GRID: Colour = (228, 228, 226)
FRAME: Colour = (196, 196, 194)
PAPER: Colour = (247, 247, 245)
WHITE: Colour = (255, 255, 255)
BLUE: Colour = (0, 114, 178)
PALE_BLUE: Colour = (221, 236, 246)
MIDDLE_BLUE: Colour = (186, 215, 236)
VERMILLION: Colour = (213, 94, 0)
GREEN: Colour = (0, 158, 115)
SAND: Colour = (251, 243, 222)
DARK_SAND: Colour = (222, 203, 152)


def paint(image: Image, colour: Colour) -> None:
    """Fill a picture or a part of it (ten times faster than assigning the colour)."""
    cv2.rectangle(image, (0, 0), (image.shape[1], image.shape[0]), colour, -1)


@cache
def font(name: str) -> Any:
    """A face that OpenCV carries inside: "sans" for headings, "uni" for text and figures."""
    return cv2.FontFace(name)


def write(
    image: Image,
    text: str,
    at: tuple[float, float],
    size: int = 13,
    colour: Colour = INK,
    align: Literal["left", "middle", "right"] = "left",
) -> None:
    """Write a line of text; `at` is its left end, middle or right end on the baseline, pixels."""
    x, y = at
    if align != "left":
        canvas = (image.shape[1], image.shape[0])
        length = cv2.getTextSize(canvas, text, (0, 0), font("uni"), size)[2]
        x -= length if align == "right" else length / 2
    cv2.putText(image, text, (round(x), round(y)), colour, font("uni"), size)


def head(image: Image, text: str, at: tuple[float, float], size: int = 13) -> None:
    """Write a heading from its left end on the baseline, pixels."""
    cv2.putText(image, text, (round(at[0]), round(at[1])), INK, font("sans"), size, 600)
