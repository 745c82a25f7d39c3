"""Independent calls in this process, in several, or on a Ray cluster.

Where a call runs does not change what it returns, so results are the same on every backend. A call
whose worker dies is made again.
"""

from __future__ import annotations

import multiprocessing
import os
import sys
from collections.abc import Callable, Generator, Sequence
from concurrent.futures import FIRST_COMPLETED, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, Literal

DEATHS = 3  # so many times workers may die without finishing a single call
Done = tuple[int, Any]


@dataclass(frozen=True)
class Workers:
    """Where calls run."""

    backend: Literal["local", "processes", "ray"] = "local"
    """local: in this process; processes: several on this machine; ray: a Ray cluster"""
    workers: int | None = None
    """how many at once; all cores, or all that the cluster has, if not given"""
    address: str | None = None
    """of a running Ray cluster; one is started here if not given"""


def completed(
    function: Callable[..., Any], calls: Sequence[tuple[Any, ...]], where: Workers
) -> Generator[Done]:
    """Index and result of every call, as they finish.

    Args:
        function: module-level, so that another process finds it by its name.
        calls: the arguments of each call; they and the results must survive pickling.
        where: the backend.

    Raises:
        ValueError: of the function, or options that do not go together.
        RuntimeError: workers die again and again.
    """
    check(where)
    if not calls:
        return
    if where.backend == "processes":
        yield from _in_processes(function, calls, where.workers or os.cpu_count() or 1)
    elif where.backend == "ray":
        yield from _on_ray(function, calls, where)
    else:
        yield from ((i, function(*call)) for i, call in enumerate(calls))


def check(where: Workers) -> None:
    """A ValueError for options that make no sense, before any work starts."""
    if where.workers is not None and where.workers < 1:
        raise ValueError(f"--workers must be at least 1, got {where.workers}")
    if where.address is not None and where.backend != "ray":
        raise ValueError("--address is that of a Ray cluster: write --backend ray with it")
    if where.backend == "ray":
        _ray()


def _in_processes(
    function: Callable[..., Any], calls: Sequence[tuple[Any, ...]], workers: int
) -> Generator[Done]:
    left, deaths = dict(enumerate(calls)), 0
    spawn = multiprocessing.get_context("spawn")
    while left:
        others = set(multiprocessing.active_children())
        pool = ProcessPoolExecutor(min(workers, len(left)), mp_context=spawn)
        try:
            futures = {pool.submit(function, *call): i for i, call in left.items()}
            while futures:
                for future in wait(futures, return_when=FIRST_COMPLETED).done:
                    i = futures.pop(future)
                    result = future.result()
                    del left[i]
                    deaths = 0
                    yield i, result
        except BrokenProcessPool:
            deaths += 1
            if deaths > DEATHS:
                raise RuntimeError(
                    f"workers died {deaths} times without finishing a call; "
                    "write --workers 1 if memory is short, or --backend local to see the reason"
                ) from None
        finally:
            pool.shutdown(wait=False, cancel_futures=True)
            if left:  # broken off: nobody waits for what still runs
                for worker in set(multiprocessing.active_children()) - others:
                    worker.terminate()


def _on_ray(
    function: Callable[..., Any], calls: Sequence[tuple[Any, ...]], where: Workers
) -> Generator[Done]:
    ray = _ray()
    environment = {"env_vars": {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))}}
    own = {} if where.address else {"num_cpus": where.workers, "include_dashboard": False}
    ray.init(
        address=where.address, log_to_driver=False, runtime_env=environment, logging_level=40, **own
    )
    try:
        remote = ray.remote(max_retries=DEATHS)(function)
        most = where.workers or int(ray.cluster_resources().get("CPU", 1))
        waiting, running = list(enumerate(calls))[::-1], {}
        while waiting or running:
            while waiting and len(running) < most:
                i, call = waiting.pop()
                running[remote.remote(*call)] = i
            (ready,), _ = ray.wait(list(running))
            try:
                yield running.pop(ready), ray.get(ready)
            except ray.exceptions.RayTaskError as error:
                raise error.cause from None
    finally:
        with suppress(Exception):
            ray.shutdown()


def _ray() -> Any:
    try:
        import ray
    except ImportError:
        raise ImportError(
            'the backend "ray" needs Ray: write `pip install "visenvs[distributed]"`'
        ) from None
    return ray
