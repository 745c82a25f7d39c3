"""Discovery: one environment family or guidance law is one file, found by being there.

Environment ids are read as text, so that `import visenvs` compiles and imports no kernel.
"""

from __future__ import annotations

import importlib
import pkgutil
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from visenvs.core.lanes import Task

PACKAGE = Path(__file__).resolve().parents[1]
ID_LINE = re.compile(r'^ENV_ID = "([^"]+)"$', re.MULTILINE)


@dataclass(frozen=True)
class Law:
    """The card of one guidance law. One file in `visenvs/guidance/` makes one or several of these.

    Attributes:
        name: as typed on command lines.
        summary: one line for tables.
        source: paper and equations.
        needs: layout fields that it reads.
        settings: names of the environment's configuration that it reads.
        decide: compiled (beliefs, settings, commands) -> None. `beliefs` are records of SI values
            by layout name (n,), `settings` the configuration's record (1,), `commands` receives SI
            commands, shape (n, D). With a memory: (beliefs, settings, memory, commands).
        memory: how many numbers a row remembers from step to step, from the configuration's record
            and D; None for a law without memory. A row's memory is zeroed when an episode starts.
        limit: setting that holds the largest command, and so tells what is commanded: "a_max" for
            accelerations in N. It is the unit of the action's layout. Empty for a law that chooses:
            its command, (n, 1), is the number of a choice.
        positive: settings of which 0 leaves the law nothing to do.
    """

    name: str
    summary: str
    source: str
    needs: tuple[str, ...]
    settings: tuple[str, ...]
    decide: Callable[..., None]
    memory: Callable[[Any, int], int] | None = None
    limit: str = "a_max"
    positive: tuple[str, ...] = ()


@cache
def environment_files() -> dict[str, str]:
    """Gymnasium id -> module name of every environment family, without importing any."""
    found: dict[str, str] = {}
    for path in sorted((PACKAGE / "envs").glob("[!_]*.py")):
        match = ID_LINE.search(path.read_text(encoding="utf-8"))
        if match is None:
            raise ImportError(f'{path} has no line `ENV_ID = "visenvs/<Task>-v0"`')
        found[match.group(1)] = f"visenvs.envs.{path.stem}"
    return found


def load_task(env_id: str) -> Task:
    """The card of an environment family; a ValueError lists the known ids."""
    from visenvs.core.config import pick

    return importlib.import_module(pick("environment", env_id, environment_files())).TASK


def load_named(path: str) -> Any:
    """What "module:name" names."""
    module, name = path.split(":")
    return getattr(importlib.import_module(module), name)


@cache
def laws() -> dict[str, Law]:
    """The guidance laws that tables show, by name."""
    return {
        law.name: law
        for module in _modules("visenvs.guidance")
        for law in getattr(module, "LAWS", ())
    }


@cache
def find_law(name: str) -> Law | None:
    """The law of that name, also a member of a family such as `nsa-50`; None if there is none."""
    if name in laws():
        return laws()[name]
    families = (
        module.member for module in _modules("visenvs.guidance") if hasattr(module, "member")
    )
    return next((law for member in families if (law := member(name)) is not None), None)


def _modules(package: str) -> Iterator[Any]:
    for info in pkgutil.iter_modules(importlib.import_module(package).__path__):
        yield importlib.import_module(f"{package}.{info.name}")
