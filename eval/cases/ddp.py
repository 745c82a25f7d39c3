"""Differential dynamic programming of the IARC paper (section IV): the plan, and landings by it.

The paper prints no figure. Without limits the problem is linear and quadratic, and the plan must
cost what a dense quadratic program does. A landing starts 1 to 4 m from a robot and 1.2 to 2.5 m
up, and is planned anew 20 times a second. The robot swerves as its firmware does, and does not
reverse meanwhile. Noise: what the tracker says of the place is wrong by so much along each axis,
anew each time (`tracker`); or that is the noise of findings, and place and heading are what the
two-model filter makes of them (`filtered`), whose headings then are the larger error.

A landing is in the path if the robot, going straight on, would run into the aircraft.
"""

from __future__ import annotations

import math
import time
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from visenvs.core.compile import kernel
from visenvs.core.config import to_record
from visenvs.core.noise import normal_pair, uniform
from visenvs.dynamics.ground_robot import drive_robot
from visenvs.estimation import mmae
from visenvs.guidance import ddp, landing
from visenvs.guidance.ddp import DDPConfig

from ..rollout import public_seeds
from . import Row, standard_error
from ._iarc import ARENA, rms, settings

CASE = "ddp"
NOISES = (0.0, 0.05, 0.1)  # m
TRACKER, FILTERED = range(2)
WATCHED = 40  # steps for which the robot is watched before a landing begins
MOST = 6.0  # longest landing, s
STEPS, SETS = 60, 40  # of the plan that is timed, and trajectories evaluated
V_MAX, A_MAX = 2.13, 3.05  # limits, m/s and m/s^2
START, TRACK = 0, 1  # noise streams
LANDED = np.dtype(
    [(name, "f8") for name in ("along", "cross", "v_max", "a_max", "sink", "level", "t")]
)
WORK = np.dtype(
    [
        ("filter", mmae.SCRATCH), ("landing", landing.LANDING), ("x", "f8", (2, 3)),
        ("P", "f8", (2, 3, 3)), ("state", "f8", 6), ("next", "f8", 6), ("place", "f8", 2),
    ]
)  # fmt: skip
Values = NDArray[np.float64]


def dense(x0: Values, aim: Values, n: int, config: DDPConfig) -> tuple[float, Values]:
    """Least cost without limits, and its plan (n, 3), by one linear system of all accelerations."""
    dt = config.dt
    A, B = np.eye(6) + dt * np.eye(6, k=3), np.vstack([0.5 * dt**2 * np.eye(3), dt * np.eye(3)])
    way = dt * np.diag([config.q_r] * 3 + [config.q_v] * 3)
    end = np.diag([config.s_r] * 3 + [config.s_v] * 3)
    free, driven = x0, np.zeros((6, 3 * n))
    H, f, cost = dt * config.r_a * np.eye(3 * n), np.zeros(3 * n), 0.0
    for k in range(n + 1):
        W, off = end if k == n else way, free - aim
        H, f, cost = H + driven.T @ W @ driven, f + driven.T @ W @ off, cost + 0.5 * off @ W @ off
        free, driven = A @ free, A @ driven
        if k < n:
            driven[:, 3 * k : 3 * k + 3] += B
    plan: Values = np.linalg.solve(H, -f).astype(np.float64)
    return float(cost + 0.5 * f @ plan), plan.reshape(n, 3)


def cost_error(seed: int) -> float:
    """Relative difference between the plan's cost without limits and that of `dense`."""
    rng = np.random.default_rng(seed)
    config = DDPConfig(rho=0.0, q_r=rng.uniform(0, 5), q_v=rng.uniform(0, 2), tolerance=0.0)
    x0, aim = rng.normal(size=6), rng.normal(size=6)
    tape = ddp.make_tape(STEPS)
    cost = ddp.improve(x0, aim, STEPS, to_record(config)[0], tape)
    return abs(cost / dense(x0, aim, STEPS, config)[0] - 1.0)


