"""`python -m visenvs doctor`: whether this installation can work, and what to write if not."""

from __future__ import annotations

import os
import platform
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, distributions, version
from importlib.util import find_spec

PACKAGES = (
    *("gymnasium", "pettingzoo", "numpy", "scipy", "numba", "opencv-python-headless", "pymunk"),
    *("torch", "stable-baselines3", "sb3-contrib", "ray"),
)
REQUIRED = 7  # so many of them from the first on
OPENCV = "opencv-"  # every distribution of it unpacks into the same folder cv2/


@dataclass(frozen=True)
class Finding:
    """One thing looked at.

    Attributes:
        name: what.
        ok: whether it can stay as it is.
        text: what was found, and what to write if it cannot.
    """

    name: str
    ok: bool
    text: str


def examine() -> Iterator[Finding]:
    """All checks, one after the other."""
    yield Finding("python", True, f"{platform.python_version()} on {platform.machine()}")
    yield from packages()
    for name, check in (("opencv", opencv), ("torch", torch), ("cache", cache), ("step", step)):
        try:
            yield check()
        except Exception as error:
            yield Finding(name, False, f"{type(error).__name__}: {error}")


def packages() -> Iterator[Finding]:
    """Versions of what visenvs stands on; extras may be missing."""
    for place, name in enumerate(PACKAGES):
        try:
            yield Finding(name, True, version(name))
        except PackageNotFoundError:
            needed = place < REQUIRED
            advice = f"missing: write `pip install {name}`" if needed else "not installed"
            yield Finding(name, not needed, advice)


def opencv() -> Finding:
    """No two distributions of OpenCV share one folder."""
    found = sorted({found.name for found in distributions() if found.name.startswith(OPENCV)})
    if len(found) < 2:
        return Finding("opencv", True, "one distribution")
    others = " ".join(name for name in found if name != "opencv-python-headless")
    advice = f"pip uninstall -y {others} && pip install --force-reinstall opencv-python-headless"
    return Finding("opencv", False, f"{', '.join(found)} overwrite each other: write `{advice}`")


def torch() -> Finding:
    """Which build of torch there is, read without importing it."""
    if find_spec("torch") is None:
        return Finding("torch build", True, "not installed; only training needs it")
    build = version("torch").partition("+")[2] or "default"
    return Finding("torch build", True, build)


def cache() -> Finding:
    """Compiled kernels can be kept."""
    from visenvs.core.compile import cache_folder

    folder = cache_folder()
    folder.mkdir(parents=True, exist_ok=True)
    if os.access(folder, os.W_OK):
        return Finding("kernel cache", True, str(folder))
    text = f"{folder} cannot be written, so that kernels compile anew each time: set XDG_CACHE_HOME"
    return Finding("kernel cache", False, text)


def step() -> Finding:
    """An environment compiles, starts and steps."""
    import gymnasium

    import visenvs

    env_id = "visenvs/Rendezvous-v0"
    assert visenvs.__version__
    env = gymnasium.make(env_id)
    action = env.action_space.sample() * 0.0
    compiling = _seconds(lambda: (env.reset(seed=0), env.step(action)))
    stepping = _seconds(lambda: env.step(action))
    text = f"{env_id}: first step {compiling:.1f} s, next {1e6 * stepping:.0f} microseconds"
    return Finding("step", True, text)


def _seconds(call: Callable[[], object]) -> float:
    began = time.perf_counter()
    call()
    return time.perf_counter() - began
