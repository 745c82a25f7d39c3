"""Memory stays flat over resets, and a leak is seen."""

import pytest

from eval import soak
from eval.soak import Options, growth, run
from visenvs.core.registry import environment_files
from visenvs.faces.single import LaneEnv


@pytest.mark.parametrize("env_id", environment_files())
def test_memory_stays_flat(env_id):
    assert growth(env_id, 300) < 0.5


def test_a_leak_is_an_error_that_names_the_environment(monkeypatch, capsys):
    kept, reset = [], LaneEnv.reset

    def leak(env, *, seed=None, options=None):
        kept.append(bytearray(b"x" * 40_000))
        return reset(env, seed=seed, options=options)

    monkeypatch.setattr(LaneEnv, "reset", leak)
    with pytest.raises(ValueError, match="more than 5 MB: visenvs/Rendezvous-v0"):
        run(Options(env="visenvs/Rendezvous-v0", resets=300))
    assert growth("visenvs/Rendezvous-v0", 300) == pytest.approx(12.0, rel=0.1)
    assert "MB in 300 resets" in capsys.readouterr().out


def test_every_environment_is_soaked_by_default(monkeypatch, capsys):
    monkeypatch.setattr(soak, "growth", lambda env_id, resets: 0.0)
    run(Options(resets=7))
    lines = capsys.readouterr().out.splitlines()
    assert lines == [f"{env_id}: +0.00 MB in 7 resets" for env_id in environment_files()]


def test_wrong_options_are_refused():
    with pytest.raises(ValueError, match="--resets must be at least 1, got 0"):
        run(Options(resets=0))
    with pytest.raises(ValueError, match="did you mean 'visenvs/Rendezvous-v0'"):
        run(Options(env="visenvs/Rendezvus-v0"))
