"""Linear-quadratic terminal guidance: the "estimated optimal" law (thesis (4.9)-(4.12), (4.38)).

Each axis is a double integrator with x = (position, velocity) of the target relative to the
vehicle, at a cost of 1/2 x(t_f)' diag(s_x, s_v) x(t_f) + 1/2 integral of a^2 (4.2), (4.36), B = 1.
"""

from __future__ import annotations

from visenvs.core.compile import kernel
from visenvs.core.registry import Law


@kernel
def terminal_weight(T, s_x, s_v):
    """M = S_f (I + G S_f)^-1 for time to go T (s), as (M_11, M_12, M_22), for every terminal law.

    G is the controllability Gramian of the double integrator over T, defined below (4.10).
    """
    Lam = 1.0 + s_x * T**3 / 3.0 + s_v * T + s_x * s_v * T**4 / 12.0
    m11 = s_x * (1.0 + s_v * T) / Lam
    m12 = -s_x * s_v * T**2 / (2.0 * Lam)
    m22 = s_v * (1.0 + s_x * T**3 / 3.0) / Lam
    return m11, m12, m22


@kernel
def gains(T, s_x, s_v):
    """K_X (1/s^2) and K_V (1/s) of a = K_X X - K_V V (4.38).

    The printed K_X has T where (4.12) gives T^2 in its second term.
    """
    m11, m12, m22 = terminal_weight(T, s_x, s_v)
    return T * m11 + m12, T * T * m11 + 2.0 * T * m12 + m22


@kernel
def command(X, V, T, s_x, s_v, a):
    """Write the acceleration (D,), m/s^2.

    Args:
        X, V: relative position (m) and own velocity (m/s), (D,).
        T: time to go, s.
    """
    K_X, K_V = gains(T, s_x, s_v)
    for i in range(a.shape[0]):
        a[i] = K_X * X[i] - K_V * V[i]


@kernel
def cost_to_go(X, V, T, s_x, s_v):
    """Least cost still to pay with perfect information and no limits (4.10), m^2/s^3."""
    m11, m12, m22 = terminal_weight(T, s_x, s_v)
    cost = 0.0
    for i in range(X.shape[0]):
        miss = X[i] - T * V[i]  # where no further control would leave us
        cost += 0.5 * (m11 * miss * miss - 2.0 * m12 * miss * V[i] + m22 * V[i] * V[i])
    return cost


@kernel
def decide(beliefs, settings, commands):
    """The law for a batch of beliefs."""
    for i in range(beliefs.shape[0]):
        b, s = beliefs[i], settings[0]
        command(
            b["rhat_TV_N"], b["v_V_N"], max(b["t_go"], s["dt"]), s["s_x"], s["s_v"], commands[i]
        )


LAWS = (
    Law(
        name="lq",
        summary="linear-quadratic terminal guidance on the estimate as if true (estimated optimal)",
        source="thesis (4.12), (4.38) with K_X's T squared",
        needs=("rhat_TV_N", "v_V_N", "t_go"),
        settings=("dt", "s_x", "s_v"),
        decide=decide,
    ),
)
