"""Layout: the one description of an observation or action row.

A row is float32 and scaled by fixed constants to about [-1, 1]; its fields have names, units and
frames. Nothing outside this file knows at which index a field sits.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from importlib import import_module
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import ArrayLike, NDArray

Row = NDArray[np.float32]
Values = NDArray[np.float64]

SLOT = np.dtype([("source", "i8"), ("low", "f8"), ("high", "f8"), ("gain", "f8")])


@dataclass(frozen=True)
class Field:
    """One named quantity of a row.

    Attributes:
        name: as in the lane record, with its frame (`rhat_TV_N`).
        size: how many numbers.
        unit: SI unit, "" when dimensionless.
        frame: N, B, C, L (along the estimated line of sight), or "" for scalars.
        low, high: bounds in SI; values beyond them are clipped in the row.
        scale: the SI value that becomes 1 in the row.
        doc: what it is, for the tables.
        each: of how many equal things it tells, one after the other (tracks, neighbours), zeros for
            those that are not there; 1 where it tells of no such list.
    """

    name: str
    size: int
    unit: str
    frame: str
    low: float
    high: float
    scale: float
    doc: str
    each: int = 1

    def __post_init__(self) -> None:
        bounds = (self.low, self.high, self.scale)
        if (
            self.size < 1
            or not np.isfinite(bounds).all()
            or self.scale <= 0
            or self.low >= self.high
        ):
            raise ValueError(
                f"field {self.name!r}: needs size >= 1, finite low < high and scale > 0, "
                f"got size={self.size}, low={self.low}, high={self.high}, scale={self.scale}"
            )
        if self.each < 1 or self.size % self.each:
            raise ValueError(
                f"field {self.name!r}: {self.size} numbers cannot tell of {self.each} things alike"
            )


@dataclass(frozen=True)
class Layout:
    """Named fields that together make one row."""

    fields: tuple[Field, ...]

    def __post_init__(self) -> None:
        names = [field.name for field in self.fields]
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice or not names:
            raise ValueError(f"a layout needs fields with names of their own, got {names}")

    @cached_property
    def size(self) -> int:
        """How many numbers a row has."""
        return sum(field.size for field in self.fields)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Field names in row order."""
        return tuple(field.name for field in self.fields)

    @cached_property
    def scale(self) -> Values:
        """SI value of 1 in the row, shape (size,)."""
        return self._spread("scale")

    @cached_property
    def dtype(self) -> np.dtype[Any]:
        """A record of SI values with the fields' names."""
        return np.dtype(
            [(f.name, "f8", (f.size,)) if f.size > 1 else (f.name, "f8") for f in self.fields]
        )

    @cached_property
    def space(self) -> gym.spaces.Box:
        """The finite Box that every row lies in."""
        low = (self._spread("low") * self._gain).astype(np.float32)
        high = (self._spread("high") * self._gain).astype(np.float32)
        return gym.spaces.Box(low, high, dtype=np.float32)

    def pack(self, values: Mapping[str, ArrayLike]) -> Row:
        """Row or rows of SI values by name, clipped to the bounds: the inverse of `unpack`."""
        odd = sorted(set(self.names) ^ set(values))
        if odd:
            raise ValueError(f"values by name must be exactly {list(self.names)}; differs in {odd}")
        si = np.concatenate([_columns(field, values[field.name]) for field in self.fields], axis=-1)
        return (np.clip(si, self._spread("low"), self._spread("high")) * self._gain).astype(
            np.float32
        )

    def unpack(self, row: ArrayLike) -> dict[str, Values]:
        """SI values by name of a row or rows: leading dimensions kept, size-1 fields scalar."""
        si = self._si(row)
        out: dict[str, Values] = {}
        for field, start in zip(self.fields, self._starts, strict=True):
            out[field.name] = (
                si[..., start] if field.size == 1 else si[..., start : start + field.size]
            )
        return out

    def records(self, rows: ArrayLike) -> NDArray[Any]:
        """Rows (n, size) as n records of SI values by name, for kernels."""
        return np.ascontiguousarray(self._si(rows)).view(self.dtype).reshape(-1)

    def members(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Columns of what the row tells once, (a,), and of every thing that it lists, (each, m)."""
        counts = {field.each for field in self.fields} - {1}
        if len(counts) != 1:
            raise ValueError(f"a row must list one kind of things, this one lists {len(counts)}")
        once: list[int] = []
        listed: list[NDArray[np.int64]] = []
        for field, start in zip(self.fields, self._starts, strict=True):
            columns = np.arange(start, start + field.size)
            if field.each == 1:
                once.extend(columns)
            else:
                listed.append(columns.reshape(field.each, -1))
        return np.array(once, np.int64), np.concatenate(listed, axis=1)

    def columns(self, names: Sequence[str]) -> NDArray[np.int64]:
        """Columns of the named fields, in the order of the names."""
        places = {
            f.name: (start, f.size) for f, start in zip(self.fields, self._starts, strict=True)
        }
        return np.concatenate([places[n][0] + np.arange(places[n][1]) for n in names])

    def slots(self, record: np.dtype[Any]) -> NDArray[Any]:
        """Where each number of the row sits in a lane record (in 8 bytes), with its bounds."""
        out = np.zeros(self.size, SLOT)
        out["source"] = float_slots(record, self.names)
        out["low"], out["high"], out["gain"] = self._spread("low"), self._spread("high"), self._gain
        return out

    def table(self) -> str:
        """The fields as a Markdown table."""
        lines = [
            "| field | size | unit | frame | range | 1 in the row is | what |",
            "|---|---|---|---|---|---|---|",
        ]
        for f in self.fields:
            lines.append(
                f"| `{f.name}` | {f.size} | {f.unit or '-'} | {f.frame or '-'} "
                f"| {f.low:g} to {f.high:g} | {f.scale:g} | {f.doc} |"
            )
        return "\n".join(lines)

    @cached_property
    def _gain(self) -> Values:
        return 1.0 / self.scale

    @cached_property
    def _starts(self) -> list[int]:
        return [0, *np.cumsum([field.size for field in self.fields])[:-1].tolist()]

    def _spread(self, key: str) -> Values:
        return np.repeat(
            [getattr(f, key) for f in self.fields], [f.size for f in self.fields]
        ).astype(float)

    def _si(self, rows: ArrayLike) -> Values:
        array = np.asarray(rows, dtype=np.float64)
        if array.shape[-1:] != (self.size,):
            raise ValueError(
                f"a row of this layout has {self.size} numbers, got shape {array.shape}"
            )
        return array * self.scale


@dataclass(frozen=True)
class Frames:
    """A camera's pictures as observations, in place of rows: RGB, uint8, (side, side, 3 shots).

    Attributes:
        draw: "module:function" that writes the pictures of lane records, imported when it is first
            needed: (records, config record, out (n, side, side, 3 shots)) -> None.
        setting: of the configuration, that holds the side, pixels.
        shots: how many pictures an observation has, the newest first.
        side: of the pictures, pixels; 0 before the configuration is known.
    """

    draw: str
    setting: str
    shots: int = 1
    side: int = 0

    @cached_property
    def space(self) -> gym.spaces.Box:
        """The box of all pictures."""
        return gym.spaces.Box(0, 255, (self.side, self.side, 3 * self.shots), np.uint8)

    @cached_property
    def drawing(self) -> Callable[..., None]:
        """The function that draws."""
        module, function = self.draw.split(":")
        return getattr(import_module(module), function)


@dataclass(frozen=True)
class Choices:
    """A discrete action: the number of one of several named choices.

    Attributes:
        names: of the choices, in the order of their numbers. The first does nothing, and may always
            be taken.
        mask: name of a field of the lane record and of the observation, one number for each choice:
            1 where it may be taken. Empty where all always may.
        first, apiece: from the number `first` on, each of the things that the observation lists has
            so many choices of its own, the same for all, one thing after the other.
    """

    names: tuple[str, ...]
    mask: str = ""
    first: int = 0
    apiece: int = 0

    def __post_init__(self) -> None:
        if len(self.names) < 2 or len(set(self.names)) < len(self.names):
            raise ValueError(f"choices need at least two names of their own, got {self.names}")

    @property
    def size(self) -> int:
        """How many numbers an action has."""
        return 1

    @cached_property
    def space(self) -> gym.spaces.Discrete:
        """The numbers of the choices."""
        return gym.spaces.Discrete(len(self.names))

    def allowed(self, rows: ArrayLike, observation: Layout) -> NDArray[np.bool_]:
        """Which choices may be taken by observation rows (n, size), shape (n, len(names))."""
        rows = np.atleast_2d(np.asarray(rows))
        if not self.mask:
            return np.ones((len(rows), len(self.names)), bool)
        return observation.unpack(rows)[self.mask] > 0.5


def float_slots(record: np.dtype[Any], names: Sequence[str]) -> NDArray[np.int64]:
    """Positions, in units of 8 bytes, of the named float64 fields of a lane record, in order."""
    places: dict[str, Any] = {name: entry[:2] for name, entry in (record.fields or {}).items()}
    out: list[int] = []
    for name in names:
        if name not in places:
            raise ValueError(f"the lane record has no field {name!r}; it has {list(places)}")
        dtype, offset = places[name]
        if dtype.base != np.dtype("f8") or offset % 8:
            raise ValueError(
                f"field {name!r} of the lane record must be aligned float64, is {dtype} at {offset}"
            )
        out.extend(offset // 8 + i for i in range(dtype.itemsize // 8))
    return np.array(out, dtype=np.int64)


def _columns(field: Field, value: ArrayLike) -> Values:
    array = np.asarray(value, dtype=np.float64)
    if field.size == 1:
        return array[..., None]
    if array.shape[-1:] != (field.size,):
        raise ValueError(
            f"{field.name}: expected {field.size} numbers at the end, got shape {array.shape}"
        )
    return array
