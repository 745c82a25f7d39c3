"""Optimal tracking of a commanded path by a linear system (thesis (4.4)-(4.8), Appendix B).

Under dx/dt = F x + G a it minimises the cost (4.2), with |y|_W^2 = y' W y:

    1/2 |x(t_f) - x_f|_S_f^2 + 1/2 integral of (|x - x_c(t)|_A^2 + |a|_B^2) dt

With A = 0 it equals the closed form (4.9)-(4.10), which `guidance.lq` writes out.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
Path = Callable[[float], ArrayLike]

ROUNDING = 1e-14  # of a weight matrix, relative to its largest entry


@dataclass(frozen=True)
class Tracking:
    """The optimal law for one path, as functions of time and state.

    Attributes:
        t_0, t_f: the interval that was solved, s.
        gain: B^-1 G', shape (m, n).
    """

    t_0: float
    t_f: float
    gain: Array
    _solution: Callable[[float], Array] = field(repr=False)

    def command(self, t: float, x: ArrayLike) -> Array:
        """Optimal control a = -B^-1 G' (S x + v) (4.4); states (..., n) give controls (..., m)."""
        S, v, _ = self.coefficients(t)
        return -(self._state(x) @ S + v) @ self.gain.T

    def cost(self, t: float, x: ArrayLike) -> Array:
        """Optimal cost to go J = 1/2 x' S x + x' v + w (4.5); states (..., n) give costs (...)."""
        S, v, w = self.coefficients(t)
        state = self._state(x)
        return np.asarray(0.5 * np.sum((state @ S) * state, axis=-1) + state @ v + w)

    def coefficients(self, t: float) -> tuple[Array, Array, float]:
        """S (n, n), v (n,) and w of (4.6)-(4.8) at one time."""
        if not self.t_0 <= t <= self.t_f:
            raise ValueError(
                f"the law was solved for {self.t_0} <= t <= {self.t_f}, got t={t}; "
                "write `solve(..., t_0, t_f)` with an interval that holds it"
            )
        return _split(self._solution(t), self.gain.shape[1])

    def _state(self, x: ArrayLike) -> Array:
        state = np.asarray(x, float)
        if state.shape[-1:] != (self.gain.shape[1],):
            raise ValueError(
                f"a state of this law has {self.gain.shape[1]} numbers, got shape {state.shape}"
            )
        return state


def solve(
    F: ArrayLike,
    G: ArrayLike,
    A: ArrayLike,
    B: ArrayLike,
    S_f: ArrayLike,
    x_f: ArrayLike,
    path: Path,
    t_0: float,
    t_f: float,
) -> Tracking:
    """Integrate S, v and w backwards from the terminal time (4.6)-(4.8).

    Args:
        F, G: dynamics x' = F x + G a, shapes (n, n) and (n, m).
        A: weight of the distance to the path, shape (n, n), symmetric, positive semidefinite.
        B: weight of the control, shape (m, m), symmetric, positive definite.
        S_f: weight of the terminal error, shape (n, n), symmetric, positive semidefinite.
        x_f: desired terminal state, shape (n,).
        path: commanded state x_c(t), shape (n,), for t_0 <= t <= t_f; it may jump.
        t_0, t_f: interval, s.

    Raises:
        ValueError: a shape, a weight or the interval is wrong; the message names it.
        RuntimeError: the integration failed.
    """
    from scipy.integrate import solve_ivp

    F = _matrix("F", F, None, None)
    n = len(F)
    F = _matrix("F", F, n, n)
    G = _matrix("G", G, n, None)
    A = _weight("A", A, n, definite=False)
    B = _weight("B", B, G.shape[1], definite=True)
    S_f = _weight("S_f", S_f, n, definite=False)
    x_f = _vector("x_f", x_f, n)
    if not (np.isfinite([t_0, t_f]).all() and t_0 < t_f):
        raise ValueError(f"the interval needs finite t_0 < t_f, got t_0={t_0}, t_f={t_f}")
    gain = np.asarray(np.linalg.solve(B, G.T), float)
    price = G @ gain  # G B^-1 G'

    def slope(t: float, y: Array) -> Array:
        S, v, _ = _split(y, n)
        x_c = _vector("path(t)", path(t), n)
        dS = -(S @ F + F.T @ S + A - S @ price @ S)
        dv = -(F.T @ v - S @ price @ v - A @ x_c)
        dw = 0.5 * (v @ price @ v - x_c @ A @ x_c)
        return np.concatenate([dS.ravel(), dv, [dw]])

    end = np.concatenate([S_f.ravel(), -S_f @ x_f, [0.5 * x_f @ S_f @ x_f]])
    result = solve_ivp(
        slope, (t_f, t_0), end, method="DOP853", dense_output=True, rtol=1e-12, atol=1e-13
    )
    if not result.success:
        raise RuntimeError(
            f"could not integrate (4.6)-(4.8) from t={t_f} back to t={t_0}: {result.message}"
        )
    return Tracking(float(t_0), float(t_f), gain, result.sol)


def _split(y: Array, n: int) -> tuple[Array, Array, float]:
    S = y[: n * n].reshape(n, n)
    return 0.5 * (S + S.T), y[n * n : -1], float(y[-1])


def _vector(name: str, value: ArrayLike, size: int) -> Array:
    array = np.asarray(value, float)
    if array.shape != (size,) or not np.isfinite(array).all():
        raise ValueError(f"{name} must be {size} finite numbers, got {array.tolist()}")
    return array


def _matrix(name: str, value: ArrayLike, rows: int | None, columns: int | None) -> Array:
    array = np.asarray(value, float)
    wanted = f"({'n' if rows is None else rows}, {'m' if columns is None else columns})"
    fits = array.ndim == 2 and array.size > 0
    fits = fits and rows in (None, array.shape[0]) and columns in (None, array.shape[1])
    if not fits or not np.isfinite(array).all():
        raise ValueError(
            f"{name} must be a finite matrix of shape {wanted}, "
            f"got shape {array.shape}: {array.tolist()}"
        )
    return array


def _weight(name: str, value: ArrayLike, size: int, *, definite: bool) -> Array:
    array = _matrix(name, value, size, size)
    slack = ROUNDING * float(np.abs(array).max())
    if np.abs(array - array.T).max() > slack:
        raise ValueError(f"{name} must be symmetric, got {array.tolist()}")
    least = float(np.linalg.eigvalsh(array)[0])
    if (definite and least <= slack) or least < -slack:
        wanted = "definite" if definite else "semidefinite"
        raise ValueError(f"{name} must be positive {wanted}, its least eigenvalue is {least:g}")
    return array
