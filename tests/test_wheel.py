"""The wheel in dist/, alone in an environment of its own and outside of the checkout."""

from __future__ import annotations

import os
import subprocess
import sys
import sysconfig
from pathlib import Path

import pytest

pytestmark = pytest.mark.wheel

DIST = Path(__file__).resolve().parents[1] / "dist"
FLY = """
import sys
from importlib.util import find_spec
import gymnasium
import visenvs
assert visenvs.__file__.startswith(sys.prefix), visenvs.__file__
assert find_spec("agents") is None and find_spec("eval") is None  # those are in the checkout
flown = [env_id for env_id in gymnasium.registry if env_id.startswith("visenvs/")]
for env_id in flown:
    env = gymnasium.make(env_id, render_mode="rgb_array")
    env.reset(seed=0)
    env.step(env.action_space.sample() * 0)
    assert env.render().any()
    env.close()
from visenvs.sensors.images.cascade_file import shipped_cascade
assert len(shipped_cascade().ends)
print(*flown)
"""


@pytest.fixture(scope="module")
def python(tmp_path_factory):
    """An interpreter with the wheel, and this one's packages without the checkout."""
    (wheel,) = DIST.glob("visenvs-*.whl")
    folder = tmp_path_factory.mktemp("wheel") / "venv"
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", folder], check=True)
    python = folder / "bin" / "python"
    pip = [sys.executable, "-m", "pip", "--python", python, "install", "--quiet"]
    subprocess.run([*pip, "--disable-pip-version-check", "--no-deps", wheel], check=True)
    (own,) = folder.glob("lib/python*/site-packages")
    # A path in a .pth file is searched, but the .pth files in it (of the checkout) are not read.
    (own / "others.pth").write_text(sysconfig.get_path("purelib") + "\n")
    return python


def run(python, *words):
    """What a command prints; kernels stay plain Python, since each would run only once."""
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    done = subprocess.run(
        [python, "-I", *words],
        cwd=python.parent,
        env={**environment, "NUMBA_DISABLE_JIT": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_every_environment_flies_and_is_drawn(python):
    from visenvs.core.registry import environment_files

    assert run(python, "-c", FLY).split() == list(environment_files())


def test_the_command_lists_them(python):
    assert "visenvs/Rendezvous-v0" in run(python, "-m", "visenvs", "list")


def test_the_sdist_is_there_too():
    (sdist,) = DIST.glob("visenvs-*.tar.gz")
    assert sdist.stat().st_size > 0
