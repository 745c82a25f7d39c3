"""The network for lists: order does not matter, absent things count for nothing, files are safe."""

import numpy as np
import pytest
import torch
from gymnasium import Env
from stable_baselines3 import PPO

from agents.loading import load_network
from agents.networks import set_network
from agents.sets import SetNetwork
from visenvs.core.layout import Field, Layout

THINGS = 4
LAYOUT = Layout(
    (
        Field("v", 2, "m/s", "N", -1.0, 1.0, 1.0, "own velocity"),
        Field("r", 3 * THINGS, "m", "N", -1.0, 1.0, 1.0, "places", THINGS),
        Field("t", 1, "s", "", 0.0, 1.0, 1.0, "time"),
        Field("size", THINGS, "m", "", 0.0, 1.0, 1.0, "radii", THINGS),
    )
)


def network():
    torch.manual_seed(0)
    return SetNetwork(LAYOUT.space, LAYOUT, 8)


def row(rng, count=THINGS):
    """Values of a row that lists `count` things, (r, size) shaped thing by thing."""
    r, size = rng.uniform(-1, 1, (THINGS, 3)), rng.uniform(0.1, 1, THINGS)
    r[count:], size[count:] = 0.0, 0.0
    return {"v": rng.uniform(-1, 1, 2), "r": r, "t": 0.5, "size": size}


def features(net, values):
    packed = LAYOUT.pack(values | {"r": values["r"].ravel()})
    with torch.no_grad():
        return net(torch.from_numpy(packed[None])).numpy()[0]


def test_columns_of_each_thing_are_found():
    once, listed = LAYOUT.members()
    assert once.tolist() == [0, 1, 14]
    assert listed.tolist() == [[2, 3, 4, 15], [5, 6, 7, 16], [8, 9, 10, 17], [11, 12, 13, 18]]


def test_a_row_without_a_list_has_no_members():
    with pytest.raises(ValueError, match="this one lists 0"):
        Layout(LAYOUT.fields[:1]).members()
    with pytest.raises(ValueError, match="5 numbers cannot tell of 2 things alike"):
        Field("odd", 5, "", "", 0.0, 1.0, 1.0, "", 2)


def test_the_order_of_things_does_not_matter():
    net, rng = network(), np.random.default_rng(1)
    values = row(rng)
    expected = features(net, values)
    order = [2, 0, 3, 1]
    shuffled = values | {"r": values["r"][order], "size": values["size"][order]}
    assert features(net, shuffled) == pytest.approx(expected, abs=1e-6)
    other = values | {"size": values["size"][order]}  # the sizes alone change hands
    assert np.abs(features(net, other) - expected).max() > 1e-3


def test_things_that_are_not_there_count_for_nothing():
    net, rng = network(), np.random.default_rng(2)
    values = row(rng, count=2)
    moved = values | {"r": values["r"][[2, 0, 3, 1]], "size": values["size"][[2, 0, 3, 1]]}
    assert features(net, moved) == pytest.approx(features(net, values), abs=1e-6)
    none = row(rng, count=0)
    assert not features(net, none)[3:].any()


class Card:
    """What `load_network` asks of a task."""

    id, observation, action, space = "visenvs/Lists-v0", LAYOUT, LAYOUT, LAYOUT.space
    frames, views, takes = None, {}, "takes"


class Plain(Card):
    """A task whose rows list nothing."""

    observation = Layout(LAYOUT.fields[:1])
    space = observation.space


class Still(Env):
    observation_space, action_space = LAYOUT.space, LAYOUT.space


@pytest.fixture(scope="module")
def model():
    return PPO("MlpPolicy", Still(), policy_kwargs=set_network(LAYOUT, 8), device="cpu")


@pytest.fixture(scope="module")
def file(model, tmp_path_factory):
    path = tmp_path_factory.mktemp("model") / "model.zip"
    model.save(path)
    return path


def test_a_saved_policy_is_rebuilt_as_it_was(model, file):
    net, rows = load_network(file, Card), np.stack([LAYOUT.space.sample() for _ in range(20)])
    ours, _ = net.predict(rows, deterministic=True)
    theirs, _ = model.predict(rows, deterministic=True)
    assert np.array_equal(ours, theirs)


def test_it_does_not_fit_rows_without_a_list(file):
    with pytest.raises(ValueError, match="trained on observations of"):
        load_network(file, Plain)
