"""Rows: names, scaling and clipping."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from visenvs.core.lanes import as_floats
from visenvs.core.layout import Field, Layout, float_slots
from visenvs.core.loop import write_rows

LAYOUT = Layout(
    (
        Field("r", 3, "m", "N", -250.0, 250.0, 50.0, "position"),
        Field("t", 1, "s", "", 0.0, 30.0, 20.0, "time"),
        Field("z", 2, "", "C", -0.5, 1.0, 0.3, "image point"),
    )
)
LANE = np.dtype(
    [("count", "i8"), ("z", "f8", (2,)), ("r", "f8", (3,)), ("other", "f8"), ("t", "f8")]
)


@st.composite
def layouts(draw):
    bound = st.floats(-1e6, 1e6, allow_subnormal=False)
    fields = []
    for i in range(draw(st.integers(1, 4))):
        low, high = sorted(draw(st.tuples(bound, bound).filter(lambda pair: pair[0] != pair[1])))
        scale = draw(st.floats(1e-3, 1e6))
        fields.append(Field(f"f{i}", draw(st.integers(1, 4)), "m", "N", low, high, scale, ""))
    return Layout(tuple(fields))


def values_of(draw, layout, leading, low=0.0, high=1.0):
    """SI values; 0 to 1 is from a field's low to its high bound."""
    out = {}
    for field in layout.fields:
        shape = leading if field.size == 1 else (*leading, field.size)
        count = int(np.prod(shape, dtype=int))
        part = np.array(
            draw(st.lists(st.floats(low, high), min_size=count, max_size=count))
        ).reshape(shape)
        out[field.name] = field.low + part * (field.high - field.low)
    return out


@given(st.data(), layouts(), st.sampled_from([(), (1,), (3,), (2, 2)]))
def test_unpack_undoes_pack(data, layout, leading):
    values = values_of(data.draw, layout, leading)
    row = layout.pack(values)
    assert row.dtype == np.float32
    assert row.shape == (*leading, layout.size)
    back = layout.unpack(row)
    assert list(back) == list(layout.names)
    for field in layout.fields:
        assert back[field.name].shape == values[field.name].shape
        assert np.allclose(back[field.name], values[field.name], rtol=2e-7, atol=1e-30)


@given(st.data(), layouts())
def test_rows_lie_in_the_space_whatever_the_values(data, layout):
    values = values_of(data.draw, layout, (), low=-3.0, high=4.0)
    row = layout.pack(values)
    assert layout.space.contains(row)
    clipped = {f.name: np.clip(values[f.name], f.low, f.high) for f in layout.fields}
    assert np.array_equal(row, layout.pack(clipped))


@given(st.data(), layouts())
def test_the_kernel_writes_the_rows_that_pack_makes(data, layout):
    lanes = np.zeros(2, layout.dtype)
    values = values_of(data.draw, layout, (2,), low=-0.5, high=1.5)
    for name, value in values.items():
        lanes[name] = value
    rows = np.zeros((2, layout.size), np.float32)
    write_rows(as_floats(lanes), layout.slots(layout.dtype), rows)
    assert np.array_equal(rows, layout.pack(values))
    assert layout.space.contains(rows[0])


def test_the_bounds_of_the_space_are_reached():
    low = LAYOUT.pack({"r": [-1e9] * 3, "t": -1e9, "z": [-1e9] * 2})
    high = LAYOUT.pack({"r": [1e9] * 3, "t": 1e9, "z": [1e9] * 2})
    assert np.array_equal(low, LAYOUT.space.low)
    assert np.array_equal(high, LAYOUT.space.high)
    assert low.tolist() == pytest.approx([-5, -5, -5, 0, -0.5 / 0.3, -0.5 / 0.3])
    assert high.tolist() == pytest.approx([5, 5, 5, 1.5, 1 / 0.3, 1 / 0.3])


