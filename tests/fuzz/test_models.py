"""Model files with anything in them load or are refused with a ValueError, and run no code."""

from __future__ import annotations

import io
import json
import zipfile

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from stable_baselines3 import PPO

from agents.loading import load_network
from tests.agents.test_learned import Still, rewritten
from visenvs.core.registry import load_task

TASK = load_task("visenvs/Rendezvous-v0")
JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=8), inner),
    max_leaves=6,
)
SHAPES = st.lists(st.integers(0, 5), max_size=4)


@pytest.fixture(scope="module")
def model(tmp_path_factory):
    path = tmp_path_factory.mktemp("model") / "model.zip"
    settings = {"net_arch": [4]}
    PPO("MlpPolicy", Still(), n_steps=8, batch_size=8, policy_kwargs=settings).save(path)
    return path


@pytest.fixture(scope="module")
def parts(model):
    with zipfile.ZipFile(model) as archive:
        return {name: archive.read(name) for name in ("data", "policy.pth")}


def loads_or_refuses(path):
    """Whether it loads; anything but a ValueError that names the file comes through."""
    try:
        network = load_network(path, TASK)
    except ValueError as error:
        assert str(path) in str(error)
        return False
    network.predict(np.zeros((1, TASK.observation.size), np.float32))
    return True


def mutated(content, places):
    out = bytearray(content)
    for place, value in places:
        out[place % len(out)] = value
    return bytes(out)


PLACES = st.lists(st.tuples(st.integers(0, 1 << 20), st.integers(0, 255)), min_size=1, max_size=8)


def test_the_model_itself_loads(model):
    assert loads_or_refuses(model)


@settings(max_examples=60)
@given(places=PLACES)
def test_a_zip_with_changed_bytes(model, places):
    path = model.with_name("bytes.zip")
    path.write_bytes(mutated(model.read_bytes(), places))
    loads_or_refuses(path)


@settings(max_examples=60)
@given(name=st.sampled_from(["data", "policy.pth"]), places=PLACES)
def test_a_zip_whose_parts_have_changed_bytes(model, parts, name, places):
    target = model.with_name("parts.zip")
    loads_or_refuses(rewritten(model, target, **{name: mutated(parts[name], places)}))


@settings(max_examples=25)
@given(content=JSON, kwargs=JSON)
def test_a_zip_with_other_words(model, parts, content, kwargs):
    target = model.with_name("words.zip")
    for data in (content, {**json.loads(parts["data"]), "policy_kwargs": kwargs}):
        loads_or_refuses(rewritten(model, target, data=json.dumps(data)))


@settings(max_examples=60)
@given(data=st.data())
def test_a_zip_with_other_weights(model, parts, data):
    weights = torch.load(io.BytesIO(parts["policy.pth"]), weights_only=True)
    names = sorted(weights)
    for name in data.draw(st.lists(st.sampled_from(names), min_size=1, max_size=3)):
        weights.pop(name, None)
        other = data.draw(st.sampled_from(names) | st.text(max_size=12) | st.integers(0, 3))
        shape = SHAPES.map(torch.zeros)
        weights[other] = data.draw(shape | st.none() | st.integers(0, 3) | st.text(max_size=3))
    out = io.BytesIO()
    torch.save(weights, out)
    target = model.with_name("weights.zip")
    loads_or_refuses(rewritten(model, target, **{"policy.pth": out.getvalue()}))


def test_weights_that_claim_more_than_the_file_holds_take_no_memory(model, parts):
    weights = torch.load(io.BytesIO(parts["policy.pth"]), weights_only=True)
    weights["mlp_extractor.value_net.0.weight"] = torch.zeros(1).expand(1 << 40, 16)
    out = io.BytesIO()
    torch.save(weights, out)
    target = rewritten(model, model.with_name("huge.zip"), **{"policy.pth": out.getvalue()})
    assert target.stat().st_size < 100_000
    assert not loads_or_refuses(target)
