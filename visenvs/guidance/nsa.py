"""n-step-ahead (nSA) and p %-ahead guidance, solved exactly (thesis 4.3).

At every step the law plans its pushes for the next n steps, flies the first one, and plans again with
the rest as its first guess. `nsa` looks ahead to the terminal time, `nsa-N` N steps, and `ahead-P`
P percent of the steps that are left (4.66). A horizon beyond the terminal time is cut there.

The thesis solves this by sweeps of single pushes, cut off after N_max; the solution here is the minimum.
"""

from __future__ import annotations

import re
from typing import Any

from visenvs.core.compile import kernel
from visenvs.core.registry import Law
from visenvs.guidance import lq
from visenvs.guidance.descent import best_plan
from visenvs.guidance.planner import begin, make_tape


@kernel
def horizon(left, steps, percent):
    """How many of the `left` steps to plan: at most `steps`, or `percent` of them where it is not negative."""
    return int(percent / 100.0 * left + 0.5) if percent >= 0.0 else min(steps, left)


@kernel
def decide(beliefs, settings, steps, percent, memory, commands):
    """The law for a batch of beliefs; `memory` holds each row's plan (steps to t_f x D) for a warm start."""
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
        best_plan(plans[:n], s, tape)
        for k in range(D):
            commands[i, k] += plans[0, k]
            for j in range(most - 1):
                plans[j, k] = plans[j + 1, k] if j + 1 < n else 0.0


def law(name: str, summary: str, steps: int, percent: float) -> Law:
    """The law with a horizon of `steps`, or of `percent` of what is left where that is not negative."""

    def decide_ahead(beliefs: Any, settings: Any, memory: Any, commands: Any) -> None:
        decide(beliefs, settings, steps, percent, memory, commands)

    return Law(
        name=name,
        summary=summary,
        source="thesis (4.53)-(4.62), its cost minimised with the exact gradient",
        needs=("rhat_TV_N", "chol", "v_V_N", "t_go"),
        settings=("dt", "t_f", "s_x", "s_v", "camera", "min_range", "sigma_range", "sigma_angle"),
        decide=decide_ahead,
        memory=plan_size,
    )


def plan_size(settings: Any, D: int) -> int:
    """Numbers in a plan to the terminal time along D axes."""
    return D * round(settings["t_f"] / settings["dt"])


def member(name: str) -> Law | None:
    """`nsa-N` with N steps, or `ahead-P` with P percent of the steps left; None for other names."""
    if found := re.fullmatch(r"nsa-(\d+)", name):
        steps = int(found[1])
        return law(name, f"pushes planned {steps} steps ahead, exactly", steps, -1.0)
    if found := re.fullmatch(r"ahead-(\d+(?:\.\d+)?)", name):
        percent = float(found[1])
        if percent > 100.0:
            raise ValueError(
                f"{name}: a horizon is at most 100 percent of what is left; write ahead-100"
            )
        return law(name, f"pushes planned over {percent:g} % of what is left, exactly", 0, percent)
    return None


LAWS = (
    law(
        "nsa",
        "pushes planned to the terminal time, exactly (the full-horizon optimum)",
        2**31,
        -1.0,
    ),
)
