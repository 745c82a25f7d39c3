"""Figure 5 of the IARC paper: one robot for 60 s, seen by an aircraft that follows it.

It is found at 5 s, swerves from 15 to 18 s and from 45 to 49 s, and at 30 s it reverses in 2.456 s.
The paper shows one run, and states no noise, height or rate. Here: from 2 m, 80 degrees across,
2 pixels of noise, 15 pictures a second, nine detections in ten; the aircraft holds its place over
the estimate. Three estimators see the same findings: the straight model alone, the two models as
printed, which tell each other nothing, and with the headings handed over where the winner changes.
"""

from __future__ import annotations

import math
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from visenvs.core.compile import kernel
from visenvs.core.frames import wrap_angle
from visenvs.core.noise import normal, uniform
from visenvs.dynamics import lander
from visenvs.dynamics.ground_robot import NOISE, REVERSE, drive_robot, enter
from visenvs.estimation import mmae
from visenvs.sensors.ground_camera import FALSE, look, pixel_size

from ..rollout import public_seeds
from . import Row, standard_error
from ._iarc import ARENA, NEVER, rms, settings

CASE = "iarc-fig5"
ESTIMATORS = ("ekf", "printed", "hand_over")
EKF, PRINTED, HAND_OVER = range(3)
RATE, HEIGHT, SECONDS = 15, 2.0, 60  # pictures a second, m, s
PICTURED = 6  # runs on pictures at most
FOUND, SETTLED, SPIN = 5.0, 7.0, 30.0  # when the robot is found, errors count from, it reverses, s
SWERVES = ((15.0, 3.0), (45.0, 4.0))  # when, and for how long, s
SWERVE_RATE = 0.064 / 0.258  # largest, rad/s (Table 1)
AFTER = 5.0  # s after the spin over which errors are counted by themselves
NEAR = math.radians(15.0)
SD_PLACE, SD_HEADING = 0.3, 0.5  # standard deviations of what is believed when it is found, m, rad
FIRST, HEADING, CAMERA = 0, 1, 2  # noise streams
STEP = np.dtype(
    [
        ("t", "f8"), ("r", "f8", 2), ("heading", "f8"), ("spinning", "f8"),
        ("rhat", "f8", 2), ("heading_hat", "f8"), ("p_spin", "f8"), ("image", "f8", 2),
    ]
)  # fmt: skip
WORK = np.dtype(
    [
        ("filter", mmae.SCRATCH), ("x", "f8", (2, 3)), ("P", "f8", (2, 3, 3)),
        ("pose", "f8", (4, 3)), ("v", "f8", 2), ("a", "f8", 2), ("active", "f8", 1),
        ("seen", "f8", (1 + FALSE, 2)), ("labels", "f8", 1 + FALSE),
    ]
)  # fmt: skip
Values = NDArray[np.float64]


def scene() -> NDArray[Any]:
    """Settings; the timers of the robot rest, as the scenario sets its modes."""
    return settings(1.0 / RATE, noise_every=NEVER, cruise=HEIGHT)


@kernel
def set_mode(arena, cfg):
    """Let the scenario begin and end the modes of the robot."""
    t, mode = arena["t"] + 1e-9, -1
    if abs(t - SPIN) < 0.5 * cfg["tick"]:
        mode = REVERSE
    for k in range(len(SWERVES)):
        if abs(t - SWERVES[k][0]) < 0.5 * cfg["tick"]:
            u = uniform(arena["seed"], arena["episode"], FIRST, 0, k + 1)
            arena["swerve"][0], mode = SWERVE_RATE * (2.0 * u - 1.0), NOISE
            cfg["noise_time"] = SWERVES[k][1]
    if mode >= 0:
        enter(arena, 0, mode, arena["t"])


