"""`python -m eval.soak`: whether memory stays flat when environments are reset again and again."""

from __future__ import annotations

import ctypes
import gc
import tracemalloc
from dataclasses import dataclass
from typing import Any

import gymnasium
import psutil

import visenvs
from visenvs.core.cli import launch
from visenvs.core.registry import environment_files, load_task

PROGRAM = "eval.soak"
LIMIT = 5.0  # MB
WARM_UP = 0.05  # share of the resets after which memory is first looked at
MB = 1e6


@dataclass(frozen=True)
class Options:
    """What to reset and how often."""

    env: str | None = None
    """Gymnasium id; all environments if not given."""
    resets: int = 20_000
    """Resets of each environment, each followed by one step."""


def run(options: Options) -> None:
    """Reset environments again and again, print how much memory grew; an error above 5 MB."""
    if options.resets < 1:
        raise ValueError(f"--resets must be at least 1, got {options.resets}")
    grown: dict[str, float] = {}
    for env_id in [load_task(options.env).id] if options.env else environment_files():
        grown[env_id] = growth(env_id, options.resets)
        print(f"{env_id}: {grown[env_id]:+.2f} MB in {options.resets:,} resets", flush=True)
    if leaking := [env_id for env_id, size in grown.items() if size > LIMIT]:
        raise ValueError(f"memory grew by more than {LIMIT:g} MB: {', '.join(leaking)}")


def growth(env_id: str, resets: int) -> float:
    """Growth of memory in MB from after the warm-up to the last reset.

    The larger of two: what Python and NumPy have allocated, and this process's resident memory, in
    which libraries count too.
    """
    assert visenvs.__version__  # registers the environments
    env = gymnasium.make(env_id)
    tracemalloc.start()
    try:
        _reset(env, range(max(int(WARM_UP * resets), 1)))
        before = _used()
        _reset(env, range(resets))
        after = _used()
    finally:
        tracemalloc.stop()
    env.close()
    return max(new - old for new, old in zip(after, before, strict=True)) / MB


def _reset(env: gymnasium.Env[Any, Any], seeds: range) -> None:
    action = env.action_space.sample() * 0
    for seed in seeds:
        env.reset(seed=seed)
        env.step(action)


def _used() -> tuple[int, int]:
    """Bytes allocated, and resident once the C library has given back what is free."""
    gc.collect()
    if trim := getattr(ctypes.CDLL(None), "malloc_trim", None):
        trim(0)
    return tracemalloc.get_traced_memory()[0], psutil.Process().memory_info().rss


if __name__ == "__main__":
    launch(PROGRAM, Options, run)
