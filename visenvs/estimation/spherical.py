"""The IISc report's filter of a stationary object: relative range and angles, shape (3,).

State (r, theta, phi): range (m) and direction in N (rad, `sight.turn`) from the present position of
the camera. Predicted without error, its covariance by (3.34) in one Euler step; (3.37)-(3.40).
"""

from __future__ import annotations

import math

from visenvs.core.compile import kernel
from visenvs.core.frames import wrap_angle
from visenvs.core.sight import ray, to_angles, turn
from visenvs.estimation.sighting import update

REINIT = SMOOTHING = ("none", "literal", "inertial")  # the order of the codes
NONE, LITERAL, INERTIAL = range(3)
SMOOTHED = 10  # estimates in a mean, the present one among them (3.41)
MEAN, COUNTS, HISTORY_ROWS = SMOOTHED - 1, SMOOTHED, SMOOTHED + 1
LEAST_RANGE, LEAST_COSINE = 1.0, 1e-3  # m; guards of the division by r cos phi


@kernel
def begin(x, P, history, C, measured, prior_range, prior_deviation, cfg, scratch):
    """Start at the prior range in the direction of the first sighting, with P0 (3.30)-(3.31).

    Args: as of `inertial.begin`, and
        history: earlier estimates, (HISTORY_ROWS, 3), emptied.
    """
    D = scratch["D"]
    ray(cfg["sensor"], C, measured[0], measured[1], scratch["A"], D)
    theta, phi, length = to_angles(D[0, 0], D[1, 0], D[2, 0])
    x[0], x[1], x[2] = prior_range * length, theta, phi
    begin_covariance(P, prior_deviation * length, cfg)
    history[:] = 0.0


@kernel
def begin_covariance(P, prior_deviation, cfg):
    """Write P0 = diag(e^2, 2 w^2, 2 w^2) with w = r_0 W_V / 100 = 3 sigma_angle (3.31), (3.44)."""
    P[:] = 0.0
    P[0, 0] = prior_deviation * prior_deviation
    P[1, 1] = P[2, 2] = 18.0 * cfg["sigma_angle"] ** 2


@kernel
def flow(x, moved, F):
    """Write the slope F of the motion of the state in a step, (3.35) times dt, shape (3, 3).

    Args:
        moved: displacement of the camera in N, m, (3,); the object moves by - moved relative to it.
    """
    r, cosine = x[0], math.cos(x[2])
    c = math.copysign(max(abs(cosine), LEAST_COSINE), cosine)
    s = math.sin(x[2])
    ahead = -moved[0] * math.cos(x[1]) - moved[1] * math.sin(x[1])
    right = moved[0] * math.sin(x[1]) - moved[1] * math.cos(x[1])
    down = -s * ahead - c * moved[2]
    F[0, 0], F[0, 1], F[0, 2] = 0.0, c * right, down
    F[1, 0], F[1, 1], F[1, 2] = -right / (r * r * c), -ahead / (r * c), s * right / (r * c * c)
    F[2, 0], F[2, 1], F[2, 2] = -down / (r * r), -s * right / r, -(c * ahead - s * moved[2]) / r


@kernel
def predict(x, P, history, r_V, moved, prior_deviation, cfg, scratch):
    """Let the camera move, in place, and keep the estimate that was: P += F P + P F' + Q dt.

    Args:
        r_V: position of the camera in N after the step, m, (3,).
        moved: its displacement in the step, m, (3,).
        prior_deviation: of the range, m, for the reset of a covariance that Euler's step spoilt.
        cfg: record with dt (s), q_range (m^2/s), q_angle (rad^2/s), reinit, smoothing, sigma_angle.
    """
    A, F, W = scratch["A"], scratch["J"], scratch["W"]
    turn(x[1], x[2], A)
    remember(x, history, r_V, moved, A, cfg)
    flow(x, moved, F)
    for i in range(3):
        for j in range(3):
            W[i, j] = F[i, 0] * P[0, j] + F[i, 1] * P[1, j] + F[i, 2] * P[2, j]
    for i in range(3):
        P[i, i] += cfg["dt"] * (cfg["q_range"] if i == 0 else cfg["q_angle"])
        for j in range(i + 1):
            P[i, j] += W[i, j] + W[j, i]
            P[j, i] = P[i, j]
    X, Y, Z = x[0] * A[0, 0] - moved[0], x[0] * A[1, 0] - moved[1], x[0] * A[2, 0] - moved[2]
    x[1], x[2], x[0] = to_angles(X, Y, Z)
    guard(x, P, prior_deviation, cfg)


