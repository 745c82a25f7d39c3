"""A window that shows frames live, by pygame (extra `viewer`)."""

from __future__ import annotations

import os
from typing import Any

from gymnasium.error import DependencyNotInstalled

from visenvs.render.canvas import Image

UNSEEN = ("offscreen", "dummy")  # what SDL falls back to, without a word, where there is no screen


class Window:
    """One window; it opens with the first frame, at the frame's size.

    A window that its user has closed stays closed, and further frames are dropped.

    Args:
        title: of the window.

    Raises:
        DependencyNotInstalled: there is no pygame.
    """

    def __init__(self, title: str) -> None:
        os.environ.setdefault("PYGAME_HIDE_SUPPORT_PROMPT", "1")
        try:
            import pygame
        except ImportError as error:
            raise DependencyNotInstalled(
                'render_mode="human" needs pygame: write `pip install "visenvs[viewer]"`, '
                'or take the pictures yourself with render_mode="rgb_array"'
            ) from error
        self._pygame: Any = pygame
        self._title = title
        self._clock: Any = pygame.time.Clock()
        self._surface: Any = None
        self._closed = False

    def show(self, frame: Image, fps: float) -> None:
        """Show a frame (height, width, 3), RGB, then wait so that no more than `fps` pass a second.

        Raises:
            RuntimeError: there is no display.
        """
        if self._closed:
            return
        if self._surface is None:
            self._surface = self._opened(frame.shape[1], frame.shape[0])
        if self._pygame.event.get(self._pygame.QUIT):
            self.close()
            return
        self._pygame.surfarray.blit_array(self._surface, frame.swapaxes(0, 1))
        self._pygame.display.flip()
        self._clock.tick(fps)

    def close(self) -> None:
        """Close the window for good."""
        if self._surface is not None:
            self._pygame.display.quit()
            self._surface = None
        self._closed = True

    def _opened(self, width: int, height: int) -> Any:
        display = self._pygame.display
        try:
            display.init()
            if display.get_driver() in UNSEEN and "SDL_VIDEODRIVER" not in os.environ:
                raise self._pygame.error("no screen")
            surface = display.set_mode((width, height))
        except self._pygame.error as error:
            display.quit()
            raise RuntimeError(
                f'render_mode="human" found no display to open a window on ({error}); '
                'write `render_mode="rgb_array"`'
            ) from error
        display.set_caption(self._title)
        return surface
