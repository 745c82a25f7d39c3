"""The n-step-ahead plan: how long it takes from nothing, how that grows, and other solvers.

A problem is a belief of a task and the n pushes that are best for it (`guidance.planner`): in the
plane the Tracking2D task, in space the Rendezvous. "Cold" starts from no push, "warm" from the rest
of the plan of the step before. All of it runs in a process of its own in which BLAS has one thread:
the threads of SciPy's would wait for work that never comes, and count as SciPy's time.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from agents.registry import load
from visenvs.core.compile import kernel
from visenvs.core.config import override, to_record
from visenvs.core.lanes import Lanes
from visenvs.core.provenance import CHECKOUT
from visenvs.core.registry import load_task
from visenvs.guidance.descent import ITERATIONS, TOLERANCE, best_plan
from visenvs.guidance.gauss_seidel import swept_plan
from visenvs.guidance.planner import MEMORY, PLANE, SPACE, begin, cost, gradient, make_tape, prices

from . import SEEDS, Budget, Portion, Row, race, row

GROUP = "nsa"
WANTS = (
    "nsa/plane/100 at least 300 times the control period's rate (0.3 ms), nsa/space/200 at least "
    "20 times (5 ms), an evaluation's exponent at most about 1"
)
UNIT = "plans/CPU s"
PERIOD, LINEAR = "nsa/period", "nsa/linear"
TASKS = {"plane": "visenvs/Tracking2D-v0", "space": "visenvs/Rendezvous-v0"}
HORIZONS = (10, 20, 50, 100, 200)  # steps
LANES = 16  # beliefs of each horizon
MOMENTS = 20  # steps that they fly for the plans from the last one
REPEATS = 50  # evaluations of each plan: entering its belief does not count then
AGREEMENT = 1e-6  # of the cost at stake, what two solutions may differ by
SETTINGS = ("dt", "s_x", "s_v", "camera", "min_range", "sigma_range", "sigma_angle")
ONE_THREAD = {f"{name}_NUM_THREADS": "1" for name in ("OPENBLAS", "MKL", "OMP")}
Values = NDArray[np.float64]


@dataclass
class Problems:
    """Beliefs, first guesses of their plans, and room for the plans.

    Attributes:
        X, V: estimated relative position (m) and own velocity (m/s), (count, D).
        factor: packed lower Cholesky factors of the covariance of X, m.
        T: times to go, s, (count,).
        guesses, plans: (count, n, D), m/s^2; less than n steps are planned where less are left.
        settings: one record.
        tries: evaluations or sweeps that each plan took, (count,).
    """

    X: Values
    V: Values
    factor: Values
    T: Values
    guesses: Values
    settings: NDArray[Any]

    def __post_init__(self) -> None:
        self.plans = np.zeros_like(self.guesses)
        self.tries = np.zeros(len(self.T), np.int64)
        self.axes = PLANE if self.guesses.shape[2] == 2 else SPACE

    def cold(self) -> Problems:
        """The same beliefs without a guess."""
        return replace(self, guesses=np.zeros_like(self.guesses))

    def only(self, k: int) -> Problems:
        """The k-th problem alone."""
        arrays = ("X", "V", "factor", "T", "guesses")
        return replace(self, **{name: getattr(self, name)[k : k + 1] for name in arrays})

    def tape(self) -> Any:
        """Room for the longest plan."""
        return make_tape(*self.guesses.shape[1:])

    def enter(self, k: int, tape: Any) -> None:
        """Enter the k-th belief on a tape."""
        n = self.guesses.shape[1]
        begin(self.X[k], self.V[k], self.factor[k], self.T[k], self.settings[0], n, tape)


def rows(budget: Budget) -> list[Row]:
    """What one process of this module, in which all sides take turns, has found."""
    command = [sys.executable, "-m", __name__, str(budget.seconds), str(budget.rounds)]
    done = subprocess.run(
        command, cwd=CHECKOUT, env=os.environ | ONE_THREAD, capture_output=True, text=True
    )
    if done.returncode:
        what = " ".join(["python", *command[1:]])
        raise ValueError(f"`{what}` failed: {done.stderr.strip()[-300:]}")
    return [Row(**found) for found in json.loads(done.stdout.splitlines()[-1])]


def measured(budget: Budget) -> list[Row]:
    """Both tasks, and what they are compared with: the control period, and a linear cost."""
    (rate,) = {1.0 / first_scenario(env_id).dt for env_id in TASKS.values()}
    yardsticks = {PERIOD: [rate] * budget.rounds, LINEAR: [1.0] * budget.rounds}
    out = [row(PERIOD, "periods/s", yardsticks), row(LINEAR, "exponent of n", yardsticks)]
    for name in TASKS:
        out += task_rows(name, yardsticks, budget)
    return out


def task_rows(name: str, yardsticks: dict[str, list[float]], budget: Budget) -> list[Row]:
    """Cold plans of every horizon; for the whole flight also warm ones and other solvers'."""
    here, config = f"{GROUP}/{name}", first_scenario(TASKS[name])
    whole = round(config.t_f / config.dt)
    starts = {n: at_the_start(name, n) for n in HORIZONS}
    sides = {f"{here}/{n}": compiled(problems) for n, problems in starts.items()}
    for portion in sides.values():
        portion()
    flown = en_route(name)
    sides |= {
        f"{here}/slowest": compiled(starts[whole].only(int(np.argmax(starts[whole].tries)))),
        f"{here}/en-route": compiled(flown.cold()),
        f"{here}/en-route/warm": compiled(flown),
        f"{here}/scipy": with_scipy(starts[whole].cold()),
    }
    if name == "plane":  # the problem that the thesis has solved so
        sides[f"{here}/gauss-seidel"] = compiled(starts[whole].cold(), sweeps=True)
    rates = {**race(sides, budget), **yardsticks}
    sides = {f"{here}/evaluation/{n}": evaluations(starts[n]) for n in HORIZONS}
    rates |= race(sides, replace(budget, seconds=budget.seconds / 3))
    for kind in (here, f"{here}/evaluation"):
        rates[f"{kind}/exponent"] = exponents([rates[f"{kind}/{n}"] for n in HORIZONS])
    out = [row(f"{here}/{n}", UNIT, rates, PERIOD) for n in HORIZONS]
    out += [row(f"{here}/slowest", UNIT, rates, PERIOD)]
    return out + compared(here, whole, rates) + costs(here, starts[whole])