@kernel
def all_sets(x0, aim, n, sets, cfg, tape):
    """Evaluate every one of so many trajectories, without stopping where nothing is gained."""
    tape.u[:] = 0.0
    tape.k[:] = 0.0
    tape.K[:] = 0.0
    for i in range(6):
        tape.x[0, i] = x0[i]
    for _ in range(sets):
        ddp.forward(aim, n, cfg["rate"], cfg, tape)
        ddp.keep(n, tape)
        ddp.backward(aim, n, cfg, tape)


def replan_ms(repeats: int = 50) -> float:
    """CPU time of a plan from nothing with every trajectory evaluated, median, ms."""
    x0, aim = np.array([3.0, -2.0, -2.0, 0.5, 0.3, 0.0]), np.array([0.0, 0.0, 0.06, 0.0, 0.0, 0.25])
    cfg, tape, spent = to_record(DDPConfig())[0], ddp.make_tape(STEPS), []
    for _ in range(repeats + 1):
        began = time.process_time()
        all_sets(x0, aim, STEPS, SETS, cfg, tape)
        spent.append(time.process_time() - began)
    return 1e3 * float(np.median(spent[1:]))


@kernel
def begin(arena, work):
    """Draw the robot's heading, how long ago it swerved, and where the aircraft is."""
    seed, state = arena["seed"], work["state"]
    arena["heading"][0] = 2.0 * math.pi * uniform(seed, 0, START, 0, 0)
    arena["noise_t"][0] = -5.0 * uniform(seed, 0, START, 0, 1)
    away, bearing = 1.0 + 3.0 * uniform(seed, 0, START, 0, 2), uniform(seed, 0, START, 0, 3)
    state[:] = 0.0
    state[0] = away * math.cos(2.0 * math.pi * bearing)
    state[1] = away * math.sin(2.0 * math.pi * bearing)
    state[2] = -1.2 - 1.3 * uniform(seed, 0, START, 0, 4)
    work["P"][:] = 0.0
    for m in range(2):
        work["x"][m, 2] = arena["heading"][0]
        work["P"][m, 2, 2] = 0.3**2


@kernel
def watch(kind, noise, arena, cfg, work):
    """What the tracker says of the robot now: writes work["place"], returns the heading."""
    north, east = normal_pair(arena["seed"], 0, TRACK, arena["tick"], 0)
    place, x, P = work["place"], work["x"], work["P"]
    place[0] = arena["r_R_N"][0, 0] + noise * north
    place[1] = arena["r_R_N"][0, 1] + noise * east
    if kind == TRACKER:
        return arena["heading"][0]
    mmae.predict_straight(x[0], P[0], cfg["tick"], mmae.Q_PLACE, mmae.Q_HEADING, cfg)
    mmae.update_place(x[0], P[0], place, max(noise, 0.005) ** 2, work["filter"])
    place[0], place[1] = x[0, 0], x[0, 1]
    return x[0, 2]


@kernel
def land_once(kind, noise, seed, cfg, plan, tape, arena, work, out):
    """One landing: a LANDED record. plan: record of a DDPConfig."""
    arena["seed"] = seed
    begin(arena, work)
    state, to, task = work["state"], work["next"], work["landing"]
    for k in range(2000):
        heading = watch(kind, noise, arena, cfg, work)
        if k == WATCHED:
            landing.begin(task, state, work["place"], heading, cfg["speed"], MOST, plan)
        if k >= WATCHED:
            landing.land(task, state, work["place"], heading, cfg["speed"], plan, tape)
            u = tape.u[0]
            ddp.fly(state, u, to, plan["dt"])
            for i in range(6):
                state[i] = to[i]
            out["a_max"] = max(out["a_max"], math.sqrt(u[0] ** 2 + u[1] ** 2 + u[2] ** 2))
            out["v_max"] = max(out["v_max"], ddp.excess(state, 3, 0.0)[1])
        drive_robot(arena, 0, cfg)
        arena["tick"] += 1
        arena["t"] = arena["tick"] * cfg["tick"]
        if k >= WATCHED and state[2] >= 0.0:
            break
    north, east = state[0] - arena["r_R_N"][0, 0], state[1] - arena["r_R_N"][0, 1]
    c, s = math.cos(arena["heading"][0]), math.sin(arena["heading"][0])
    out["along"], out["cross"] = c * north + s * east, c * east - s * north
    out["sink"], out["level"] = state[5], math.hypot(state[3], state[4])
    out["t"] = (k - WATCHED + 1) * plan["dt"]


