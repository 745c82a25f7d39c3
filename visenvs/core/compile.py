"""The one way to compile a kernel, and the one place where compiled code is cached.

Numba's own on-disk cache looks only at the file of the cached function, so an edit of a kernel that
it calls in another file leaves stale machine code behind. Here the cache folder is named after the
contents of all of visenvs' kernels: any edit starts a fresh folder, and nothing stale is loaded.
"""

from __future__ import annotations

import hashlib
import os
import tempfile
import warnings
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, no_type_check

import numba
from numba.core import config
from numba.core.caching import FunctionCache

PACKAGE = Path(__file__).resolve().parents[1]
SETTINGS: Any = config  # Numba fills this module in when it is imported


class Kept(FunctionCache):
    """Numba's cache on disk, but a disk that is full or read-only stops nothing."""

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep what was compiled, or warn."""
        try:
            super().save_overload(sig, data)
        except OSError as error:
            _warn(str(error.strerror))


def compiled(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile a function for one lane, or a plain loop over lanes.

    `nogil`, cached on disk, `fastmath` off: results must not depend on how lanes are grouped. A
    wrapper for C, which nobody calls, would be a fifth of the time of compiling.
    With `NUMBA_DISABLE_JIT=1` the function stays plain Python.
    """
    options: Any = {
        "nogil": True,
        "error_model": "numpy",
        "forceinline": True,
        "no_cfunc_wrapper": True,
    }
    out: Any = numba.njit(**options)(function)
    if SETTINGS.DISABLE_JIT:
        return out
    chosen_by_user = SETTINGS.CACHE_DIR
    SETTINGS.CACHE_DIR = chosen_by_user or str(cache_folder())
    try:
        out._cache = Kept(function)
    except RuntimeError:  # no folder that Numba knows can be written
        _warn("no writable folder")
    finally:
        SETTINGS.CACHE_DIR = chosen_by_user
    return out


# Numba types a kernel from what it is called with, so the type checker is told to leave it alone.
kernel = no_type_check if TYPE_CHECKING else compiled


@cache
def cache_folder() -> Path:
    """The folder that holds the compiled kernels of exactly this source tree."""
    digest = hashlib.sha256()
    for path in sorted(PACKAGE.rglob("*.py")):
        text = path.read_bytes()
        if b"@kernel" in text:
            digest.update(path.relative_to(PACKAGE).as_posix().encode() + b"\0" + text)
    return _cache_root() / f"kernels-{digest.hexdigest()[:16]}"


def _warn(reason: str) -> None:
    warnings.warn(
        f"compiled kernels cannot be kept in {cache_folder()} ({reason}), and are compiled anew "
        "each time: write `export XDG_CACHE_HOME=FOLDER` with a folder that can be written",
        RuntimeWarning,
        stacklevel=2,
    )


def _cache_root() -> Path:
    base = os.environ.get("XDG_CACHE_HOME") or os.path.join(os.path.expanduser("~"), ".cache")
    root = Path(base) / "visenvs"
    try:
        root.mkdir(parents=True, exist_ok=True)
        if os.access(root, os.W_OK):
            return root
    except OSError:
        pass
    return Path(tempfile.gettempdir()) / f"visenvs-{os.getuid() if hasattr(os, 'getuid') else 0}"
