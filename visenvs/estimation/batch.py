"""All sightings of a stationary object at once: the maximum a posteriori estimate (Gauss-Newton).

State, prior and bounds as in `inverse_range`. Every step linearises all sightings anew at the last
estimate; one that the window no longer holds is left in the prior as it was linearised last.
A Gauss-Newton step from a Gaussian prior is a Kalman update with all rows, one by one.
"""

from __future__ import annotations

from visenvs.core.compile import kernel
from visenvs.estimation import inverse_range
from visenvs.estimation.ekf import pack_lower, update_sequential
from visenvs.estimation.sighting import linearise

STEPS = 3  # Gauss-Newton steps a sighting; they start from the estimate before it
WIDTH = 14  # numbers of a sighting: camera position (3), attitude (9), measurement (2)
# row 0 of a window: how many sightings came, the mean (3) and packed covariance (6) of the prior
COUNT, MEAN, PACKED = 0, 1, 4


@kernel
def begin(x, P, window):
    """Keep what `inverse_range.begin` wrote as the prior. window: (1 + sightings, WIDTH)."""
    window[0, COUNT] = 0.0
    keep_prior(x, P, window)


@kernel
def keep_prior(x, P, window):
    """Write mean (3,) and covariance (3, 3) of the prior into row 0."""
    for i in range(3):
        window[0, MEAN + i] = x[i]
    pack_lower(P, window[0, PACKED : PACKED + 6])


@kernel
def read_prior(window, x, P):
    """Read mean (3,) and covariance (3, 3) of the prior from row 0."""
    k = PACKED
    for i in range(3):
        x[i] = window[0, MEAN + i]
        for j in range(i + 1):
            P[i, j] = P[j, i] = window[0, k]
            k += 1


@kernel
def store(window, row, r_V, C, measured):
    """Write a sighting into a row of the window."""
    for i in range(3):
        window[row, i] = r_V[i]
        for j in range(3):
            window[row, 3 + 3 * i + j] = C[i, j]
    window[row, 12], window[row, 13] = measured[0], measured[1]


@kernel
def use_row(x, P, at, window, row, anchor, cfg, scratch):
    """Update x, P in place with a stored sighting, linearised at the state `at`; the NIS."""
    r, J, C, e = scratch["r"], scratch["J"], scratch["D"], scratch["e"]
    for i in range(3):
        for j in range(3):
            C[i, j] = window[row, 3 + 3 * i + j]
    inverse_range.position(at, anchor, window[row, 0:3], scratch["A"], r, J)
    linearise(r, J, C, window[row, 12:14], cfg, scratch)
    H = scratch["H"]
    for i in range(2):
        for a in range(3):
            e[i] += H[i, a] * (at[a] - x[a])
    return update_sequential(x, P, H, e, scratch["variance"], 0.0, scratch["B"], scratch["S"])


@kernel
def update(x, P, window, anchor, r0, r_V, C, measured, cfg, scratch):
    """Use one more sighting, in place; returns its NIS.

    Args:
        x, P: state (3,) and covariance (3, 3).
        window: as of `begin`; the oldest sighting makes room for the new one.
        anchor, r0: where the camera was at first sight, in N, m, (3,), and the prior range, m.
        r_V, C, measured, cfg, scratch: as of `inverse_range.update_unscented`.
    """
    at, nis, rows = scratch["u"], 0.0, window.shape[0] - 1
    for i in range(3):
        at[i] = x[i]
    row = 1 + int(window[0, COUNT]) % rows
    if window[0, COUNT] >= rows:
        read_prior(window, x, P)
        use_row(x, P, at, window, row, anchor, cfg, scratch)
        keep_prior(x, P, window)
    store(window, row, r_V, C, measured)
    window[0, COUNT] += 1.0
    held = min(int(window[0, COUNT]), rows)
    for _ in range(STEPS):
        read_prior(window, x, P)
        for k in range(held):
            older = 1 + (row + k) % held if held == rows else 1 + k  # the newest comes last
            nis = use_row(x, P, at, window, older, anchor, cfg, scratch)
        inverse_range.keep_in_bounds(x, r0)
        for i in range(3):
            at[i] = x[i]
    return nis
