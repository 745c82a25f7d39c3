"""Formation flight: steps of the environment, polar filter against C++, UKF against filterpy.

A filter's problem is one period of 0.1 s: five inner steps of prediction (one for nine states) and
one image. Sides that are compared solve the same problems and must agree before they are timed.
"""

from __future__ import annotations

import ctypes
import shutil
import subprocess
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from visenvs.core.compile import kernel
from visenvs.core.config import override, to_record
from visenvs.core.frames import wrap_angle
from visenvs.core.lanes import Lanes
from visenvs.core.registry import load_task
from visenvs.core.sight import to_angles
from visenvs.estimation import cartesian, polar
from visenvs.estimation.formation import BELIEF, SIGHT, SUBSTEPS

from . import Budget, Portion, Row, faces, left_out, race, row
from .filter import FLAGS

GROUP = "formation"
WANTS = (
    "30,000 steps per CPU second, the polar filter at least a third of the C++ loop's periods, "
    "the UKF at least 50 times filterpy's"
)
ENV_ID = "visenvs/Formation-v0"
UNIT = "periods/CPU s"
SINGLE, POLAR, CPP = "formation/single", "formation/polar", "formation/cpp"
UKF, FILTERPY = "formation/ukf", "formation/filterpy"
COUNT = 500  # problems
POLAR_AGREEMENT = 1e-9  # of states and covariances relative to their size
UKF_AGREEMENT = 0.05  # filterpy takes the angles of an image at once; relative to deviations

OWN = [("v_V_N", "f8", (3,)), ("push", "f8", (SUBSTEPS, 3))]
PROBLEM = np.dtype([("x", "f8", 10), ("P", "f8", (10, 10)), *OWN, ("sight", SIGHT)])
NINE = np.dtype([("x", "f8", 9), ("P", "f8", (9, 9)), *OWN, ("sight", SIGHT)])
NUMBERS = ("dt", "sigma_image", "q_a", "q_lat")  # the settings that C++ is given
RECORDS = NDArray[Any]
SOURCE = Path(__file__).with_name("polar.cpp")


def rows(budget: Budget) -> list[Row]:
    """The single environment, then each filter beside its yardstick as far as that is there."""
    out = [row(SINGLE, faces.UNIT, race({SINGLE: faces.single(ENV_ID)}, budget))]
    settings = formation_settings()
    polars, nines = draw_problems("ekf-log", PROBLEM), draw_problems("ukf", NINE)
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        cpp = with_cpp(polars, settings, Path(folder))
        out += duel(POLAR, with_polar(polars, settings), CPP, cpp, POLAR_AGREEMENT, budget)
    theirs = with_filterpy(nines, settings)
    return out + duel(UKF, with_ukf(nines, settings), FILTERPY, theirs, UKF_AGREEMENT, budget)


Side = tuple[Portion, RECORDS]


def duel(
    name: str, ours: Side, other: str, theirs: Side | None, agreement: float, budget: Budget
) -> list[Row]:
    """Our side against the yardstick, if it is there, after checking that they agree."""
    sides = {name: ours[0]} | ({other: theirs[0]} if theirs else {})
    if theirs:
        for side in sides.values():
            side()
        check_agreement(other, theirs[1], ours[1], agreement)
    rates = race(sides, budget)
    found = [row(name, UNIT, rates, other if theirs else None)]
    return found + ([row(other, UNIT, rates)] if theirs else [])


def formation_settings() -> RECORDS:
    """One record: the environment's first scenario."""
    return to_record(next(iter(load_task(ENV_ID).scenarios.values())))


def draw_problems(estimator: str, dtype: np.dtype[Any]) -> RECORDS:
    """States of that filter on the way, with an image each: short flights without a law."""
    task = load_task(ENV_ID)
    config = next(iter(task.scenarios.values()))
    calm = {"estimator": estimator, "p_lose": 0.0, "lost_after": 60.0, "blackout": (0.0, 0.0)}
    many = 2 * COUNT
    lanes, rng = Lanes(task, override(config, calm), many), np.random.default_rng(0)
    lanes.reset(range(many))
    problems, seen = np.zeros(many, dtype), np.ones(many, bool)
    track = "polar" if dtype is PROBLEM else "cartesian"
    for k in range(15):
        if k == 14:
            for name in ("x", "P"):
                problems[name] = lanes.records["track"][track][name]
        lanes.step(rng.uniform(-0.1, 0.1, (many, 3)).astype(np.float32))
        seen &= lanes.records["seen"] > 0.0
    for name in ("v_V_N", "push", "sight"):
        problems[name] = lanes.records[name]
    return problems[seen][:COUNT]


def check_agreement(name: str, theirs: RECORDS, ours: RECORDS, limit: float) -> None:
    """Raise a ValueError if two sides did not solve the same problems."""
    spread = np.sqrt(np.abs(np.diagonal(ours["P"], axis1=1, axis2=2))) + 1e-12
    state = np.abs(theirs["x"] - ours["x"]) / spread
    joint = np.abs(theirs["P"] - ours["P"]) / (spread[:, :, None] * spread[:, None, :])
    worst = max(state.max(), joint.max())
    if not worst <= limit:
        raise ValueError(
            f"{name} differs by {worst:.3g} standard deviations, more than {limit:g}: "
            "they must solve the same problems to be compared"
        )