@kernel
def begin(kind, arena, work):
    """Put the robot, the aircraft over it, and what is believed of it when it is found."""
    x, P = work["x"], work["P"]
    seed, episode = arena["seed"], arena["episode"]
    pose, work["active"][0] = work["pose"], 1.0
    pose[0, 2], pose[1, 2], pose[2, 1], pose[3, 0] = -HEIGHT, 1.0, 1.0, -1.0
    arena["heading"][0] = 2.0 * math.pi * uniform(seed, episode, FIRST, 0, 0)
    P[:] = 0.0
    for m in range(2):
        x[m, 2] = arena["heading"][0] + SD_HEADING * normal(seed, episode, HEADING, 0, 0)
        P[m, 0, 0] = P[m, 1, 1] = SD_PLACE**2
        P[m, 2, 2] = SD_HEADING**2


@kernel
def estimate(kind, count, p_spin, spun, cfg, work):
    """Bring the estimator up to date with a picture; returns p_spin and spun."""
    x, P, dt = work["x"], work["P"], cfg["tick"]
    mmae.predict(x, P, dt, cfg)
    spun += dt if spun >= 0.0 else 0.0
    if count == 0:
        return p_spin, spun
    variance, place = (cfg["sigma_pixel"] * pixel_size(work["pose"], cfg)) ** 2, work["seen"][0]
    if kind == EKF:
        mmae.update_place(x[0], P[0], place, variance, work["filter"])
        return p_spin, spun
    least, most = mmae.LEAST, 1.0 - mmae.LEAST
    p_spin = mmae.update(x, P, p_spin, place, variance, least, most, work["filter"])
    return p_spin, mmae.hand_over(x, P, p_spin, spun) if kind == HAND_OVER else spun


@kernel
def fly(kind, seed, cfg, arena, work, out):
    """One run, a STEP for each picture."""
    arena["seed"] = seed
    begin(kind, arena, work)
    p_spin, spun, pose = mmae.LEAST, mmae.NEVER, work["pose"]
    for k in range(out.shape[0]):
        set_mode(arena, cfg)
        drive_robot(arena, 0, cfg)
        arena["tick"] += 1
        arena["t"] = arena["tick"] * cfg["tick"]
        r, s = arena["r_R_N"][:1], out[k]
        count = look(
            pose, r, work["active"], cfg, arena["seed"], 0, k, CAMERA, work["seen"], work["labels"]
        )
        if arena["t"] > FOUND:
            p_spin, spun = estimate(kind, count, p_spin, spun, cfg, work)
        else:
            for m in range(2):
                work["x"][m, 0], work["x"][m, 1] = r[0, 0], r[0, 1]
        state = work["x"][1 if p_spin > 0.5 else 0]
        lander.glide(pose[0, :2], work["v"], work["a"], state[:2], cfg)
        size = pixel_size(pose, cfg)
        s["t"], s["heading"], s["heading_hat"] = arena["t"], arena["heading"][0], state[2]
        s["p_spin"], s["spinning"] = p_spin, 1.0 if arena["mode"][0] == REVERSE else 0.0
        for i in range(2):
            s["r"][i], s["rhat"][i] = r[0, i], state[i]
            s["image"][i] = (r[0, 1 - i] - pose[0, 1 - i]) / size


@cache
def runs(kind: int, episodes: int) -> NDArray[Any]:
    """STEP records of all runs, shape (episodes, pictures)."""
    out = np.zeros((episodes, RATE * SECONDS), STEP)
    for run, seed in zip(out, public_seeds(episodes), strict=True):
        cfg, arena, work = scene()[0], np.zeros(1, ARENA)[0], np.zeros(1, WORK)[0]
        fly(kind, seed, cfg, arena, work, run)
    return out


def heading_errors(found: NDArray[Any]) -> Values:
    """Sizes of the heading errors, rad."""
    return np.abs(wrap_angle(found["heading_hat"] - found["heading"]))


def first_time(holds: NDArray[np.bool_], t: Values, since: float) -> Values:
    """When each run (n, steps) first holds at or after a time, s from then; inf where never."""
    late = holds & (t >= since - 1e-9)
    return np.where(late.any(axis=1), t[late.argmax(axis=1)] - since, np.inf)