def compared(here: str, whole: int, rates: dict[str, list[float]]) -> list[Row]:
    """How the time grows, and the plan of a whole flight against the other ways to find it."""
    out = [
        row(f"{here}/exponent", "exponent of n", rates, LINEAR),
        row(f"{here}/evaluation/exponent", "exponent of n", rates, LINEAR),
        row(f"{here}/evaluation/{whole}", "evaluations/CPU s", rates),
        row(f"{here}/en-route", UNIT, rates, PERIOD),
        row(f"{here}/en-route/warm", UNIT, rates, f"{here}/en-route"),
    ]
    for solver in ("scipy", "gauss-seidel"):
        if f"{here}/{solver}" in rates:
            against = row(f"{here}/{whole}", UNIT, rates, f"{here}/{solver}")
            out.append(replace(against, id=f"{here}/{whole}/against-{solver}"))
            out.append(row(f"{here}/{solver}", UNIT, rates))
    return out


def costs(here: str, problems: Problems) -> list[Row]:
    """Predicted costs, medians over the beliefs: of the exact plan, of no push, of the sweeps.

    No sweeps may end below the minimum, and SciPy's search must end at it.
    """
    sides = {name: problems.cold() for name in ("exact", "no-push", "gauss-seidel", "scipy")}
    compiled(sides["exact"])()
    compiled(sides["gauss-seidel"], sweeps=True)()
    with_scipy(sides["scipy"])()
    stake, _ = predicted(problems)
    found = {name: predicted(side)[1] for name, side in sides.items()}
    check(f"{here}/scipy", np.abs(found["scipy"] - found["exact"]) / stake)
    check(f"{here}/gauss-seidel", (found["exact"] - found["gauss-seidel"]) / stake)
    unit, ours = "cm^2/s^3", f"{here}/exact/cost"
    values = {f"{here}/{name}/cost": [1e4 * float(np.median(found[name]))] for name in found}
    return [row(side, unit, values, None if side == ours else ours) for side in values]


def check(whose: str, shares: Values) -> None:
    """Raise a ValueError where a cost is not what it must be beside the exact plan's."""
    if not shares.max() <= AGREEMENT:
        raise ValueError(
            f"{whose}: its plan and the exact one differ by {shares.max():.3g} of the cost at "
            f"stake, more than {AGREEMENT:g}: one of them is no minimum"
        )


def exponents(rates: list[list[float]]) -> list[float]:
    """Of every round, the slope of log time over log n."""
    slopes, _ = np.polyfit(np.log(HORIZONS), -np.log(rates), 1)
    return [float(slope) for slope in slopes]


def first_scenario(env_id: str) -> Any:
    """The configuration that the environment has by default."""
    return next(iter(load_task(env_id).scenarios.values()))


def at_the_start(name: str, n: int) -> Problems:
    """Beliefs at the start of episodes, with the terminal time put off if n steps do not fit."""
    config = first_scenario(TASKS[name])
    config = override(config, {"t_f": max(config.t_f, n * config.dt)})
    lanes = Lanes(load_task(TASKS[name]), config, LANES)
    lanes.reset(SEEDS[:LANES])
    return gather(lanes.records, np.zeros((LANES, n, lanes.task.action.size)), config)