@kernel
def run_polar(problems, settings, tracks, belief, scratch):
    """One period of the polar filter with errors in logarithms for every problem."""
    cfg, b, work = settings[0], belief[0], scratch[0]
    for k in range(problems.shape[0]):
        p, t = problems[k], tracks[k]
        begin(p, t)
        polar.predict(t, p, False, cfg, work)
        polar.update(t, p["sight"], False, False, b, cfg, work)


@kernel
def run_ukf(problems, settings, tracks, belief, scratch):
    """One period of the unscented filter for every problem."""
    cfg, b, work = settings[0], belief[0], scratch[0]
    for k in range(problems.shape[0]):
        p, t = problems[k], tracks[k]
        begin(p, t)
        cartesian.predict_unscented(t, p, cfg, work)
        cartesian.update_unscented(t, p["sight"], b, cfg, work)


@kernel
def begin(problem, track):
    """Copy the prior, which filters change in place."""
    for i in range(problem["x"].shape[0]):
        track["x"][i] = problem["x"][i]
        for j in range(problem["x"].shape[0]):
            track["P"][i, j] = problem["P"][i, j]


def with_polar(problems: RECORDS, settings: RECORDS) -> Side:
    """All problems once, in one compiled loop."""
    return in_one_loop(run_polar, polar, problems, settings)


def with_ukf(problems: RECORDS, settings: RECORDS) -> Side:
    """All problems once, in one compiled loop."""
    return in_one_loop(run_ukf, cartesian, problems, settings)


def in_one_loop(run: Any, estimator: Any, problems: RECORDS, settings: RECORDS) -> Side:
    """All problems once in a compiled loop over an estimator's tracks."""
    tracks, scratch = np.zeros(len(problems), estimator.TRACK), np.zeros(1, estimator.SCRATCH)
    belief = np.zeros(1, BELIEF)

    def portion() -> int:
        run(problems, settings, tracks, belief, scratch)
        return len(problems)

    return portion, tracks


def with_cpp(problems: RECORDS, settings: RECORDS, folder: Path) -> Side | None:
    """All problems once, in one C++ loop, compiled into `folder`."""
    compiler = shutil.which("g++") or shutil.which("c++")
    if compiler is None:
        left_out(CPP, "install a C++ compiler, g++ or c++")
        return None
    library = folder / "polar.so"
    command = [compiler, *FLAGS, str(SOURCE), "-o", str(library)]
    built = subprocess.run(command, capture_output=True, text=True, check=False)
    if built.returncode:
        left_out(CPP, f"{Path(compiler).name} failed: {' '.join(built.stderr.split())[:200]}")
        return None
    function = ctypes.CDLL(str(library)).run_all
    function.argtypes = [ctypes.c_void_p, ctypes.c_size_t, ctypes.c_void_p, ctypes.c_void_p]
    function.restype = None
    numbers = np.array([float(settings[0][name]) for name in NUMBERS])
    tracks = np.zeros(len(problems), polar.TRACK)
    here, there, told = (
        array.ctypes.data_as(ctypes.c_void_p) for array in (problems, tracks, numbers)
    )

    def portion() -> int:
        function(here, len(problems), told, there)
        return len(problems)

    return portion, tracks


def with_filterpy(problems: RECORDS, settings: RECORDS) -> Side | None:
    """All problems once, one call each; its models are the compiled ones."""
    try:
        from filterpy.kalman import (  # pyright: ignore[reportMissingImports]
            JulierSigmaPoints,
            UnscentedKalmanFilter,
        )
    except ImportError:
        left_out(FILTERPY, "pip install 'visenvs[bench]'")
        return None
    cfg, work = settings[0], np.zeros(1, cartesian.SCRATCH)[0]
    dt, variance = float(cfg["dt"]), float(cfg["sigma_image"]) ** 2

    seen = [0.0]  # the measured azimuth, from which azimuths count: filterpy knows no angles

    def move(x: NDArray[np.float64], _dt: float) -> NDArray[np.float64]:
        moved = x.copy()
        cartesian.advance(moved, dt, work)
        return moved

    def measure(x: NDArray[np.float64]) -> NDArray[np.float64]:
        azimuth, elevation, _ = to_angles(x[0], x[1], x[2])
        return np.array((wrap_angle(azimuth - seen[0]), elevation, cartesian.wing_angle(x)))

    points = JulierSigmaPoints(cartesian.SIZE, kappa=cartesian.SPREAD - cartesian.SIZE)
    ukf = UnscentedKalmanFilter(cartesian.SIZE, 3, dt, measure, move, points)
    cartesian.process_noise(dt, cfg, work["Q"])
    ukf.Q = work["Q"].copy()
    tracks = np.zeros(len(problems), cartesian.TRACK)
    given: list[tuple[float, NDArray[np.float64], NDArray[np.float64]]] = []
    for problem in problems:
        azimuth, elevation, _ = to_angles(*problem["sight"]["u_N"])
        z = np.array((0.0, elevation, problem["sight"]["alpha"]))
        R = variance * np.diag([1.0 / np.cos(elevation) ** 2, 1.0, 2.0])
        given.append((azimuth, z, R))

    def portion() -> int:
        for problem, (seen[0], z, R), track in zip(problems, given, tracks, strict=True):
            cartesian.own_motion(problem, dt, work)
            ukf.x, ukf.P = problem["x"].copy(), problem["P"].copy()
            ukf.predict()
            ukf.sigmas_f = ukf.points_fn.sigma_points(ukf.x, ukf.P)
            ukf.update(z, R)
            track["x"], track["P"] = ukf.x, ukf.P
        return len(given)

    return portion, tracks
