"""`make floors`: the oldest versions that pyproject.toml allows, as constraints, and a smoke test.

`python tests/floors.py` prints a line `name==version` for each dependency of the library;
`python tests/floors.py fly` resets, steps and draws every environment, the first one compiled.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

PYPROJECT = Path(__file__).resolve().parents[1] / "pyproject.toml"
FLY = """
import sys, gymnasium, visenvs
assert visenvs.__file__.startswith(sys.prefix), visenvs.__file__
for env_id in sys.argv[1:] or [name for name in gymnasium.registry if name.startswith("visenvs/")]:
    env = gymnasium.make(env_id, render_mode="rgb_array")
    env.reset(seed=0)
    env.step(env.action_space.sample() * 0)
    assert env.render().any()
    env.close()
    print("flies:", env_id, flush=True)
"""


def floors() -> list[str]:
    """The lowest version of every dependency; each must have one."""
    content = tomllib.loads(PYPROJECT.read_text(encoding="utf-8"))
    out: list[str] = []
    for requirement in content["project"]["dependencies"]:
        found = re.match(r"([\w-]+)>=([\d.]+)", requirement)
        if found is None:
            raise SystemExit(f"no lowest version: write `{requirement}>=...` in pyproject.toml")
        out.append(f"{found[1]}=={found[2]}")
    return out


def fly() -> None:
    """Every id as plain Python, then one of them compiled."""
    for ids, plain in ([], "1"), (["visenvs/Rendezvous-v0"], "0"):
        command = [sys.executable, "-I", "-c", FLY, *ids]
        subprocess.run(command, check=True, env=os.environ | {"NUMBA_DISABLE_JIT": plain})


if __name__ == "__main__":
    if sys.argv[1:] == ["fly"]:
        fly()
    else:
        print(*floors(), sep="\n")
