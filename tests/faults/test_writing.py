"""Files under faults: the older one stays whole, and what went wrong is one line."""

from __future__ import annotations

import json
import signal
import time

import pytest

from tests.faults.conftest import FULL
from visenvs.core.files import read_json, write_text

HALFWAY = """
import os, signal, sys
from pathlib import Path
from visenvs.core.files import replacing
with replacing(Path(sys.argv[1])) as temporary:
    temporary.write_text("half a page")
    os.kill(os.getpid(), signal.SIGKILL)
"""
AGAIN_AND_AGAIN = """
import itertools, sys
from pathlib import Path
from visenvs.core.files import write_json
path, name, times = Path(sys.argv[1]), sys.argv[2], int(sys.argv[3])
for i in range(times) if times else itertools.count():
    write_json(path, {"writer": name, "content": [name] * 20_000})
"""
ON_A_FULL_DISK = (
    FULL
    + """
import sys
from pathlib import Path
from visenvs.core.cli import finish
from visenvs.core.files import write_json
fill(1000)
finish(lambda: write_json(Path(sys.argv[1]), list(range(10_000))))
"""
)
LOCKED = """
import sys
from pathlib import Path
from visenvs.core.cli import finish
from visenvs.core.files import check_writable
finish(lambda: check_writable(Path(sys.argv[1])))
"""


def whole(path):
    """Who wrote the file, which must not be a mixture."""
    content = read_json(path)
    assert content["content"] == [content["writer"]] * 20_000
    return content["writer"]


def test_a_writer_killed_half_way_leaves_the_older_file(tmp_path, run):
    page = tmp_path / "page.html"
    page.write_text("older")
    assert run(HALFWAY, page)[0] == -signal.SIGKILL
    assert page.read_text() == "older"
    write_text(page, "newer")
    assert page.read_text() == "newer"


@pytest.mark.parametrize("after", [0.0, 0.003, 0.011])
def test_a_writer_killed_at_any_moment_leaves_a_whole_file(tmp_path, start, after):
    path = tmp_path / "a.json"
    child = start(AGAIN_AND_AGAIN, path, "one", 0)
    deadline = time.monotonic() + 120
    while not path.exists() and time.monotonic() < deadline:
        time.sleep(0.01)
    time.sleep(after)
    child.kill()
    child.wait()
    assert whole(path) == "one"


def test_two_writers_of_one_file_never_mix(tmp_path, start):
    path = tmp_path / "a.json"
    writers = [start(AGAIN_AND_AGAIN, path, name, 60) for name in ("one", "two")]
    seen = set()
    while any(child.poll() is None for child in writers):
        if path.exists():
            seen.add(whole(path))
    assert [child.returncode for child in writers] == [0, 0]
    assert seen <= {"one", "two"} and whole(path) in seen | {"one", "two"}
    assert list(tmp_path.iterdir()) == [path]


def test_a_full_disk_is_one_line_and_leaves_the_older_file(tmp_path, run):
    path = tmp_path / "a.json"
    path.write_text('{"older": true}')
    code, out, err = run(ON_A_FULL_DISK, path)
    assert (code, out) == (1, "")
    assert err.startswith("error: ") and "File too large" in err and err.count("\n") == 1
    assert json.loads(path.read_text()) == {"older": True}
    assert list(tmp_path.iterdir()) == [path]


def test_a_folder_without_the_right_to_write_is_told_at_once(locked, run, powerless):
    path = locked / "a.json"
    code, _, err = run(LOCKED, path, before=powerless)
    assert (code, err) == (1, f"error: cannot write {path}: Permission denied\n")
