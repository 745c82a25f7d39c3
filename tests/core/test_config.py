"""Strict configurations."""

import json
import math
from dataclasses import FrozenInstanceError, dataclass
from typing import Literal

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from visenvs.core.config import code, nearest, override, pick, require, to_json, to_record, validate


@dataclass(frozen=True)
class Sample:
    kind: Literal["near", "far"] = "near"
    duration: float = 20.0
    steps: int = 5
    target: tuple[float, float, float] = (1.0, 2.0, 3.0)

    def __post_init__(self):
        validate(self)
        require(self, duration=self.duration > 0, steps=self.steps >= 0)


number = st.floats(allow_nan=False, allow_infinity=False)
settings_of_sample = st.fixed_dictionaries(
    {},
    optional={
        "kind": st.sampled_from(["near", "far"]),
        "duration": st.floats(1e-300, 1e300),
        "steps": st.integers(0, 2**62),
        "target": st.tuples(number, number, number),
    },
)


@given(settings_of_sample)
def test_override_changes_exactly_what_is_named(changes):
    config = override(Sample(), changes)
    for name in ("kind", "duration", "steps", "target"):
        assert getattr(config, name) == changes.get(name, getattr(Sample(), name))


@given(settings_of_sample)
def test_json_round_trip(changes):
    config = override(Sample(), changes)
    assert override(Sample(), json.loads(json.dumps(to_json(config)))) == config


@given(settings_of_sample)
def test_records_hold_the_same_numbers_under_the_same_names(changes):
    config = override(Sample(), changes)
    record = to_record(config)
    assert record.shape == (1,)
    assert record["duration"][0] == config.duration
    assert record["steps"][0] == config.steps
    assert tuple(record["target"][0]) == config.target
    assert (
        record["kind"][0] == code(Sample, "kind", config.kind) == ["near", "far"].index(config.kind)
    )


def test_record_dtype():
    expected = np.dtype(
        [("kind", "i8"), ("duration", "f8"), ("steps", "i8"), ("target", "f8", (3,))]
    )
    assert to_record(Sample()).dtype == expected


def test_numbers_become_plain_python_numbers():
    config = Sample(duration=np.float32(2.0), steps=np.int64(3), target=[1, 2, np.float64(4)])
    assert type(config.duration) is float
    assert type(config.steps) is int
    assert config.target == (1.0, 2.0, 4.0)
    assert all(type(value) is float for value in config.target)
    assert config == Sample(duration=2, steps=3, target=(1, 2, 4))
    assert hash(config) == hash(Sample(duration=2, steps=3, target=(1, 2, 4)))


@pytest.mark.parametrize(
    ("typed", "meant"),
    [("duratoin", "duration"), ("step", "steps"), ("Target", "target"), ("kinds", "kind")],
)
def test_unknown_settings_name_the_nearest(typed, meant):
    with pytest.raises(
        ValueError, match=f"Sample has no setting '{typed}'; did you mean '{meant}'"
    ):
        override(Sample(), {typed: 1})


def test_unknown_settings_list_what_there_is():
    with pytest.raises(ValueError, match=r"no setting 'zzz'.*kind, duration, steps, target"):
        override(Sample(), {"zzz": 1})


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("duration", "20"),
        ("duration", None),
        ("duration", True),
        ("duration", math.nan),
        ("duration", math.inf),
        ("duration", [1.0]),
        ("steps", 2.0),
        ("steps", False),
        ("steps", "2"),
        ("target", 1.0),
        ("target", (1.0, 2.0)),
        ("target", "123"),
        ("target", (1.0, 2.0, math.nan)),
        ("target", (1.0, 2.0, "3")),
        ("kind", "middle"),
        ("kind", 0),
        ("kind", None),
    ],
)
def test_wrong_types_are_named(name, value):
    with pytest.raises(ValueError, match=f"Sample.{name}: "):
        override(Sample(), {name: value})
    with pytest.raises(ValueError, match=f"Sample.{name}: "):
        Sample(**{name: value})


def test_wrong_choices_name_the_nearest():
    with pytest.raises(
        ValueError, match=r"unknown choice 'nera'; did you mean 'near'.*Choices: near, far"
    ):
        override(Sample(), {"kind": "nera"})


def test_out_of_range_settings_are_all_named():
    with pytest.raises(ValueError, match=r"Sample: out of range: duration=-1.0, steps=-2"):
        override(Sample(), {"duration": -1, "steps": -2})


def test_configurations_are_frozen():
    with pytest.raises(FrozenInstanceError):
        Sample().duration = 3.0


def test_pick():
    known = {"random": Sample(), "thesis": Sample(steps=6)}
    assert pick("scenario", "thesis", known).steps == 6
    with pytest.raises(
        ValueError, match=r"unknown scenario 'thesiss'; did you mean 'thesis'.*random, thesis"
    ):
        pick("scenario", "thesiss", known)


def test_nearest_stays_silent_when_nothing_is_near():
    assert "did you mean" not in nearest("zzzz", ["alpha", "beta"])
