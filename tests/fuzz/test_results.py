"""A result file with anything in it loads whole or is refused with its name."""

from __future__ import annotations

import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from eval.metrics import Episodes
from eval.results import Result, load, save
from tests.fuzz.test_models import JSON, PLACES, mutated


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    seeds = np.arange(3)
    episodes = Episodes(seeds, ("success", "miss", "miss"), {"total_cost": np.ones(3)})
    words = dict.fromkeys(("env", "scenario", "estimator", "policy", "label", "summary"), "lq")
    words |= {"perception": "points", "information": "belief"}
    result = Result(**words, config={}, units={}, us_per_decision=None, episodes=episodes)
    return save(result, tmp_path_factory.mktemp("results"), {})


def loads_or_refuses(path):
    try:
        episodes = load(path).episodes
    except ValueError as error:
        assert str(path) in str(error)
        return False
    count = len(episodes.seeds)
    assert len(episodes.outcomes) == count
    assert all(values.shape == (count,) for values in episodes.metrics.values())
    return True


def test_the_file_itself_loads(file):
    assert loads_or_refuses(file)


@settings(max_examples=150)
@given(places=PLACES)
def test_changed_bytes(file, places):
    path = file.with_name("bytes.json")
    path.write_bytes(mutated(file.read_bytes(), places))
    loads_or_refuses(path)


@settings(max_examples=200)
@given(data=st.data())
def test_other_values(file, data):
    content = json.loads(file.read_text())
    for name in data.draw(st.lists(st.sampled_from(sorted(content)), min_size=1, max_size=2)):
        content[name] = data.draw(JSON | st.lists(st.integers() | st.none(), max_size=4))
    path = file.with_name("values.json")
    path.write_text(json.dumps(data.draw(st.just(content) | JSON)))
    loads_or_refuses(path)
