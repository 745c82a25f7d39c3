"""Strict configurations: frozen dataclasses of numbers, choices and short vectors.

Every public configuration is one of these. `override` changes fields by name and explains mistakes;
`to_record` turns it into the one-element structured array that kernels read by the same names.
"""

from __future__ import annotations

import dataclasses
import difflib
import json
import math
from collections.abc import Iterable, Mapping
from functools import cache
from typing import Any, ClassVar, Literal, Protocol, TypeVar, get_args, get_origin, get_type_hints

import numpy as np
from numpy.typing import NDArray


class Config(Protocol):
    """A frozen dataclass whose fields are float, int, Literal[str, ...] or tuple[float, ...]."""

    __dataclass_fields__: ClassVar[dict[str, Any]]


C = TypeVar("C", bound=Config)
T = TypeVar("T")


def nearest(name: str, known: Iterable[str]) -> str:
    """`; did you mean 'x'?` for the closest known name, or a full stop."""
    close = difflib.get_close_matches(name, list(known), n=1, cutoff=0.5)
    return f"; did you mean {close[0]!r}?" if close else "."


def pick(kind: str, name: str, known: Mapping[str, T]) -> T:
    """The entry called `name`, or a ValueError that lists what there is."""
    if name not in tuple(known):  # compared, since what users type need not be hashable
        hint = nearest(str(name), known)
        raise ValueError(f"unknown {kind} {name!r}{hint} Known: {', '.join(known)}")
    return known[name]


def override(config: C, changes: Mapping[str, Any]) -> C:
    """The same configuration with some fields changed; unknown names and wrong types are errors."""
    hints = field_types(type(config))
    checked = {}
    for name, value in changes.items():
        if name not in hints:
            raise ValueError(
                f"{type(config).__name__} has no setting {name!r}{nearest(name, hints)} "
                f"Settings: {', '.join(hints)}"
            )
        checked[name] = _checked(type(config).__name__, name, hints[name], value)
    return dataclasses.replace(config, **checked)


def validate(config: Config) -> None:
    """Check and normalise every field of a frozen dataclass; call it first in `__post_init__`."""
    for name, hint in field_types(type(config)).items():
        object.__setattr__(
            config, name, _checked(type(config).__name__, name, hint, getattr(config, name))
        )


def require(config: Config, **conditions: bool) -> None:
    """Raise a ValueError naming the settings that fail: `require(self, dt=self.dt > 0)`."""
    wrong = [f"{name}={getattr(config, name)!r}" for name, holds in conditions.items() if not holds]
    if wrong:
        raise ValueError(f"{type(config).__name__}: out of range: {', '.join(wrong)}")


def to_record(config: Config) -> NDArray[Any]:
    """One-element structured array with the same names: floats f8, ints and choice codes i8."""
    out = np.zeros(1, _record_dtype(type(config)))
    for name, hint in field_types(type(config)).items():
        value = getattr(config, name)
        out[name] = get_args(hint).index(value) if get_origin(hint) is Literal else value
    return out


def code(config_type: type[Any], name: str, choice: str) -> int:
    """The integer that stands for a choice in the record."""
    return get_args(field_types(config_type)[name]).index(choice)


def to_json(config: Config) -> dict[str, Any]:
    """The configuration as plain JSON types."""
    return json.loads(json.dumps(dataclasses.asdict(config)))


@cache
def field_types(config_type: type[Any]) -> dict[str, Any]:
    """Resolved annotations of the dataclass fields, by name."""
    hints = get_type_hints(config_type)
    return {field.name: hints[field.name] for field in dataclasses.fields(config_type)}


@cache
def _record_dtype(config_type: type[Any]) -> np.dtype[Any]:
    columns: list[Any] = []
    for name, hint in field_types(config_type).items():
        if get_origin(hint) is tuple:
            columns.append((name, "f8", (len(get_args(hint)),)))
        else:
            columns.append((name, "f8" if hint is float else "i8"))
    return np.dtype(columns)


def _checked(owner: str, name: str, hint: Any, value: Any) -> Any:
    if get_origin(hint) is Literal:
        if value in get_args(hint):
            return value
        close = nearest(str(value), get_args(hint))
        raise ValueError(
            f"{owner}.{name}: unknown choice {value!r}{close} Choices: {', '.join(get_args(hint))}"
        )
    if get_origin(hint) is tuple:
        size = len(get_args(hint))
        single = isinstance(value, str) or not np.iterable(value)
        items: tuple[Any, ...] = () if single else tuple(value)
        if len(items) != size:
            raise ValueError(f"{owner}.{name}: expected {size} numbers, got {value!r}")
        return tuple(_number(owner, name, float, item) for item in items)
    return _number(owner, name, hint, value)


def _number(owner: str, name: str, hint: type[Any], value: Any) -> float | int:
    wanted: Any = (int, np.integer) if hint is int else (int, float, np.integer, np.floating)
    if isinstance(value, bool) or not isinstance(value, wanted) or not _finite(value):
        raise ValueError(f"{owner}.{name}: expected a finite {hint.__name__}, got {value!r}")
    return hint(value)


def _finite(value: float) -> bool:
    try:
        return math.isfinite(value)
    except OverflowError:  # an int beyond every float
        return False
