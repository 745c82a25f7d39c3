"""Measurement updates of the extended Kalman filter against filterpy and against C++.

The problem is the rendezvous's: a target's position relative to the vehicle, shape (3,), and its
covariance are updated with one image point (y, z). All sides solve the same problems from the same
start, and must agree before they are timed.
"""

from __future__ import annotations

import ctypes
import shutil
import subprocess
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from visenvs.core.compile import kernel
from visenvs.core.config import override, to_record
from visenvs.core.frames import camera_towards
from visenvs.core.pinhole import jacobian, pixel_variance, project
from visenvs.core.registry import load_task
from visenvs.estimation.ekf import update_vector
from visenvs.estimation.stationary import SCRATCH, update

from . import ENV_ID, Budget, Portion, Row, left_out, race, row

GROUP = "filter"
WANTS = "at least 100 times filterpy's updates, at least 0.5 of the C++ loop's"
UNIT = "updates/CPU s"
STATIONARY, VECTOR = "filter/stationary", "filter/vector"
FILTERPY, CPP = "filter/filterpy", "filter/cpp"
COUNT = 1000  # problems
GATE = 5.0  # standard deviations
AGREEMENT = 1e-9  # largest difference between two sides, m and m^2

PROBLEM = np.dtype(
    [("rhat", "f8", 3), ("P", "f8", (3, 3)), ("C", "f8", (3, 3)), ("pixel", "f8", 2)]
)
SOLUTION = np.dtype(
    [("rhat", "f8", 3), ("P", "f8", (3, 3)), ("innovation", "f8", 2), ("nis", "f8")]
)
NUMBERS = ("sigma_range", "sigma_angle", "min_range", "gate")  # the settings that C++ is given
RECORDS = NDArray[Any]

SOURCE = Path(__file__).with_name("ekf.cpp")
FLAGS = ("-O3", "-march=native", "-shared", "-fPIC")  # kernels are compiled for this machine too


def rows(budget: Budget) -> list[Row]:
    """Both compiled filters against both references, as far as these are there."""
    problems, settings = draw_problems(COUNT), rendezvous_settings()
    solved = {name: np.zeros(COUNT, SOLUTION) for name in (STATIONARY, VECTOR, FILTERPY, CPP)}
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        found = {
            STATIONARY: stationary(problems, settings, solved[STATIONARY]),
            VECTOR: vector(problems, settings, solved[VECTOR]),
            FILTERPY: with_filterpy(problems, settings, solved[FILTERPY]),
            CPP: with_cpp(problems, settings, solved[CPP], Path(folder)),
        }
        sides = {name: portion for name, portion in found.items() if portion is not None}
        for name, portion in sides.items():
            portion()
            check_agreement(name, solved[name], solved[STATIONARY])
        rates = race(sides, budget)
    filterpy = FILTERPY if FILTERPY in sides else None
    out = [row(name, UNIT, rates, filterpy) for name in (STATIONARY, VECTOR)]
    if CPP in sides:
        for name in (STATIONARY, VECTOR):
            out.append(replace(row(name, UNIT, rates, CPP), id=f"{name}/against-cpp"))
    return out + [row(name, UNIT, rates) for name in (FILTERPY, CPP) if name in sides]


def draw_problems(count: int) -> RECORDS:
    """Estimates 20 to 40 m ahead, a camera that looks at them, image points inside the gate."""
    rng = np.random.default_rng(0)
    problems = np.zeros(count, PROBLEM)
    for problem in problems:
        problem["rhat"] = rng.uniform((20.0, -10.0, -10.0), (40.0, 10.0, 10.0))
        root = rng.uniform(-0.5, 0.5, (3, 3))
        problem["P"] = root @ root.T + 0.05 * np.eye(3)
        camera_towards(problem["rhat"], problem["C"])
        offset = np.linalg.cholesky(problem["P"]) @ rng.normal(size=3)
        X, Y, Z = problem["C"] @ (problem["rhat"] + offset)
        problem["pixel"] = (np.array([Y, Z]) + 0.3 * rng.normal(size=2)) / X
    return problems


def rendezvous_settings() -> RECORDS:
    """One record: the environment's first scenario, with a gate that no drawn problem fails."""
    config = next(iter(load_task(ENV_ID).scenarios.values()))
    return to_record(override(config, {"gate": GATE}))


def check_agreement(name: str, solved: RECORDS, expected: RECORDS) -> None:
    """Raise a ValueError if two sides did not solve the same problems."""
    worst = np.max([np.abs(solved[name] - expected[name]).max() for name in ("rhat", "P")])
    if not worst <= AGREEMENT:
        raise ValueError(
            f"{name} differs by {worst:.3g} from {STATIONARY}, more than {AGREEMENT:g}: "
            "they must solve the same problems to be compared"
        )


@kernel
def begin(problem, solution):
    """Copy the prior, which updates change in place."""
    for i in range(3):
        solution["rhat"][i] = problem["rhat"][i]
        for j in range(3):
            solution["P"][i, j] = problem["P"][i, j]


