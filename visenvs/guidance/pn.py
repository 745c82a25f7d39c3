"""Proportional navigation to a point with a given time to go (thesis (3.26))."""

from __future__ import annotations

from visenvs.core.compile import kernel
from visenvs.core.registry import Law


@kernel
def command(X, V, T, a):
    """Write 3 (X / T^2 - V / T), shape (D,), m/s^2: the least effort that passes through X after T.

    X: position of the point relative to the vehicle, m. V: own velocity, m/s. T: time to go, s.
    """
    for i in range(a.shape[0]):
        a[i] = 3.0 * (X[i] / T - V[i]) / T


@kernel
def decide(beliefs, settings, commands):
    """The law for a batch of beliefs."""
    for i in range(beliefs.shape[0]):
        b = beliefs[i]
        command(b["rhat_TV_N"], b["v_V_N"], max(b["t_go"], settings[0]["dt"]), commands[i])


LAWS = (
    Law(
        name="pn",
        summary="proportional navigation to the estimated target at t_f, its velocity free",
        source="thesis (3.26), on all three axes",
        needs=("rhat_TV_N", "v_V_N", "t_go"),
        settings=("dt",),
        decide=decide,
    ),
)
