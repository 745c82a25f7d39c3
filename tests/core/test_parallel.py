"""Calls in this process, in others and on Ray come to the same, also when workers are killed."""

import multiprocessing
import os
import signal
import time
from pathlib import Path

import pytest

from visenvs.core.parallel import Workers, check, completed


def square(number):
    return number * number


def square_after_a_death(number, folder):
    """The first worker that takes the 3 is killed, as by the kernel when memory is short."""
    if number == 3:
        try:
            (Path(folder) / "killed").touch(exist_ok=False)
        except FileExistsError:
            return square(number)
        os.kill(os.getpid(), signal.SIGKILL)
    return square(number)


def die(_number):
    os.kill(os.getpid(), signal.SIGKILL)


def refuse(number):
    raise ValueError(f"no {number} here")


def rest(seconds):
    time.sleep(seconds)


@pytest.mark.parametrize("backend", ["local", "processes"])
def test_every_call_is_made_once(backend):
    calls = [(number,) for number in range(6)]
    found = dict(completed(square, calls, Workers(backend, 2 if backend != "local" else None)))
    assert found == {i: i * i for i in range(6)}
    assert list(completed(square, [], Workers(backend))) == []


def test_a_call_whose_worker_is_killed_is_made_again(tmp_path):
    calls = [(number, str(tmp_path)) for number in range(6)]
    found = list(completed(square_after_a_death, calls, Workers("processes", 2)))
    assert (tmp_path / "killed").exists()
    assert sorted(found) == [(i, i * i) for i in range(6)]


def test_workers_that_always_die_are_given_up():
    with pytest.raises(RuntimeError, match=r"workers died 4 times .*--backend local"):
        list(completed(die, [(1,)], Workers("processes", 1)))


def test_what_runs_is_ended_when_nobody_waits_for_it():
    found = completed(rest, [(0.0,), (600.0,)], Workers("processes", 2))
    assert next(found) == (0, None)
    workers = multiprocessing.active_children()
    found.close()
    for worker in workers:
        worker.join(60.0)
    assert workers and not any(worker.is_alive() for worker in workers)


def test_errors_of_the_function_come_through():
    with pytest.raises(ValueError, match="no 7 here"):
        list(completed(refuse, [(7,)], Workers("processes", 1)))


def test_options_that_make_no_sense_are_refused():
    with pytest.raises(ValueError, match="--workers must be at least 1, got 0"):
        check(Workers("processes", 0))
    with pytest.raises(ValueError, match="--backend ray"):
        check(Workers("processes", address="10.0.0.1:6379"))
