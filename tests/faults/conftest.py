"""Programs that meet a fault: killed, on a full disk, without rights, or not alone."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
FULL = """
import resource
def fill(left):  # no file grows beyond `left` bytes: writing fails as on a full disk
    resource.setrlimit(resource.RLIMIT_FSIZE, (left, left))
"""


@pytest.fixture
def start():
    """Start a Python program in the checkout; what still runs at the end is killed."""
    running = []

    def start(code, *arguments, before=(), **variables):
        child = subprocess.Popen(
            [*before, sys.executable, "-c", code, *map(str, arguments)],
            cwd=ROOT,
            env={**os.environ, **{name: str(value) for name, value in variables.items()}},
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        running.append(child)
        return child

    yield start
    for child in running:
        child.kill()
        child.communicate()


@pytest.fixture
def run(start):
    """Run a Python program to its end: exit code, output and errors."""

    def run(code, *arguments, **options):
        child = start(code, *arguments, **options)
        out, err = child.communicate(timeout=300)
        return child.returncode, out, err

    return run


@pytest.fixture
def powerless():
    """Words before a command that take root's right to write everywhere, if we are root."""
    if os.getuid() != 0:
        return ()
    if shutil.which("setpriv") is None:
        pytest.skip("root may write everywhere, and there is no setpriv to take that right")
    return ("setpriv", "--inh-caps=-all", "--bounding-set=-all")


@pytest.fixture
def locked(tmp_path):
    """A folder in which nobody but root may write."""
    folder = tmp_path / "locked"
    folder.mkdir(mode=0o555)
    yield folder
    folder.chmod(0o755)
