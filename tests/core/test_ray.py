"""The Ray backend, on a small cluster of its own; skipped where Ray is not installed."""

import pytest

from tests.core.test_parallel import refuse, square_after_a_death
from visenvs.core.parallel import Workers, completed

pytest.importorskip("ray", reason="the backend needs `pip install 'visenvs[distributed]'`")
pytestmark = pytest.mark.filterwarnings("ignore")  # Ray's own


def test_a_call_whose_worker_is_killed_is_made_again(tmp_path):
    calls = [(number, str(tmp_path)) for number in range(6)]
    found = list(completed(square_after_a_death, calls, Workers("ray", 2)))
    assert (tmp_path / "killed").exists()
    assert sorted(found) == [(i, i * i) for i in range(6)]
    with pytest.raises(ValueError, match="no 7 here"):
        list(completed(refuse, [(7,)], Workers("ray", 1)))