def test_records_are_unpacked_rows():
    rows = np.random.default_rng(0).uniform(-1, 1, (5, LAYOUT.size)).astype(np.float32)
    records, fields = LAYOUT.records(rows), LAYOUT.unpack(rows)
    assert records.shape == (5,)
    for name in LAYOUT.names:
        assert np.array_equal(records[name], fields[name])


def test_slots_read_a_lane_record_by_name():
    lanes = np.zeros(2, LANE)
    lanes["r"], lanes["t"], lanes["z"], lanes["other"] = (
        [[1, 2, 3], [4, 5, 6]],
        [7, 8],
        [[0.1, 0.2], [0.3, 0.4]],
        99,
    )
    rows = np.zeros((2, LAYOUT.size), np.float32)
    write_rows(as_floats(lanes), LAYOUT.slots(LANE), rows)
    expected = np.array([[1, 2, 3, 7, 0.1, 0.2], [4, 5, 6, 8, 0.3, 0.4]]) / [
        50,
        50,
        50,
        20,
        0.3,
        0.3,
    ]
    assert np.allclose(rows, expected, rtol=1e-6)


def test_numbers_that_are_not_finite_become_0():
    lanes = np.zeros(1, LANE)
    lanes["r"], lanes["t"] = [np.nan, np.inf, -np.inf], 10.0
    rows = np.ones((1, LAYOUT.size), np.float32)
    write_rows(as_floats(lanes), LAYOUT.slots(LANE), rows)
    assert rows.tolist() == [[0, 0, 0, 0.5, 0, 0]]


def test_the_table_names_every_field_with_unit_and_range():
    lines = LAYOUT.table().splitlines()
    assert len(lines) == 2 + len(LAYOUT.fields)
    assert lines[2] == "| `r` | 3 | m | N | -250 to 250 | 50 | position |"
    assert lines[4] == "| `z` | 2 | - | C | -0.5 to 1 | 0.3 | image point |"


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"r": [0, 0, 0], "t": 0}, "differs in \\['z'\\]"),
        ({"r": [0, 0, 0], "t": 0, "z": [0, 0], "y": 0}, "differs in \\['y'\\]"),
        ({"r": [0, 0], "t": 0, "z": [0, 0]}, "r: expected 3 numbers"),
    ],
)
def test_pack_refuses_what_does_not_fit(values, message):
    with pytest.raises(ValueError, match=message):
        LAYOUT.pack(values)


def test_unpack_refuses_rows_of_another_size():
    with pytest.raises(ValueError, match="6 numbers, got shape \\(2, 5\\)"):
        LAYOUT.unpack(np.zeros((2, 5)))


@pytest.mark.parametrize(
    "wrong",
    [{"size": 0}, {"low": 2.0}, {"high": np.inf}, {"low": np.nan}, {"scale": 0.0}, {"scale": -1.0}],
    ids=str,
)
def test_impossible_fields_are_refused(wrong):
    good = {
        "name": "r",
        "size": 1,
        "unit": "m",
        "frame": "",
        "low": 0.0,
        "high": 1.0,
        "scale": 1.0,
        "doc": "",
    }
    Field(**good)
    with pytest.raises(ValueError, match="field 'r'"):
        Field(**{**good, **wrong})


def test_names_must_differ():
    field = LAYOUT.fields[0]
    with pytest.raises(ValueError, match="names of their own"):
        Layout((field, field))
    with pytest.raises(ValueError, match="names of their own"):
        Layout(())


def test_float_slots_refuses_what_is_not_float64():
    with pytest.raises(ValueError, match="no field 'missing'"):
        float_slots(LANE, ["missing"])
    with pytest.raises(ValueError, match=r"'count'.*float64"):
        float_slots(LANE, ["count"])
    with pytest.raises(ValueError, match="aligned float64"):
        float_slots(np.dtype([("byte", "i1"), ("x", "f8")]), ["x"])
