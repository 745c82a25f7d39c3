"""The cache of compiled kernels, and the same numbers without compilation."""

import json
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import numba
import numpy as np
import pytest

from visenvs.core import compile as compiling

EPISODE = """
import json
import numpy as np
from visenvs.core.config import override, to_record
from visenvs.core.lanes import Lanes
from visenvs.core.registry import laws, load_task

task = load_task("visenvs/Rendezvous-v0")
lanes = Lanes(task, override(task.scenarios["random"], {"t_f": 3.0}), 2)
lanes.reset([11, 12])
commands = np.zeros((2, 3))
law, settings, returns, done = laws()["osa"], to_record(lanes.config), np.zeros(2), 0
while done < 2:
    law.decide(task.observation.records(lanes.rows), settings, commands)
    done = lanes.step(np.clip(commands / settings["a_max"][0], -1.0, 1.0).astype(np.float32))
    returns += lanes.rewards
fields = {name: lanes.records[name].tolist() for name in task.lane.names}
print(json.dumps({"rows": lanes.rows.tolist(), "returns": returns.tolist(), **fields}))
"""


@pytest.fixture
def package(tmp_path, monkeypatch):
    """A copy of visenvs' sources that the cache believes to be the package."""
    copy = tmp_path / "visenvs"
    shutil.copytree(compiling.PACKAGE, copy, ignore=shutil.ignore_patterns("__pycache__"))
    monkeypatch.setattr(compiling, "PACKAGE", copy)
    return copy


def folder():
    return compiling.cache_folder.__wrapped__()


def append(path, text):
    path.write_text(path.read_text(encoding="utf-8") + text, encoding="utf-8")


def test_the_folder_is_named_after_the_sources(package):
    assert folder() == folder() == compiling.cache_folder()


@pytest.mark.parametrize("file", ["core/noise.py", "estimation/ekf.py", "guidance/lq.py"])
def test_an_edit_of_any_kernel_file_starts_a_fresh_folder(package, file):
    before = folder()
    append(package / file, "# edited\n")
    assert folder() != before


def test_a_file_without_kernels_keeps_the_folder(package):
    before = folder()
    append(package / "core/outcome.py", "# edited\n")
    assert folder() == before


def test_a_kernel_file_that_moves_starts_a_fresh_folder(package):
    before = folder()
    (package / "guidance/pn.py").rename(package / "guidance/proportional.py")
    assert folder() != before


def test_the_cache_lies_where_the_user_keeps_caches(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert folder().parent == tmp_path / "visenvs"


def test_without_a_writable_home_the_cache_is_temporary(tmp_path, monkeypatch):
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    assert folder().parent.parent == Path(tempfile.gettempdir())


def test_kernels_do_not_change_the_users_numba_settings():
    def double(x):
        return 2 * x

    before = numba.config.CACHE_DIR
    assert compiling.kernel(double)(4) == 8
    assert before == numba.config.CACHE_DIR


def test_interpreted_and_compiled_kernels_give_the_same_numbers():
    """A short rendezvous under the OSA law, flown twice; only the last digits may differ."""
    results = []
    for disabled in ("0", "1"):
        environment = {**os.environ, "NUMBA_DISABLE_JIT": disabled}
        done = subprocess.run(
            [sys.executable, "-W", "error", "-c", EPISODE],
            env=environment,
            cwd=compiling.PACKAGE.parent,
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == 0, done.stderr
        results.append(json.loads(done.stdout))
    compiled, interpreted = results
    assert compiled["step"] == interpreted["step"] == [30, 30]
    assert compiled.keys() == interpreted.keys()
    for name, values in compiled.items():
        assert np.allclose(values, interpreted[name], rtol=1e-9, atol=1e-9), name