@cache
def landings(kind: int, noise: float, episodes: int) -> NDArray[Any]:
    """LANDED records, (episodes,)."""
    config = DDPConfig()
    cfg, plan = settings(config.dt)[0], to_record(config)[0]
    tape, out = ddp.make_tape(round(MOST / config.dt)), np.zeros(episodes, LANDED)
    for one, seed in zip(out, public_seeds(episodes), strict=True):
        arena, work = np.zeros(1, ARENA)[0], np.zeros(1, WORK)[0]
        land_once(kind, noise, seed, cfg, plan, tape, arena, work, one)
    return out


def in_path(landed: NDArray[Any]) -> NDArray[np.bool_]:
    """Which landings the robot would run into, and keep the aircraft's limits."""
    cfg = settings(DDPConfig().dt)[0]
    both = cfg["robot_radius"] + cfg["aircraft_radius"]
    reached = (np.abs(landed["cross"]) < both) & (landed["along"] > 0.0) & (landed["sink"] > 0.0)
    return reached & (landed["v_max"] <= V_MAX) & (landed["a_max"] <= A_MAX)


def rows(episodes: int) -> list[Row]:
    """The quadratic case, the time of a plan, and the landings."""
    worst = max(cost_error(seed) for seed in range(10))
    out = [
        Row(f"{CASE}/lq/cost_error", None, worst, 0.0, 10, 0.0, 1e-9),
        Row(f"{CASE}/replan_cpu_ms", None, replan_ms(), 0.0, 50, 0.0, 0.6),
    ]
    for kind, name in enumerate(("tracker", "filtered")):
        for noise in NOISES:
            out += landing_rows(f"{CASE}/{name}/noise={noise:g}", kind, noise, episodes)
    return out


def landing_rows(at: str, kind: int, noise: float, episodes: int) -> list[Row]:
    """Share in the path, cross-track and along-track figures (m), speeds at touchdown (m/s)."""
    landed, judged = landings(kind, noise, episodes), kind == TRACKER
    hit, cross = in_path(landed).astype(float), landed["cross"]
    low, high = (1.0, 0.05) if judged else (None, None)
    bottom = None if high is None else 0.0
    error = standard_error(np.abs(cross))
    out = [
        Row(f"{at}/in_path", None, float(hit.mean()), standard_error(hit), episodes, low),
        Row(f"{at}/cross_rms_m", None, rms(cross), error, episodes, bottom, high),
    ]
    for name in ("along", "sink", "level", "t"):
        values = landed[name]
        out.append(Row(f"{at}/{name}", None, values.mean(), standard_error(values), episodes))
    for name in ("v_max", "a_max"):
        out.append(Row(f"{at}/{name}", None, float(landed[name].max()), 0.0, episodes))
    return out


def plot(folder: Path, episodes: int) -> Path:
    """Where the aircraft comes down relative to the robot, which goes up the page."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10, 4.6), layout="constrained")
    FigureCanvasAgg(figure)
    cfg = settings(DDPConfig().dt)[0]
    for kind, axes in enumerate(figure.subplots(1, 2, sharex=True, sharey=True)):
        for colour, noise in reversed(list(enumerate(NOISES))):
            landed = landings(kind, noise, episodes)
            axes.plot(landed["cross"], landed["along"], f"C{colour}.", label=f"{noise:g} m")
        angle = np.linspace(0.0, 2.0 * np.pi, 100)
        radius = cfg["robot_radius"]
        axes.plot(radius * np.sin(angle), radius * np.cos(angle), "k")
        axes.axvline(0.0, color="0.8", zorder=0)
        title = ("tracker's place with white noise", "two-model filter of noisy findings")[kind]
        axes.set(xlabel="across the robot's path (m)", title=title, aspect="equal", ylim=(-0.3, 1))
        axes.legend(title="noise", fontsize=8)
        axes.grid(alpha=0.3)
    figure.axes[0].set_ylabel("along its path (m); circle: the robot")
    file = folder / f"{CASE}.png"
    figure.savefig(file, dpi=110)
    return file
