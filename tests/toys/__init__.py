"""Environments of the tests' own: `tests/toys/envs/` is read as `visenvs/envs/` is."""

from __future__ import annotations

import importlib
from contextlib import contextmanager
from pathlib import Path

import gymnasium as gym
import pytest

import visenvs
import visenvs.envs
from visenvs.core import registry

HERE = Path(__file__).parent


@contextmanager
def toys():
    """Make the toys the only environments there are.

    Their modules are named as real ones are (`visenvs.envs.cart`). Load them in no other way:
    compiled kernels remember the name of their module, and a second one breaks their cache.
    """
    before = set(gym.registry)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(registry, "PACKAGE", HERE)
        patch.setattr(visenvs.envs, "__path__", [str(HERE / "envs")])
        registry.environment_files.cache_clear()
        importlib.reload(visenvs)
        try:
            yield
        finally:
            registry.environment_files.cache_clear()
            for name in set(gym.registry) - before:
                del gym.registry[name]
