"""Figure 5 of the IARC paper on rendered pictures, by an aircraft that navigates by them.

As on points, but: the robot is found by cascade and template, its heading is measured too, and the
aircraft knows its own place by IMU, altimeter and corners of the floor alone. Four more robots keep
the target company and reverse when it does; it pushes aside what is in its way.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from visenvs.core.noise import normal, uniform
from visenvs.dynamics import lander
from visenvs.dynamics.ground_robot import ACTIVE, NOISE, REVERSE, RUN, drive_robot, enter
from visenvs.envs import _herding_navigation as navigation
from visenvs.envs._herding_images import ALTIMETER, IMU, NADIR, SIGMA, camera, period, take
from visenvs.estimation import mmae
from visenvs.sensors.ground_camera import TOP, pixel_size, size_at
from visenvs.sensors.images.ground_robots import Expected, Finding, View, track

from . import Row, standard_error
from . import iarc_fig5 as points
from ._iarc import rms

SIDE_BY_SIDE = ((0.9, -1.0), (-0.8, -1.1), (0.7, 1.1), (-0.9, 1.0))  # ahead and right, m
TOUCHING = 0.36  # m
AT = "iarc-fig5/images"
BANDS = {
    "position_rmse_m": 0.02,
    "heading_rmse_deg": 3.0,
    "spin_found_s_max": 0.5,
    "image_error_px_max": 60.0,
}
Values = NDArray[np.float64]


class Flight:
    """One run: robots, aircraft and what it believes.

    Args:
        seed: of the run.
        cfg: settings, a record.
    """

    def __init__(self, seed: int, cfg: Any) -> None:
        self.cfg, self.tick = cfg, float(cfg["tick"])
        self.own = np.zeros(1, navigation.NAVIGATING)
        self.lane = lane = self.own[0]
        lane["seed"], lane["height"] = seed, cfg["cruise"]
        others = len(SIDE_BY_SIDE)
        lane["fate"][: 1 + others] = ACTIVE
        lane["heading"][: 1 + others] = heading = (
            2.0 * math.pi * uniform(seed, 0, points.FIRST, 0, 0)
        )
        c, s = math.cos(heading), math.sin(heading)
        lane["r_R_N"][1 : 1 + others] = np.array(SIDE_BY_SIDE) @ [[c, s], [-s, c]]
        self.optics = camera(cfg)
        navigation.start(self.own, self.optics, NADIR, period(cfg), IMU)
        self.filter = navigation.navigator(self.own, self.optics, NADIR, period(cfg))
        self.x, self.P = np.zeros((2, 3)), np.zeros((2, 3, 3))
        self.p_spin, self.spun = mmae.LEAST, mmae.NEVER
        self.work, self.a = np.zeros(1, mmae.SCRATCH)[0], np.zeros(2)

    def drive(self) -> None:
        """All robots for one tick; the others do not swerve, and give way to the target."""
        lane = self.lane
        for k in range(1, 1 + len(SIDE_BY_SIDE)):
            mode = int(lane["mode"][0])
            enter(lane, k, RUN if mode == NOISE else mode, lane["mode_t"][0])
            drive_robot(lane, k, self.cfg)
        drive_robot(lane, 0, self.cfg)
        for k in range(1, 1 + len(SIDE_BY_SIDE)):
            away = lane["r_R_N"][k] - lane["r_R_N"][0]
            gap = float(np.hypot(*away))
            if gap < TOUCHING:
                lane["r_R_N"][k] = lane["r_R_N"][0] + TOUCHING / gap * away
        lane["tick"] += 1
        lane["t"] = lane["tick"] * self.tick

    def look(self) -> View:
        """Navigate by the IMU and a picture, which is returned as taken from where it believes."""
        lane = self.lane
        navigation.feel(self.own, lane, lane, self.filter, self.tick, IMU)
        view = take(lane, lane, self.cfg)
        navigation.see(lane, lane, self.filter, view.grey, ALTIMETER)
        return navigation.believed(view, self.filter)

    def believe(self, place: Values, heading: float) -> None:
        """Begin the track at a pose."""
        self.x[:] = *place, heading
        self.P[:] = np.diag([points.SD_PLACE, points.SD_PLACE, points.SD_HEADING]) ** 2

    def estimate(self, view: View) -> bool:
        """Bring the track up to date; returns whether the robot was registered."""
        mmae.predict(self.x, self.P, self.tick, self.cfg)
        self.spun += self.tick if self.spun >= 0.0 else 0.0
        found = track(view, self.expected())
        if found is not None:
            self.use(found, view)
        return found is not None

    def expected(self) -> Expected:
        """The robot by the likelier model."""
        model = mmae.SPIN if self.p_spin > 0.5 else mmae.STRAIGHT
        (north, east, heading), P = self.x[model].tolist(), self.P[model]
        return Expected((north, east), math.sqrt(P[0, 0]), heading, math.sqrt(P[2, 2]))

    def use(self, found: Finding, view: View) -> None:
        """Use a finding in both models."""
        least, most = mmae.LEAST, 1.0 - mmae.LEAST
        pose = np.vstack([view.r_V_N, view.C])
        variance = float(SIGMA * pixel_size(pose, self.cfg)) ** 2
        place, models = np.array(found.place), (self.x, self.P)
        p = mmae.update(*models, self.p_spin, place, variance, least, most, self.work)
        if found.heading_deviation > 0.0:
            noise = found.heading_deviation**2
            p = mmae.update_heading(*models, p, found.heading, noise, least, most, self.work)
        self.p_spin, self.spun = p, mmae.hand_over(*models, p, self.spun)

    def follow(self) -> None:
        """Fly to over the robot, by where both are believed to be."""
        lane, cfg = self.lane, self.cfg
        lander.glide(lane["r_V_N"], lane["v_V_N"], self.a, np.array(self.expected().place), cfg)


@cache
def fly(seed: int) -> tuple[NDArray[Any], Values, Values]:
    """One run: STEP records, errors of the own place (m), and which pictures registered."""
    cfg = points.scene()[0]
    flight = Flight(seed, cfg)
    lane, out = flight.lane, np.zeros(points.RATE * points.SECONDS, points.STEP)
    off, registered = np.zeros(len(out)), np.ones(len(out))
    for k, step in enumerate(out):
        points.set_mode(lane, cfg)
        flight.drive()
        view = flight.look()
        r, heading = lane["r_R_N"][0], float(lane["heading"][0])
        if lane["t"] > points.FOUND:
            registered[k] = flight.estimate(view)
        else:
            turned = heading + points.SD_HEADING * normal(seed, 0, points.HEADING, 0, 0)
            flight.believe(r + lane["off_N"], turned)
        flight.follow()
        place = lane["r_V_N"] - lane["off_N"]
        size = float(size_at(lane["height"] - TOP, cfg))
        step["t"], step["heading"], step["r"] = lane["t"], heading, r
        *step["rhat"], step["heading_hat"] = (*flight.expected().place, flight.expected().heading)
        step["p_spin"], step["spinning"] = flight.p_spin, lane["mode"][0] == REVERSE
        step["image"] = (r - place)[::-1] / size
        off[k] = np.hypot(*lane["off_N"])
    return out, off, registered


def rows(seeds: Sequence[int]) -> list[Row]:
    """Errors, delays and misses, over all runs or of the worst one."""
    flights = [fly(seed) for seed in seeds]
    found, n = np.stack([flown for flown, _, _ in flights]), len(flights)
    t, end = found["t"][0], points.SPIN + points.scene()[0]["spin_time"]
    settled = t > points.SETTLED
    track_off = np.hypot(*np.moveaxis(found["rhat"] - found["r"], -1, 0))[:, settled]
    own_off = np.stack([off for _, off, _ in flights])[:, settled]
    turned = np.degrees(points.heading_errors(found))[:, settled]
    registered = np.stack([seen for _, _, seen in flights])[:, settled].mean(axis=1)
    out: list[Row] = []
    for name, errors in (
        ("position_rmse_m", track_off),
        ("heading_rmse_deg", turned),
        ("own_position_rmse_m", own_off),
    ):
        se = standard_error(np.sqrt(np.mean(errors**2, axis=1)))
        out.append(Row(f"{AT}/{name}", None, rms(errors), se, n, high=BANDS.get(name)))
    spinning = found["p_spin"] > 0.5
    worst = {
        "spin_found_s_max": points.first_time(spinning, t, points.SPIN),
        "straight_again_s_max": points.first_time(~spinning, t, end),
        "image_error_px_max": np.abs(found["image"][:, settled]).max(axis=(1, 2)),
    }
    for name, values in worst.items():
        paper = points.PAPER.get(name)
        out.append(Row(f"{AT}/{name}", paper, float(values.max()), 0.0, n, high=BANDS.get(name)))
    out.append(Row(f"{AT}/registered", None, float(registered.mean()), 0.0, n))
    return out
