from __future__ import annotations

import subprocess
import sys

HEAVY = (
    "numba",
    "llvmlite",
    "torch",
    "cv2",
    "pymunk",
    "matplotlib",
    "scipy",
    "pettingzoo",
    "pygame",
)


def loaded_by(statement: str) -> set[str]:
    """Names of the top-level packages that a fresh interpreter has loaded after a statement."""
    code = f"{statement}\nimport sys\nprint(*{{name.partition('.')[0] for name in sys.modules}})"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return set(done.stdout.split())


def test_import_loads_nothing_heavy() -> None:
    extra = loaded_by("import visenvs") - loaded_by("import gymnasium")
    assert "visenvs" in extra
    assert extra.isdisjoint(HEAVY)


def test_import_registers_environments_without_importing_them() -> None:
    code = (
        "import sys, gymnasium, visenvs\n"
        "assert 'visenvs/Rendezvous-v0' in gymnasium.registry\n"
        "assert not any(name.startswith('visenvs.envs.') for name in sys.modules)\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
