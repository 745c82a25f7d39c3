"""Where a result comes from: versions, commit, date, command line."""

from __future__ import annotations

import platform
import shlex
import subprocess
import sys
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

PACKAGES = ("gymnasium", "numpy", "scipy", "numba", "torch", "stable-baselines3", "sb3-contrib")
CHECKOUT = Path(__file__).resolve().parents[2]


def provenance(program: str) -> dict[str, Any]:
    """Versions, commit, date (UTC) and command line of `python -m program`."""
    return {
        "versions": versions(),
        "commit": commit(),
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
        "command": shlex.join(["python", "-m", program, *sys.argv[1:]]),
    }


def versions() -> dict[str, str]:
    """Versions of Python, visenvs and the packages that decide the figures, if installed."""
    import visenvs

    found = {"python": platform.python_version(), "visenvs": visenvs.__version__}
    for name in PACKAGES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            continue
    return found


def commit(root: Path = CHECKOUT) -> str | None:
    """The checkout's commit, with `-dirty` after it if files differ; None outside git."""
    if not (root / ".git").exists():
        return None
    command = [
        "git",
        "--no-optional-locks",  # whoever is killed here leaves no lock behind
        "-C",
        str(root),
        "describe",
        "--always",
        "--dirty",
        "--abbrev=40",
        "--exclude=*",
    ]
    try:
        return subprocess.run(
            command, capture_output=True, text=True, check=True, timeout=30
        ).stdout.strip()
    except (OSError, subprocess.SubprocessError):
        return None
