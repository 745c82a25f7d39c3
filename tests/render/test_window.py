from __future__ import annotations

import sys

import numpy as np
import pytest
from gymnasium.error import DependencyNotInstalled

from visenvs.render.window import Window

FRAME = np.random.default_rng(0).integers(0, 256, (40, 60, 3), np.uint8)


@pytest.fixture
def pygame(monkeypatch):
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    return pytest.importorskip("pygame", reason="needs the extra `viewer`")


def test_the_window_shows_the_frame_as_it_is(pygame):
    window = Window("a title")
    window.show(FRAME, 1000.0)
    shown = pygame.surfarray.array3d(pygame.display.get_surface()).swapaxes(0, 1)
    np.testing.assert_array_equal(shown, FRAME)
    assert pygame.display.get_caption()[0] == "a title"
    window.close()
    assert not pygame.display.get_init()


def test_a_window_closed_by_its_user_stays_closed(pygame):
    window = Window("a title")
    window.show(FRAME, 1000.0)
    pygame.event.post(pygame.event.Event(pygame.QUIT))
    window.show(FRAME, 1000.0)
    window.show(FRAME, 1000.0)
    assert not pygame.display.get_init()


def test_without_a_display_the_error_names_the_other_mode(pygame, monkeypatch):
    monkeypatch.setenv("SDL_VIDEODRIVER", "none-such")
    with pytest.raises(RuntimeError, match='render_mode="rgb_array"'):
        Window("a title").show(FRAME, 1000.0)


def test_a_display_that_nobody_sees_is_none_unless_asked_for(pygame, monkeypatch):
    monkeypatch.delenv("SDL_VIDEODRIVER")
    monkeypatch.setattr(pygame.display, "get_driver", lambda: "offscreen")
    with pytest.raises(RuntimeError, match='render_mode="rgb_array"'):
        Window("a title").show(FRAME, 1000.0)


def test_without_pygame_the_error_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "pygame", None)
    with pytest.raises(DependencyNotInstalled, match=r'pip install "visenvs\[viewer\]"'):
        Window("a title")
