"""The legend along the top of a picture, and the marks that several pictures share."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from visenvs.render import style
from visenvs.render.canvas import Panel
from visenvs.render.style import Image, write

Mark = Callable[[Panel], None]


def draw(image: Image, *entries: tuple[int, str, Mark]) -> None:
    """Name the marks along the top; each has its left end (pixels), its name and how it is drawn.

    The marks fit an icon of 26 by 24 pixels with its origin in the middle.
    """
    for left, name, mark in entries:
        icon = Panel(image, left, 12, 26, 24)
        mark(icon)
        write(image, name, (left + 30, 29), 13, style.GREY)


def vehicle(icon: Panel) -> None:
    """A vehicle that looks to the right."""
    icon.dart((3.0, 0.0), (1.0, 0.0), style.INK)


def velocity(icon: Panel) -> None:
    """A velocity to the right."""
    icon.arrow((-11.0, 0.0), (22.0, 0.0), style.INK)


def acceleration(icon: Panel) -> None:
    """An acceleration to the right."""
    icon.arrow((-11.0, 0.0), (22.0, 0.0), style.GREEN)


def target(icon: Panel) -> None:
    """The middle of a target."""
    icon.disc((5.0, 0.0), 4.5, style.VERMILLION)


def estimate(icon: Panel) -> None:
    """An estimate with its ellipse."""
    ellipse = icon.ellipse((0.0, 0.0), np.diag([15.0, 10.0]), 3.0)
    icon.fill(ellipse, style.PALE_BLUE)
    icon.line(ellipse, style.BLUE, 1, closed=True)
    icon.reticle((0.0, 0.0), style.BLUE)


def measured(icon: Panel) -> None:
    """A measured image point."""
    icon.cross((3.0, 0.0), style.INK)
