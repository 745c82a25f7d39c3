"""Settings of any environment changed to anything: a configuration, or a ValueError."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.fuzz.test_models import JSON
from visenvs.core.config import field_types, override, to_json, to_record
from visenvs.core.registry import environment_files, load_task

NUMBERS = st.sampled_from([0, 1, -1, 2, 10**6, 2**63, 10**400, 1e-300, 1e300, 0.5])


@pytest.mark.parametrize("env_id", environment_files())
@settings(max_examples=60)
@given(data=st.data())
def test_override(env_id, data):
    task = load_task(env_id)
    config = data.draw(st.sampled_from(list(task.scenarios.values())))
    names = st.sampled_from(sorted(field_types(type(config)))) | st.text(max_size=4)
    values = JSON | NUMBERS | st.floats() | st.lists(NUMBERS, min_size=2, max_size=3)
    changes = data.draw(st.dictionaries(names, values, max_size=2))
    try:
        changed = override(config, changes)
    except ValueError as error:
        assert type(config).__name__ in str(error)
        return
    assert override(config, to_json(changed)) == changed
    to_record(changed)
