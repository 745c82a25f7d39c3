"""Where compiled kernels cannot be kept, they are compiled anew, and a warning says so."""

from __future__ import annotations

from pathlib import Path

from tests.faults.conftest import FULL

KERNEL = """
from visenvs.core.compile import kernel

@kernel
def double(x):
    return 2.0 * x
"""
CALL = """
import runpy, sys
print(runpy.run_path(sys.argv[1])["double"](21.0))
"""


def module(folder: Path) -> Path:
    path = folder / "own.py"
    path.write_text(KERNEL)
    return path


def test_a_full_disk_stops_no_kernel(tmp_path, run):
    text = f"{FULL}\nfill(0)\n{CALL}"
    code, out, err = run(text, module(tmp_path), XDG_CACHE_HOME=tmp_path, PYTHONDONTWRITEBYTECODE=1)
    assert (code, out) == (0, "42.0\n"), err
    assert f"cannot be kept in {tmp_path}" in err and "File too large" in err
    assert "write `export XDG_CACHE_HOME=FOLDER`" in err


def test_without_any_folder_to_write_kernels_still_run(tmp_path, locked, run, powerless):
    locked.chmod(0o755)
    path = module(locked)
    locked.chmod(0o555)
    places = dict.fromkeys(("XDG_CACHE_HOME", "HOME", "TMPDIR"), locked)
    out_of_reach = "import tempfile, sys; tempfile.tempdir = sys.argv[2]\n"
    code, out, err = run(out_of_reach + CALL, path, locked, before=powerless, **places)
    assert (code, out) == (0, "42.0\n"), err
    assert "no writable folder" in err and "write `export XDG_CACHE_HOME=FOLDER`" in err


def test_a_cache_that_works_is_silent_and_kept(tmp_path, run):
    path = module(tmp_path)
    assert run(CALL, path, XDG_CACHE_HOME=tmp_path) == (0, "42.0\n", "")
    assert list(tmp_path.rglob("own.double-*.nbc"))
