"""n-step-ahead (nSA) and p %-ahead guidance, solved exactly (thesis 4.3).

At every step the law plans its pushes for the next n steps, flies the first one, and plans again
with the rest as its first guess. `nsa` looks ahead to the terminal time, `nsa-N` N steps, and
`ahead-P` P percent of the steps that are left (4.66). A horizon beyond the terminal time is cut
there.

The thesis solves this by sweeps of single pushes, cut off after N_max; the solution here is the
minimum. Names that end in `-gs` fly the thesis's sweeps, for reproduction (`gauss_seidel.py`).
Where the belief is the same to both sides of the flight path, so is the cost, and there is no push
until an image favours one side.
"""

from __future__ import annotations

import re
from functools import partial
from typing import Any

from visenvs.core.compile import kernel
from visenvs.core.registry import Law
from visenvs.guidance import lq
from visenvs.guidance.descent import best_plan
from visenvs.guidance.gauss_seidel import swept_plan
from visenvs.guidance.planner import begin, make_tape

ALL = 2**31  # steps: more than are ever left


@kernel
def horizon(left, steps, percent):
    """How many of the `left` steps to plan: `percent` of them, or up to `steps` if negative."""
    return int(percent * left / 100.0 + 0.5) if percent >= 0.0 else min(steps, left)


@kernel
def decide(steps, percent, sweeps, beliefs, settings, memory, commands):
    """The law for a batch of beliefs; a row's memory is its plan to t_f, the next warm start."""
    D, s = commands.shape[1], settings[0]
    most = memory.shape[1] // D
    tape = make_tape(most, D)
    for i in range(beliefs.shape[0]):
        b, plans = beliefs[i], memory[i].reshape(most, D)
        X, V, T = b["rhat_TV_N"], b["v_V_N"], max(b["t_go"], s["dt"])
        lq.command(X, V, T, s["s_x"], s["s_v"], commands[i])
        n = horizon(min(int(T / s["dt"] + 0.5), most), steps, percent)
        if n == 0:
            continue
        begin(X, V, b["chol"], T, s, n, tape)
        if sweeps:
            swept_plan(plans[:n], s, tape)
        else:
            best_plan(plans[:n], s, tape)
        for k in range(D):
            commands[i, k] += plans[0, k]
            for j in range(most - 1):
                plans[j, k] = plans[j + 1, k] if j + 1 < n else 0.0


def law(name: str, steps: int, percent: float, sweeps: bool) -> Law:
    """The card for a horizon of `percent` of what is left, or of `steps` if that is negative."""
    how = "by the thesis's truncated sweeps" if sweeps else "exactly"
    ahead = f"p = {percent:g} %" if percent >= 0.0 else "to t_f" if steps == ALL else f"n = {steps}"
    return Law(
        name=name,
        summary=f"pushes planned {how}, {ahead}",
        source="thesis (4.53)-(4.62)",
        needs=("rhat_TV_N", "chol", "v_V_N", "t_go"),
        settings=("dt", "t_f", "s_x", "s_v", "camera", "min_range", "sigma_range", "sigma_angle"),
        decide=partial(decide, steps, percent, sweeps),
        memory=plan_size,
    )


def plan_size(settings: Any, D: int) -> int:
    """Numbers in a plan to the terminal time along D axes."""
    return D * round(settings["t_f"] / settings["dt"])


def member(name: str) -> Law | None:
    """`nsa-N` with N steps, or `ahead-P` with P percent of the steps left; None for other names."""
    sweeps = name.endswith("-gs")
    stem = name.removesuffix("-gs")
    if found := re.fullmatch(r"nsa-(\d+)", stem):
        return law(name, min(int(found[1]), ALL), -1.0, sweeps)
    if found := re.fullmatch(r"ahead-(\d+(?:\.\d+)?)", stem):
        percent = float(found[1])
        if percent > 100.0:
            raise ValueError(
                f"{name}: a horizon is at most 100 percent of what is left; write ahead-100"
            )
        return law(name, 0, percent, sweeps)
    return None


LAWS = (law("nsa", ALL, -1.0, False),)
