"""The thesis's own solver of the n-step-ahead problem, for reproduction only (thesis 4.3.1, 4.4).

Each sweep sets the pushes one after the other to what the one-sided difference of the predicted
cost asks for, and stops after SWEEPS sweeps at the latest. From no push at all it needs about
thirty: cut off at ten it stops far from the minimum, and its plans cost about twice as much to fly.
"""

from __future__ import annotations

import math

from visenvs.core.compile import kernel
from visenvs.core.units import FOOT
from visenvs.guidance.planner import PLANE, SPACE, Tape, cost

SWEEPS = 10  # N_max; the thesis does not say, its costs and its processing times both point to ten
DIFFERENCE = 1e-3 * FOOT  # push of the one-sided difference, m/s^2
SETTLED = 1e-2 * FOOT  # a sweep that changes the plan by less, in its 2-norm, is the last, m/s^2


@kernel
def onward(tape, j):
    """The same tape from step j on."""
    return Tape(
        tape.table[j:],
        tape.states[j:],
        tape.P[j:],
        tape.G[j:],
        tape.K[j:],
        tape.axis[j:],
        tape.C,
        tape.M,
        tape.L,
        tape.pairs,
        tape.work,
        tape.dots,
    )


@kernel
def sweep(axes, plan, settings, tape):
    """One sweep over the pushes of a plan (n, D), in place; returns the change's 2-norm, m/s^2.

    The push that makes the difference quotient of (4.61) vanish, with calB for the curvature.
    """
    changed = 0.0
    for j in range(plan.shape[0]):
        rest, tail = plan[j:], onward(tape, j)
        here = cost(axes, rest, settings, tail)
        for i in range(len(axes)):
            plan[j, i] += DIFFERENCE
            tape.work[0, i] = (cost(axes, rest, settings, tail) - here) / DIFFERENCE
            plan[j, i] -= DIFFERENCE
        for i in range(len(axes)):
            step = tape.work[0, i] / tape.table[j, 3] - 0.5 * DIFFERENCE
            plan[j, i] -= step
            changed += step * step
        cost(axes, plan[j : j + 1], settings, tail)  # fly it, for the steps that follow
    return math.sqrt(changed)


@kernel
def swept_plan(plan, settings, tape):
    """A plan (n, D) from no push, after at most SWEEPS sweeps; returns how many were made."""
    plan[:] = 0.0
    for k in range(SWEEPS):
        if plan.shape[1] == 2:
            changed = sweep(PLANE, plan, settings, tape)
        else:
            changed = sweep(SPACE, plan, settings, tape)
        if changed <= SETTLED:
            return k + 1
    return SWEEPS
