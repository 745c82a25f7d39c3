"""The random numbers: published known answers, distributions, and independence of neighbours."""

import itertools
import math

import numba
import numpy as np
import pytest
from scipy import stats

from visenvs.core.compile import kernel
from visenvs.core.noise import normal, normal_pair, philox, uniform, uniform_pair, unit

pytestmark = pytest.mark.kernel

COUNT = 2_000 if numba.config.DISABLE_JIT else 200_000
SIGMAS = 4.5  # a deviation beyond this many standard errors is a defect, not chance

# Random123's kat_vectors, lines "philox4x32 10": counter, key, answer
KNOWN = [
    (
        "00000000 00000000 00000000 00000000",
        "00000000 00000000",
        "6627e8d5 e169c58d bc57ac4c 9b00dbd8",
    ),
    (
        "ffffffff ffffffff ffffffff ffffffff",
        "ffffffff ffffffff",
        "408f276d 41c83b0e a20bc7c6 6d5451fd",
    ),
    (
        "243f6a88 85a308d3 13198a2e 03707344",
        "a4093822 299f31d0",
        "d16cfe09 94fdcceb 5001e420 24126ea1",
    ),
]


@kernel
def pairs(seed, episode, stream, first, k, gaussian, out):
    """Pairs of draws for consecutive steps, into (n, 2)."""
    for i in range(out.shape[0]):
        if gaussian:
            out[i, 0], out[i, 1] = normal_pair(seed, episode, stream, first + i, k)
        else:
            out[i, 0], out[i, 1] = uniform_pair(seed, episode, stream, first + i, k)


def draw(seed=1, episode=0, stream=0, first=0, k=0, *, gaussian=True):
    out = np.empty((COUNT, 2))
    pairs(seed, episode, stream, first, k, gaussian, out)
    return out


def words(text):
    return [np.uint64(int(word, 16)) for word in text.split()]


@pytest.mark.parametrize(("counter", "key", "answer"), KNOWN)
def test_philox_gives_the_published_answers(counter, key, answer):
    assert [int(word) for word in philox(*words(counter), *words(key))] == [
        int(word) for word in words(answer)
    ]


def test_a_draw_spells_its_name_into_counter_and_key():
    seed, episode, stream, step, k = (
        0x299F31D0A4093822,
        0x03707344,
        0x13198A2E,
        0x243F6A88,
        0x85A308D3,
    )
    w = words(KNOWN[2][2])
    expected = (unit(w[0], w[1]), unit(w[2], w[3]))
    assert uniform_pair(np.uint64(seed), episode, stream, step, k) == expected
    assert uniform(np.uint64(seed), episode, stream, step, k) == expected[0]
    radius = math.sqrt(-2.0 * math.log(expected[0]))
    gaussian = normal_pair(np.uint64(seed), episode, stream, step, k)
    assert gaussian == pytest.approx(
        (
            radius * math.cos(2 * math.pi * expected[1]),
            radius * math.sin(2 * math.pi * expected[1]),
        ),
        rel=1e-14,
    )
    assert normal(np.uint64(seed), episode, stream, step, k) == gaussian[0]


def test_uniform_draws_never_reach_0_or_1():
    least = unit(np.uint64(0), np.uint64(0))
    most = unit(np.uint64(0xFFFFFFFF), np.uint64(0xFFFFFFFF))
    assert least == 2.0**-53
    assert most == 1.0 - 2.0**-53
    assert unit(np.uint64(0x80000000), np.uint64(0)) == 0.5 + 2.0**-53


@pytest.mark.parametrize("column", [0, 1])
def test_moments_of_normals(column):
    x = draw()[:, column]
    n = len(x)
    assert abs(x.mean()) < SIGMAS / math.sqrt(n)
    assert abs(x.var() - 1.0) < SIGMAS * math.sqrt(2.0 / n)
    assert abs(stats.skew(x)) < SIGMAS * math.sqrt(6.0 / n)
    assert abs(stats.kurtosis(x)) < SIGMAS * math.sqrt(24.0 / n)


@pytest.mark.parametrize("column", [0, 1])
def test_distributions(column):
    assert stats.kstest(draw()[:, column], "norm").pvalue > 1e-3
    assert stats.kstest(draw(gaussian=False)[:, column], "uniform").pvalue > 1e-3


def test_the_two_of_a_pair_are_independent():
    x, y = draw().T
    for f, g in [(x, y), (x**2, y**2), (x, y**2), (x**2, y), (np.sign(x), np.sign(y))]:
        assert abs(np.corrcoef(f, g)[0, 1]) < SIGMAS / math.sqrt(COUNT)
    assert stats.kstest(0.5 * (x**2 + y**2), "expon").pvalue > 1e-3


NEIGHBOURS = {
    "seed": {"seed": 2},
    "seed, high word": {"seed": 1 + 2**32},
    "episode": {"episode": 1},
    "stream": {"stream": 1},
    "step": {"first": 1},
    "two steps on": {"first": 2},
    "k": {"k": 1},
}


@pytest.mark.parametrize("change", NEIGHBOURS.values(), ids=NEIGHBOURS)
@pytest.mark.parametrize("gaussian", [True, False])
def test_neighbours_are_independent(change, gaussian):
    here, there = draw(gaussian=gaussian), draw(**change, gaussian=gaussian)
    together = np.corrcoef(np.concatenate([here.T, there.T]))[:2, 2:]
    squared = np.corrcoef(
        np.concatenate([(here.T - here.mean()) ** 2, (there.T - there.mean()) ** 2])
    )[:2, 2:]
    expected = np.zeros((2, 2))
    assert np.abs(together - expected).max() < SIGMAS / math.sqrt(COUNT)
    assert np.abs(squared - expected).max() < SIGMAS / math.sqrt(COUNT)


def test_first_draws_of_many_seeds_are_independent_normals():
    first = np.array([normal_pair(seed, 0, 0, 0, 0) for seed in range(2000)])
    assert stats.kstest(first[:, 0], "norm").pvalue > 1e-3
    assert stats.kstest(first[:, 1], "norm").pvalue > 1e-3
    assert abs(np.corrcoef(first[:-1, 0], first[1:, 0])[0, 1]) < SIGMAS / math.sqrt(2000)


def test_a_draw_depends_on_its_name_alone():
    """Neither order nor company matters: a source that is added shifts no other."""
    names = list(itertools.product((3, 4), (0, 1), (0, 1), (5, 6), (0, 1)))
    alone = {name: normal_pair(*name) for name in names}
    assert len(set(alone.values())) == len(names)
    for name in reversed(names):
        uniform(*name[:2], 99, *name[3:])
        assert normal_pair(*name) == alone[name]
