"""Files written whole or not at all, and read back with a clear word when they are broken."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from typing import Any


def check_writable(path: Path) -> None:
    """Raise an OSError with the reason if a file cannot be written there; leaves nothing behind."""
    if not path.parent.is_dir():
        raise FileNotFoundError(
            f"cannot write {path}: no folder {path.parent}; write `mkdir -p {path.parent}`"
        )
    if path.is_dir():
        raise IsADirectoryError(f"cannot write {path}: it is a folder; name a file in it")
    trial = _temporary(path)
    try:
        trial.touch()
        trial.unlink()
    except OSError as error:
        raise OSError(f"cannot write {path}: {error.strerror}") from error


def write_text(path: Path, text: str) -> None:
    """Write a file whole or not at all: to a temporary file that then takes its name."""
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


@contextmanager
def replacing(path: Path) -> Generator[Path]:
    """A temporary file beside `path` with the same suffix; it takes its name if all goes well."""
    temporary = _temporary(path)
    try:
        yield temporary
        os.replace(temporary, path)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise


def write_json(path: Path, content: Any) -> None:
    """Write plain types, and numpy's, as strict JSON, whole or not at all.

    Infinity and NaN become null, and a class its name.
    """
    write_text(path, json.dumps(_plain(content), indent=1, allow_nan=False) + "\n")


def read_json(path: Path) -> Any:
    """The content of a JSON file, or a ValueError that says where it breaks off."""
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except (json.JSONDecodeError, UnicodeDecodeError) as error:
        raise ValueError(f"{path} is not JSON ({error}); delete it and run again") from error


def _plain(content: Any) -> Any:
    if isinstance(content, dict):
        return {str(key): _plain(value) for key, value in content.items()}
    if isinstance(content, list | tuple):
        return [_plain(value) for value in content]
    if hasattr(content, "tolist"):  # of numpy, which is not imported for this
        return _plain(content.tolist())
    if isinstance(content, float) and not math.isfinite(content):
        return None
    if isinstance(content, type):
        return content.__name__
    return content


def _temporary(path: Path) -> Path:
    return path.with_name(f".{path.stem}.{os.getpid()}.tmp{path.suffix}")
