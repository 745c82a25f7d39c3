"""Counter-based randomness: every draw is a pure function of where it is used.

A draw is named by (seed, episode, stream, step, k): the lane's seed, its episode since that seed
was given, which noise source, which time step, and which of several draws. No generator state
exists, so a result cannot depend on how many lanes run beside it, and adding a noise source shifts
no other.

The bits are Philox4x32-10 (Salmon et al. 2011, "Parallel random numbers: as easy as 1, 2, 3").
"""

from __future__ import annotations

import math

import numpy as np

from visenvs.core.compile import kernel

_MASK = np.uint64(0xFFFFFFFF)
_HALF = np.uint64(32)
_M0 = np.uint64(0xD2511F53)
_M1 = np.uint64(0xCD9E8D57)
_W0 = np.uint64(0x9E3779B9)
_W1 = np.uint64(0xBB67AE85)
_KEEP_52 = np.uint64(12)
_TO_UNIT = 1.0 / 4503599627370496.0  # 2^-52


@kernel
def philox(c0, c1, c2, c3, k0, k1):
    """Philox4x32-10: four 32-bit counter words and two key words (as uint64) to four words."""
    for _ in range(10):
        p0 = _M0 * c0
        p1 = _M1 * c2
        c0 = (p1 >> _HALF) ^ c1 ^ k0
        c1 = p1 & _MASK
        c2 = (p0 >> _HALF) ^ c3 ^ k1
        c3 = p0 & _MASK
        k0 = (k0 + _W0) & _MASK
        k1 = (k1 + _W1) & _MASK
    return c0, c1, c2, c3


@kernel
def unit(high, low):
    """Two 32-bit words (as uint64) to the middle of one of 2^52 equal cells of (0, 1), exactly."""
    return (float(((high << _HALF) | low) >> _KEEP_52) + 0.5) * _TO_UNIT


@kernel
def uniform_pair(seed, episode, stream, step, k):
    """Two independent uniform draws in (0, 1), dimensionless."""
    key = np.uint64(seed)
    w0, w1, w2, w3 = philox(
        np.uint64(step) & _MASK,
        np.uint64(k) & _MASK,
        np.uint64(stream) & _MASK,
        np.uint64(episode) & _MASK,
        key & _MASK,
        key >> _HALF,
    )
    return unit(w0, w1), unit(w2, w3)


@kernel
def uniform(seed, episode, stream, step, k):
    """One uniform draw in (0, 1), dimensionless."""
    return uniform_pair(seed, episode, stream, step, k)[0]


@kernel
def normal_pair(seed, episode, stream, step, k):
    """Two independent standard normal draws (Box and Muller 1958)."""
    u0, u1 = uniform_pair(seed, episode, stream, step, k)
    radius = math.sqrt(-2.0 * math.log(u0))
    angle = 2.0 * math.pi * u1
    return radius * math.cos(angle), radius * math.sin(angle)


@kernel
def normal(seed, episode, stream, step, k):
    """One standard normal draw."""
    return normal_pair(seed, episode, stream, step, k)[0]
