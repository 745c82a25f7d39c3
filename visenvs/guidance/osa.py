"""One-step-ahead (OSA) guidance: the terminal law plus a push that makes the next image tell more.

Thesis 4.2.1-4.2.3: the push maximises the expected decrease in cost that one more image brings,
linearised at the estimate that the terminal law alone would reach (4.35). That is one step down the
gradient of a plan of one push, over the price calB of a push.
"""

from __future__ import annotations

import numpy as np

from visenvs.core.compile import kernel
from visenvs.core.registry import Law
from visenvs.guidance import lq
from visenvs.guidance.planner import PLANE, SPACE, begin, cost, gradient, make_tape


@kernel
def slope(nothing, settings, tape, out):
    """Write the gradient of the predicted cost at no push, (1, D), m/s, after `begin`."""
    if nothing.shape[1] == 2:
        cost(PLANE, nothing, settings, tape)
        gradient(PLANE, nothing, settings, tape, out)
    else:
        cost(SPACE, nothing, settings, tape)
        gradient(SPACE, nothing, settings, tape, out)


@kernel
def decide(beliefs, settings, commands):
    """The law for a batch of beliefs."""
    D, s = commands.shape[1], settings[0]
    tape, nothing, down = make_tape(1, D), np.zeros((1, D)), np.zeros((1, D))
    for i in range(beliefs.shape[0]):
        b = beliefs[i]
        X, V, T = b["rhat_TV_N"], b["v_V_N"], max(b["t_go"], s["dt"])
        begin(X, V, b["chol"], T, s, 1, tape)
        slope(nothing, s, tape, down)
        lq.command(X, V, T, s["s_x"], s["s_v"], commands[i])
        for k in range(D):
            commands[i, k] -= down[0, k] / tape.table[0, 3]


LAWS = (
    Law(
        name="osa",
        summary="terminal guidance plus the push that makes the next image tell more",
        source="thesis (4.35) with its H^T, exact gradient",
        needs=("rhat_TV_N", "chol", "v_V_N", "t_go"),
        settings=("dt", "s_x", "s_v", "camera", "min_range", "sigma_range", "sigma_angle"),
        decide=decide,
    ),
)
