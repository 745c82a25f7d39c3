"""The factored filter (`estimation.ud`) against the conventional one, in double and single.

- `double`: random problems of 39 states, 15 that move and 24 that stand still: predictions, scalar
  updates, replaced states. Largest difference from the textbook's equations, in both.
- `single/three-states`: Bierman's ill-conditioned problem, e = 1e-4, r = 1e-10. The least
  eigenvalue must not be negative.
- `single/map`: 75 states of the navigation filter's shape, rows about 1 with a noise of 1e-2 to
  1e-4. After how many of 60 images a covariance has a negative eigenvalue.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from visenvs.estimation import ud

from . import Row

CASE = "ud"
STEPS, UPDATES, FRAMES = 20, 10, 60
Array = NDArray[Any]
Filter = Callable[[Array, Array, Any], Array]


def rows(episodes: int) -> list[Row]:
    """Differences in double precision; lost signs in single precision."""
    problems = min(episodes, 50)
    state, spread = np.max([differences(seed) for seed in range(problems)], axis=0)
    out = [
        Row(f"{CASE}/double/state_gap", None, float(state), 0.0, problems, high=1e-9),
        Row(f"{CASE}/double/covariance_gap", None, float(spread), 0.0, problems, high=1e-9),
    ]
    judged = {"conventional": (None, None), "joseph": (None, 0.0), "ud": (0.0, None)}
    for name, least in three_states().items():
        at = f"{CASE}/single/three-states/{name}/least_eigenvalue"
        out.append(Row(at, None, least, 0.0, 3, *judged[name]))
    for sigma in (1e-2, 1e-3, 1e-4):
        for name, lost in broken_frames(np.float32(sigma)).items():
            at = f"{CASE}/single/map/{sigma:g}/{name}/broken_frames"
            out.append(Row(at, None, lost, 0.0, FRAMES, high=0.0 if name == "ud" else None))
    return out


def differences(seed: int) -> tuple[float, float]:
    """Largest difference of state and covariance from the conventional filter over a random run."""
    n, m, s = 39, 15, 12
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(n, n)) / np.sqrt(n)
    P, x = root @ root.T + 0.01 * np.eye(n), rng.normal(size=n)
    U, D, y, gaps = np.zeros((n, n)), np.zeros(n), x.copy(), np.zeros(2)
    ud.factorise(P, U, D)
    W, weight, column = np.empty((m, m + s)), np.empty(m + s), np.empty(m)
    f, v, b, out = np.empty(n), np.empty(n), np.empty(n), np.empty((n, n))
    for _ in range(STEPS):
        F, G = np.eye(m) + 0.05 * rng.normal(size=(m, m)), rng.normal(size=(m, s))
        q, whole = 0.01 * rng.uniform(size=s), np.eye(n)
        whole[:m, :m] = F
        P = whole @ P @ whole.T
        P[:m, :m] += G @ np.diag(q) @ G.T
        x[:m], y[:m] = F @ x[:m], F @ y[:m]
        ud.predict_leading(U, D, F, G, q, W, weight, column)
        for _ in range(UPDATES):
            h, measured = rng.normal(size=n), rng.normal()
            gain = P @ h / (h @ P @ h + 0.1)
            x, P = x + gain * (measured - h @ x), P - np.outer(gain, h @ P)
            ud.update(y, U, D, h, measured - h @ y, 0.1, f, v, b)
        j = int(rng.integers(m, n))
        P[j], P[:, j], P[j, j] = 0.0, 0.0, 1.0
        ud.replace(U, D, j, 1.0, b)
        ud.covariance(U, D, out)
        gaps = np.maximum(gaps, [np.abs(x - y).max(), np.abs(out - P).max()])
    return float(gaps[0]), float(gaps[1])


def conventional(P: Array, h: Array, r: Any) -> Array:
    """P - K h' P, as printed in most textbooks."""
    return P - np.outer(P @ h / (h @ P @ h + r), h @ P)


def joseph(P: Array, h: Array, r: Any) -> Array:
    """Joseph's form, (I - K h') P (I - K h')' + r K K'."""
    gain = P @ h / (h @ P @ h + r)
    A = np.eye(len(h), dtype=P.dtype) - np.outer(gain, h)
    return A @ P @ A.T + r * np.outer(gain, gain)


FILTERS: dict[str, Filter] = {"conventional": conventional, "joseph": joseph}


def least_eigenvalue(P: Array) -> float:
    """Of the symmetric part, in double precision."""
    return float(np.linalg.eigvalsh(0.5 * (P + P.T).astype(float)).min())


def factored(P: Array) -> tuple[Array, Array]:
    """The factors of a covariance in its own precision."""
    U, D = np.zeros_like(P), np.zeros(len(P), P.dtype)
    ud.factorise(P, U, D)
    return U, D


def three_states() -> dict[str, float]:
    """Least eigenvalue of each filter's covariance after three nearly equal measurements.

    For the factors it is the least D, which has the sign of it.
    """
    e, r = np.float32(1e-4), np.float32(1e-10)
    seen = np.array([[1, 1, 1], [1, 1, 1 + e], [1, 1 + e, 1]], np.float32)
    start = np.eye(3, dtype=np.float32)
    out: dict[str, float] = {}
    for name, use in FILTERS.items():
        P = start
        for h in seen:
            P = use(P, h, r)
        out[name] = least_eigenvalue(P)
    U, D = factored(start)
    x, f, v, b = np.zeros((4, 3), np.float32)
    for h in seen:
        ud.update(x, U, D, h, np.float32(0), r, f, v, b)
    return {**out, "ud": float(D.min())}


def broken_frames(sigma: np.float32) -> dict[str, int]:
    """After how many images each filter's covariance has a negative eigenvalue (a negative D)."""
    n, m, s, r = 75, 15, 12, sigma * sigma
    rng = np.random.default_rng(75)
    F = np.eye(m, dtype=np.float32)
    F[:6, 3:9] += 0.05 * np.eye(6, dtype=np.float32)
    G = np.eye(m, s, k=-3, dtype=np.float32)
    q = np.full(s, 1e-6, np.float32)
    whole = np.eye(n, dtype=np.float32)
    whole[:m, :m] = F
    lost = dict.fromkeys([*FILTERS, "ud"], 0)
    P: dict[str, Array] = {name: np.eye(n, dtype=np.float32) for name in FILTERS}
    U, D = factored(np.eye(n, dtype=np.float32))
    W, weight = np.empty((m, m + s), np.float32), np.empty(m + s, np.float32)
    x, f, v, b = np.zeros((4, n), np.float32)
    for _ in range(FRAMES):
        for name in FILTERS:
            P[name] = whole @ P[name] @ whole.T
            P[name][:m, :m] += G @ np.diag(q) @ G.T
        ud.predict_leading(U, D, F, G, q, W, weight, f[:m])
        for _ in range(40):
            h: Array = np.zeros(n, np.float32)
            j = m + 3 * int(rng.integers((n - m) // 3))
            h[:9] = rng.normal(size=9).astype(np.float32)
            h[j : j + 3] = rng.normal(size=3).astype(np.float32)
            for name, use in FILTERS.items():
                P[name] = use(P[name], h, r)
            ud.update(x, U, D, h, np.float32(0), r, f, v, b)
        for name in FILTERS:
            lost[name] += least_eigenvalue(P[name]) < 0.0
        lost["ud"] += not (D > 0).all()
    return lost
