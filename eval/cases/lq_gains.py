"""The closed-form gains (4.38) against the general matrix solution (4.12) of the thesis."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

from visenvs.guidance.lq import gains

from . import Row

CASE = "lq-gains"
TRIALS = 2000
F = np.array([[0.0, 1.0], [0.0, 0.0]])
G = np.array([[0.0], [-1.0]])


def matrix_gains(T: float, s_x: float, s_v: float) -> NDArray[np.float64]:
    """K_X and K_V from -B^-1 G' e^(F'T) S_f (I + Gramian S_f)^-1 e^(FT) x, B = 1 (4.12).

    x = (X, -V): the target's velocity relative to the vehicle is minus the vehicle's own.
    """
    S_f, e = np.diag([s_x, s_v]), expm(F * T)
    block = expm(
        np.block([[-F, G @ G.T], [np.zeros((2, 2)), F.T]]) * T
    )  # Van Loan: the Gramian below (4.10)
    gramian = block[2:, 2:].T @ block[:2, 2:]
    row = -G.T @ e.T @ S_f @ np.linalg.solve(np.eye(2) + gramian @ S_f, e)
    return np.array([row[0, 0], row[0, 1]])


def rows(_episodes: int) -> list[Row]:
    """Largest relative difference over random times to go and weights."""
    rng = np.random.default_rng(412)
    worst = 0.0
    for T, s_x, s_v in zip(
        rng.uniform(0.1, 30, TRIALS),
        rng.uniform(1, 200, TRIALS),
        rng.uniform(0, 50, TRIALS),
        strict=True,
    ):
        exact = matrix_gains(T, s_x, s_v)
        worst = max(worst, float(np.abs(np.array(gains(T, s_x, s_v)) / exact - 1.0).max()))
    return [Row(f"{CASE}/max_error", None, worst, 0.0, TRIALS, 0.0, 1e-12)]