@kernel
def update_stationary(problems, settings, solutions, scratch):
    """The filter of a stationary target, from image point to covariance."""
    cfg, work = settings[0], scratch[0]
    for k in range(problems.shape[0]):
        p, s = problems[k], solutions[k]
        begin(p, s)
        y, z = p["pixel"][0], p["pixel"][1]
        s["nis"] = update(s["rhat"], s["P"], p["C"], y, z, cfg, s["innovation"], work)


@kernel
def update_at_once(problems, settings, solutions, H, R, B, factor):
    """The same with both coordinates at once, through a Cholesky factor, and no gate."""
    cfg = settings[0]
    for k in range(problems.shape[0]):
        p, s = problems[k], solutions[k]
        begin(p, s)
        X, y, z = project(p["C"], s["rhat"], cfg["min_range"])
        jacobian(p["C"], X, y, z, H)
        R[0, 0] = R[1, 1] = pixel_variance(X, cfg["sigma_range"], cfg["sigma_angle"])
        s["innovation"][0] = p["pixel"][0] - y
        s["innovation"][1] = p["pixel"][1] - z
        s["nis"] = update_vector(s["rhat"], s["P"], H, s["innovation"], R, 0.0, B, factor)


def stationary(problems: RECORDS, settings: RECORDS, solutions: RECORDS) -> Portion:
    """All problems once, in one compiled loop."""
    scratch = np.zeros(1, SCRATCH)

    def portion() -> int:
        update_stationary(problems, settings, solutions, scratch)
        return len(problems)

    return portion


def vector(problems: RECORDS, settings: RECORDS, solutions: RECORDS) -> Portion:
    """All problems once, in one compiled loop."""
    H, R, B, factor = np.zeros((2, 3)), np.zeros((2, 2)), np.zeros((3, 2)), np.zeros(3)

    def portion() -> int:
        update_at_once(problems, settings, solutions, H, R, B, factor)
        return len(problems)

    return portion


def with_filterpy(problems: RECORDS, settings: RECORDS, solutions: RECORDS) -> Portion | None:
    """All problems once, one call each; its camera functions are the compiled ones."""
    try:
        from filterpy.kalman import ExtendedKalmanFilter  # pyright: ignore[reportMissingImports]
    except ImportError:
        left_out(FILTERPY, "pip install 'visenvs[bench]'")
        return None
    ekf = ExtendedKalmanFilter(dim_x=3, dim_z=2)
    sigma_range, sigma_angle, min_range = (float(settings[0][name]) for name in NUMBERS[:3])

    def image_point(r: NDArray[np.float64], C: NDArray[np.float64]) -> NDArray[np.float64]:
        _, y, z = project(C, r, min_range)
        return np.array((y, z))

    def slopes(r: NDArray[np.float64], C: NDArray[np.float64]) -> NDArray[np.float64]:
        X, y, z = project(C, r, min_range)
        H = np.empty((2, 3))
        jacobian(C, X, y, z, H)
        return H

    given: list[tuple[Any, ...]] = []
    for problem in problems:
        rhat, P, C, pixel = (problem[name].copy() for name in ("rhat", "P", "C", "pixel"))
        X, _, _ = project(C, rhat, min_range)
        given.append(
            (rhat, P, (C,), pixel, np.eye(2) * pixel_variance(X, sigma_range, sigma_angle))
        )

    def portion() -> int:
        for (rhat, P, camera, pixel, R), solution in zip(given, solutions, strict=True):
            ekf.x, ekf.P = rhat, P
            ekf.update(pixel, slopes, image_point, R, camera, camera)
            solution["rhat"], solution["P"] = ekf.x, ekf.P
        return len(given)

    return portion


def with_cpp(
    problems: RECORDS, settings: RECORDS, solutions: RECORDS, folder: Path
) -> Portion | None:
    """All problems once, in one C++ loop, compiled into `folder`."""
    compiler = shutil.which("g++") or shutil.which("c++")
    if compiler is None:
        left_out(CPP, "install a C++ compiler, g++ or c++")
        return None
    library = folder / "ekf.so"
    command = [compiler, *FLAGS, str(SOURCE), "-o", str(library)]
    built = subprocess.run(command, capture_output=True, text=True, check=False)
    if built.returncode:
        left_out(CPP, f"{Path(compiler).name} failed: {' '.join(built.stderr.split())[:200]}")
        return None
    function = ctypes.CDLL(str(library)).update_all
    function.argtypes = [ctypes.c_void_p, ctypes.c_size_t, ctypes.c_void_p, ctypes.c_void_p]
    function.restype = None
    numbers = np.array([settings[0][name] for name in NUMBERS])
    here, there, told = (
        array.ctypes.data_as(ctypes.c_void_p) for array in (problems, solutions, numbers)
    )

    def portion() -> int:
        function(here, len(problems), told, there)
        return len(problems)

    return portion
