"""Files: whole or not at all, strict JSON, and clear words where one cannot be written or read."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

from visenvs.core.files import check_writable, read_json, write_json, write_text


def test_a_whole_file_takes_the_place_of_the_older_one(tmp_path):
    target = tmp_path / "a.md"
    target.write_text("older")
    write_text(target, "naïve")
    assert target.read_bytes() == "naïve".encode()
    assert list(tmp_path.iterdir()) == [target]


def test_what_is_no_json_is_refused_before_the_older_file_is_lost(tmp_path):
    target = tmp_path / "a.json"
    write_json(target, {"n": 1})
    with pytest.raises(TypeError):
        write_json(target, {"n": object()})
    assert read_json(target) == {"n": 1}
    assert list(tmp_path.iterdir()) == [target]


def test_numbers_that_json_does_not_know_become_null(tmp_path):
    target = tmp_path / "a.json"
    write_json(target, {1: [math.inf, (math.nan, 0.1)], "deep": {"x": -math.inf}})
    content = json.loads(target.read_text(), parse_constant=pytest.fail)
    assert content == {"1": [None, [None, 0.1]], "deep": {"x": None}}


def test_numbers_of_numpy_are_numbers(tmp_path):
    write_json(tmp_path / "a.json", {"n": np.int64(3), "x": [np.float64(math.nan), np.bool_(True)]})
    write_json(tmp_path / "b.json", np.array([[1.5, math.inf]]))
    assert read_json(tmp_path / "a.json") == {"n": 3, "x": [None, True]}
    assert read_json(tmp_path / "b.json") == [[1.5, None]]


def test_a_class_becomes_its_name(tmp_path):
    write_json(tmp_path / "a.json", {"error": KeyError})
    assert read_json(tmp_path / "a.json") == {"error": "KeyError"}


@pytest.mark.parametrize("content", [b"", b"{", b"\xff\xfe"])
def test_a_broken_file_is_named_with_what_to_do(tmp_path, content):
    (tmp_path / "a.json").write_bytes(content)
    with pytest.raises(ValueError, match=r"a.json is not JSON .*; delete it and run again"):
        read_json(tmp_path / "a.json")


def test_looking_whether_a_file_can_be_written_leaves_nothing_behind(tmp_path):
    target = tmp_path / "a.json"
    check_writable(target)
    assert list(tmp_path.iterdir()) == []
    target.write_text("older")
    check_writable(target)
    assert target.read_text() == "older"


def test_where_no_file_can_be_written_the_line_to_write_is_told(tmp_path):
    with pytest.raises(FileNotFoundError, match=rf"write `mkdir -p {tmp_path / 'nowhere'}`"):
        check_writable(tmp_path / "nowhere" / "a.json")
    with pytest.raises(IsADirectoryError, match="it is a folder; name a file in it"):
        check_writable(tmp_path)
    with pytest.raises(OSError, match=r"cannot write .*x: File name too long"):
        check_writable(tmp_path / ("x" * 250))