def en_route(name: str) -> Problems:
    """Beliefs of the first steps of flights under the law itself, with its last plans' rest."""
    task, config = load_task(TASKS[name]), first_scenario(TASKS[name])
    lanes, policy = Lanes(task, config, LANES), load(GROUP, task, config).policy
    beliefs: list[NDArray[Any]] = []
    guesses: list[Values] = []
    memory: Any = None
    lanes.reset(SEEDS[:LANES])
    for _ in range(MOMENTS):
        actions, memory = policy.predict(lanes.rows, memory)
        lanes.step(actions)
        beliefs.append(lanes.snapshot())
        guesses.append(memory.reshape(LANES, -1, task.action.size).copy())
    return gather(np.concatenate(beliefs), np.concatenate(guesses), config)


def gather(lanes: NDArray[Any], guesses: Values, config: Any) -> Problems:
    """The beliefs of lanes as problems."""
    full = to_record(config)
    settings = np.zeros(1, [(name, full.dtype[name]) for name in SETTINGS])
    for name in SETTINGS:
        settings[name] = full[name]
    fields = ("rhat_TV_N", "v_V_N", "chol", "t_go")
    X, V, factor, T = (np.ascontiguousarray(lanes[name]) for name in fields)
    return Problems(X, V, factor, T, guesses, settings)


@kernel
def plan_all(X, V, factor, T, guesses, settings, sweeps, tape, plans, tries):
    """Write the plans (count, n, D) of all beliefs, and how often each was tried."""
    s = settings[0]
    for k in range(X.shape[0]):
        n = min(plans.shape[1], int(T[k] / s["dt"] + 0.5))
        for j in range(n):
            for i in range(plans.shape[2]):
                plans[k, j, i] = guesses[k, j, i]
        begin(X[k], V[k], factor[k], T[k], s, n, tape)
        if sweeps:
            tries[k] = swept_plan(plans[k][:n], s, tape)
        else:
            tries[k] = best_plan(plans[k][:n], s, tape)[1]


@kernel
def evaluate_all(X, V, factor, T, plans, settings, tape, out):
    """Cost and gradient (n, D) of every plan, REPEATS times."""
    s = settings[0]
    for k in range(X.shape[0]):
        begin(X[k], V[k], factor[k], T[k], s, plans.shape[1], tape)
        for _ in range(REPEATS):
            if plans.shape[2] == 2:
                cost(PLANE, plans[k], s, tape)
                gradient(PLANE, plans[k], s, tape, out)
            else:
                cost(SPACE, plans[k], s, tape)
                gradient(SPACE, plans[k], s, tape, out)


def compiled(p: Problems, sweeps: bool = False) -> Portion:
    """All problems once, in one compiled loop."""
    tape = p.tape()

    def portion() -> int:
        beliefs = (p.X, p.V, p.factor, p.T, p.guesses)
        plan_all(*beliefs, p.settings, sweeps, tape, p.plans, p.tries)
        return len(p.T)

    return portion


def evaluations(p: Problems) -> Portion:
    """Cost and gradient of the plans that have been found, in one compiled loop."""
    tape, out = p.tape(), np.zeros(p.plans.shape[1:])

    def portion() -> int:
        evaluate_all(p.X, p.V, p.factor, p.T, p.plans, p.settings, tape, out)
        return REPEATS * len(p.T)

    return portion


def with_scipy(p: Problems) -> Portion:
    """All problems once by SciPy's L-BFGS-B: the same kernels, tolerance and number of pairs."""
    s, tape, slope = p.settings[0], p.tape(), np.zeros(p.plans.shape[1:])
    options = {"maxcor": MEMORY, "ftol": TOLERANCE, "maxiter": ITERATIONS}

    def function(x: Values) -> tuple[float, Values]:
        plan = x.reshape(slope.shape)
        value = cost(p.axes, plan, s, tape)
        gradient(p.axes, plan, s, tape, slope)
        return value, slope.ravel()

    def portion() -> int:
        for k in range(len(p.T)):
            p.enter(k, tape)
            guess = p.guesses[k].ravel()
            found = minimize(function, guess, jac=True, method="L-BFGS-B", options=options)
            p.plans[k], p.tries[k] = found.x.reshape(slope.shape), found.nfev
        return len(p.T)

    return portion


def predicted(p: Problems) -> tuple[Values, Values]:
    """What not knowing the target will cost, m^2/s^3, (count,): without images, and as planned."""
    s, tape, blind, planned = p.settings[0], p.tape(), np.zeros(len(p.T)), np.zeros(len(p.T))
    for k in range(len(p.T)):
        p.enter(k, tape)
        unit = prices(p.T[k], s["dt"], s["s_x"], s["s_v"])[0]
        blind[k] = 0.5 * unit * np.trace(tape.P[0, 0])
        planned[k] = blind[k] + cost(p.axes, p.plans[k], s, tape)
    return blind, planned


if __name__ == "__main__":
    budget = Budget(float(sys.argv[1]), int(sys.argv[2]))
    print(json.dumps([asdict(found) for found in measured(budget)]))