@kernel
def guard(x, P, prior_deviation, cfg):
    """Keep the range from zero, theta within a turn, and no variance at or below zero."""
    x[0], x[1] = max(x[0], LEAST_RANGE), wrap_angle(x[1])
    if not (P[0, 0] > 0.0 and P[1, 1] > 0.0 and P[2, 2] > 0.0):
        begin_covariance(P, prior_deviation, cfg)


@kernel
def position(x, A, r, J):
    """Write the relative position r in N (m, (3,)) and its derivative by the state, (3, 3)."""
    turn(x[1], x[2], A)
    for i in range(3):
        r[i] = x[0] * A[i, 0]
        J[i, 0], J[i, 1], J[i, 2] = A[i, 0], x[0] * A[i, 1], x[0] * A[i, 2]


@kernel
def use(x, P, C, measured, prior_deviation, cfg, scratch):
    """Use one sighting, in place; returns the NIS. Args: as of `predict` and `sighting.update`."""
    r, J = scratch["r"], scratch["J"]
    position(x, scratch["A"], r, J)
    nis = update(x, P, r, J, C, measured, cfg, scratch)
    guard(x, P, prior_deviation, cfg)
    return nis


@kernel
def remember(x, history, r_V, moved, A, cfg):
    """Keep an estimate before the step that ends it, for the two means.

    history: rows 0..8 the last estimates, the mean of all (row MEAN), and how many each holds
    (row COUNTS). LITERAL keeps (r, theta, phi), as printed; INERTIAL r_O_N, which stands still.
    """
    counts = history[COUNTS]
    row = int(counts[0]) % (SMOOTHED - 1)
    counts[0] += 1.0
    counts[1] += 1.0
    for i in range(3):
        still = r_V[i] - moved[i] + x[0] * A[i, 0]
        history[row, i] = still if cfg["smoothing"] == INERTIAL else x[i]
        kept = still if cfg["reinit"] == INERTIAL else x[i]
        change = kept - history[MEAN, i]
        turned = i == 1 and cfg["reinit"] == LITERAL
        history[MEAN, i] += (wrap_angle(change) if turned else change) / counts[1]


@kernel
def restart(x, P, history, r_V, prior_deviation, cfg, scratch):
    """End the pre-run: start anew from the mean of its estimates and P0, or go on (reinit NONE).

    The mean (3.32) is of relative positions, as printed (LITERAL): of a vehicle at speed u that is
    too far by u times half the pre-run. Smoothing begins here.
    """
    if cfg["reinit"] != NONE:
        A, mean = scratch["A"], history[MEAN]
        turn(x[1], x[2], A)
        scratch["u"][:] = 0.0
        remember(x, history, r_V, scratch["u"], A, cfg)
        for i in range(3):
            x[i] = mean[i]
        if cfg["reinit"] == INERTIAL:
            x[1], x[2], x[0] = to_angles(mean[0] - r_V[0], mean[1] - r_V[1], mean[2] - r_V[2])
        begin_covariance(P, prior_deviation, cfg)
        guard(x, P, prior_deviation, cfg)
    history[COUNTS, 0] = 0.0


@kernel
def smooth(x, history, r_V, A, cfg, r):
    """Replace a relative position r by that of the mean of the last ten estimates (3.41).

    The printed sum has twelve terms and is divided by ten; this is the mean of ten.
    """
    kept = min(int(history[COUNTS, 0]), SMOOTHED - 1)
    if cfg["smoothing"] == INERTIAL:
        for i in range(3):
            total = r_V[i] + r[i]
            for k in range(kept):
                total += history[k, i]
            r[i] = total / (kept + 1) - r_V[i]
    if cfg["smoothing"] == LITERAL:
        length = theta = phi = 0.0
        for k in range(kept):
            length += (history[k, 0] - x[0]) / (kept + 1)
            theta += wrap_angle(history[k, 1] - x[1]) / (kept + 1)
            phi += (history[k, 2] - x[2]) / (kept + 1)
        turn(x[1] + theta, x[2] + phi, A)
        for i in range(3):
            r[i] = (x[0] + length) * A[i, 0]
