"""The best plan: L-BFGS on the predicted cost, compiled, with nothing allocated on the way.

Liu and Nocedal 1989, "On the limited memory BFGS method for large scale optimization".
"""

from __future__ import annotations

import math

from visenvs.core.compile import kernel
from visenvs.guidance.planner import MEMORY, PLANE, SPACE, cost, gradient

ITERATIONS = 80
HALVINGS = 20
TOLERANCE = 1e-7  # relative gain that the slope still promises when a plan is finished


@kernel
def best_plan(plan, settings, tape):
    """`optimise` for a plan along two or three axes."""
    if plan.shape[1] == 2:
        return optimise(PLANE, plan, settings, tape)
    return optimise(SPACE, plan, settings, tape)


@kernel
def optimise(axes, plan, settings, tape):
    """Improve a plan (n, D) in place until no gain is left: L-BFGS, Armijo backtracking.

    The first guess of the inverse Hessian is 1 / calB, exact for the price of the pushes. Returns
    the predicted cost, m^2/s^3, and how often it was evaluated.
    """
    n, D = plan.shape
    x, work, pairs = plan.reshape(n * D), tape.work, tape.pairs
    g, tried, changed, d = work[0, : n * D], work[1, : n * D], work[2, : n * D], work[3, : n * D]
    value = cost(axes, plan, settings, tape)
    gradient(axes, plan, settings, tape, g.reshape(n, D))
    kept, evaluations = 0, 1
    for _ in range(ITERATIONS):
        slope = descent(g, tape, kept, d, D)
        if -slope <= TOLERANCE * (1.0 + abs(value)):
            break
        # the first guess of the Hessian knows nothing of the images: promise no more than is there
        step = min(1.0, (1.0 + abs(value)) / -slope) if kept == 0 else 1.0
        better = False
        for _ in range(HALVINGS):
            for i in range(n * D):
                tried[i] = x[i] + step * d[i]
            found = cost(axes, tried.reshape(n, D), settings, tape)
            evaluations += 1
            better = found <= value + 1e-4 * step * slope
            if better:
                break
            bend = found - value - step * slope
            step *= min(max(-0.5 * step * slope / bend, 0.1), 0.5) if bend > 0.0 else 0.5
        if not better:
            break
        value = found
        gradient(axes, tried.reshape(n, D), settings, tape, changed.reshape(n, D))
        kept = remember(x, g, tried, changed, pairs, tape.dots, kept)
    return value, evaluations


@kernel
def remember(x, g, tried, changed, pairs, dots, kept):
    """Move to the point that was tried; keep the step and the gradient's change if convex.

    A new pair takes the place of the oldest; one that is not convex leaves all of them alone.
    Returns how many have been kept so far.
    """
    sy, ss, yy = 0.0, 0.0, 0.0
    for i in range(x.shape[0]):
        s, y = tried[i] - x[i], changed[i] - g[i]
        sy += s * y
        ss += s * s
        yy += y * y
    convex, m = sy > 1e-10 * math.sqrt(ss * yy), kept % MEMORY
    for i in range(x.shape[0]):
        if convex:
            pairs[m, i], pairs[MEMORY + m, i] = tried[i] - x[i], changed[i] - g[i]
        x[i], g[i] = tried[i], changed[i]
    if not convex:
        return kept
    dots[0, m] = sy
    return kept + 1


@kernel
def descent(g, tape, kept, d, D):
    """Write the L-BFGS direction (two-loop recursion, Nocedal 1980); returns its slope g' d."""
    pairs, dots, first = tape.pairs, tape.dots, max(0, kept - MEMORY)
    for i in range(g.shape[0]):
        d[i] = -g[i]
    for k in range(kept - 1, first - 1, -1):
        m = k % MEMORY
        dots[1, m] = dot(d, pairs[m]) / dots[0, m]
        for i in range(d.shape[0]):
            d[i] -= dots[1, m] * pairs[MEMORY + m, i]
    scale = 1.0
    if kept > 0:
        m = (kept - 1) % MEMORY
        curve = 0.0
        for i in range(d.shape[0]):
            curve += pairs[MEMORY + m, i] ** 2 / tape.table[i // D, 3]
        scale = dots[0, m] / curve
    for i in range(d.shape[0]):
        d[i] *= scale / tape.table[i // D, 3]
    for k in range(first, kept):
        m = k % MEMORY
        weight = dots[1, m] - dot(d, pairs[MEMORY + m]) / dots[0, m]
        for i in range(d.shape[0]):
            d[i] += weight * pairs[m, i]
    return dot(g, d)


@kernel
def dot(a, b):
    """Inner product of a and the start of b, which may be longer: a tape holds any shorter plan."""
    total = 0.0
    for i in range(a.shape[0]):
        total += a[i] * b[i]
    return total