def figures(kind: int, episodes: int) -> dict[str, tuple[float, float]]:
    """Every figure of one estimator with its standard error."""
    found = runs(kind, episodes)
    t, end = found["t"][0], SPIN + scene()[0]["spin_time"]
    away = np.hypot(*np.moveaxis(found["rhat"] - found["r"], -1, 0))
    off, after = heading_errors(found), (t > end) & (t <= end + AFTER)
    straight = (t > SETTLED) & ((t < SPIN) | (t > end + AFTER))
    spell = (t > SPIN) & (t <= end + AFTER)
    out = {}
    for name, values in (
        ("position_rmse_m", away[:, t > SETTLED]),
        ("position_rmse_spin_m", away[:, spell]),
        ("heading_rmse_straight_deg", np.degrees(off[:, straight])),
        ("heading_rmse_after_spin_deg", np.degrees(off[:, after])),
    ):
        out[name] = rms(values), standard_error(np.sqrt(np.mean(values**2, axis=1)))
    times = {"heading_found_s": first_time(off < NEAR, t, end)}
    if kind != EKF:
        times["spin_found_s"] = first_time(found["p_spin"] > 0.5, t, SPIN)
        times["straight_again_s"] = first_time(found["p_spin"] < 0.5, t, end)
    for name, values in times.items():
        out[f"{name}_p90"] = float(np.percentile(values, 90)), standard_error(values)
    out["image_error_px_max"] = float(np.abs(found["image"][:, t > SETTLED]).max()), 0.0
    return out


PAPER = {"image_error_px_max": 120.0}
BANDS = {
    "position_rmse_m": 0.02,
    "spin_found_s_p90": 0.35,
    "heading_found_s_p90": 0.8,
    "image_error_px_max": 120.0,
}


def rows(episodes: int) -> list[Row]:
    """Errors and delays of the three estimators; those of the handed-over headings are judged."""
    out: list[Row] = []
    for kind, estimator in enumerate(ESTIMATORS):
        for name, (ours, error) in figures(kind, episodes).items():
            high = BANDS.get(name) if kind == HAND_OVER else None
            paper = PAPER.get(name) if kind == HAND_OVER else None
            low = None if high is None else 0.0
            out.append(Row(f"{CASE}/{estimator}/{name}", paper, ours, error, episodes, low, high))
    return out


def image_rows(episodes: int) -> list[Row]:
    """The same on rendered pictures, for a few runs."""
    from . import _iarc_images

    return _iarc_images.rows(public_seeds(min(episodes, PICTURED)))


def plot(folder: Path, episodes: int) -> Path:
    """The figure's four panels, for the first public seed; returns the file."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10, 9), layout="constrained")
    FigureCanvasAgg(figure)
    panels = figure.subplots(4, 1, sharex=True)
    labels = ("straight model alone", "two models as printed", "headings handed over")
    for kind, label in enumerate(labels):
        run = runs(kind, episodes)[0]
        run = run[run["t"] > FOUND]
        error = 1e3 * np.hypot(*(run["rhat"] - run["r"]).T)
        panels[0].plot(run["t"], error, f"C{kind}", lw=1, label=label)
        turned = np.degrees(wrap_angle(run["heading_hat"] - run["heading"]))
        panels[1].plot(run["t"], turned, f"C{kind}", lw=1)
        if kind != EKF:
            panels[2].plot(run["t"], run["p_spin"], f"C{kind}", lw=1)
        if kind == HAND_OVER:
            panels[3].plot(run["t"], run["image"], lw=1)
            panels[3].legend(("width", "height"), fontsize=8)
    panels[0].legend(fontsize=8)
    names = ("place error (mm)", "heading error (deg)", "probability of a spin", "image error (px)")
    for axes, name in zip(panels, names, strict=True):
        axes.set(ylabel=name, xlim=(FOUND, SECONDS))
        axes.axvspan(SPIN, SPIN + scene()[0]["spin_time"], color="0.9")
        for begin_s, length in SWERVES:
            axes.axvspan(begin_s, begin_s + length, color="0.96")
        axes.grid(alpha=0.3)
    panels[3].set_xlabel("time (s); grey: spin, light grey: swerves")
    file = folder / f"{CASE}.png"
    figure.savefig(file, dpi=110)
    return file
