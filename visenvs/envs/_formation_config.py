"""What defines a formation flight: its settings, what is refused, and the published scenarios."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal

from visenvs.core.config import code, require, validate
from visenvs.core.units import FOOT
from visenvs.guidance.excitation import check_segment

Two = tuple[float, float]
Three = tuple[float, float, float]
WIDEST = 1.1  # half angle of a rendered picture, rad


@dataclass(frozen=True)
class FormationConfig:
    """Everything that defines a formation flight, SI and radians."""

    # polar with the wingspan as a consider parameter, polar by logarithms, the thesis's own; the
    # UKF paper's nine states, extended and unscented; the tracking paper's, see `adaptive`
    estimator: Literal[
        "ekf",
        "ekf-log",
        "ekf-natural",
        "cartesian",
        "ukf",
        "truth",
        "kf",
        "kf-nn",
        "kf-nn-velocity",
        "kf-integrator",
        "kf-singer",
    ] = "ekf"
    followers: int = 1  # so many vehicles in a team, one record each
    # whom they follow: `chain` the one before; `v` the one before on the same side of the leader
    formation: Literal["chain", "v"] = "chain"
    dt: float = 0.1  # control and camera period, s; motion has five inner steps
    t_f: float = 60.0  # end of the episode, s
    # cost: 1/2 integral of s_r |tracking error|^2 + |acceleration - the leader's|^2
    s_r: float = 0.16**2  # weight of the squared error, 1/s^4
    lost_error: float = 20.0  # a lost or crashed follower is charged for this error to the end, m
    lost_after: float = 8.0  # s without an image: lost
    lost_range: float = 300 * FOOT  # and farther than this, m
    # follower
    a_max: float = 16.1 * FOOT  # longest horizontal acceleration, m/s^2
    a_max_down: float = 10.0 * FOOT  # largest vertical one, m/s^2
    lag: float = 0.3  # of its acceleration, s
    turn_smoothing: float = 2.0  # time constant of its own turn rate, s
    # commanded offset: position of the leader in F
    offset: Three = (28.0, 0.0, 0.0)  # m
    # in the follower's heading frame, or in one that keeps the leader's first course
    offset_frame: Literal["heading", "inertial"] = "heading"
    step_times: Three = (0.0, 0.0, 0.0)  # s; it changes then to the next; 0 for never
    step_1: Three = (0.0, 0.0, 0.0)  # m
    step_2: Three = (0.0, 0.0, 0.0)
    step_3: Three = (0.0, 0.0, 0.0)
    # leader; two numbers are the ends of a uniform draw
    start: Literal["drawn", "fixed"] = "fixed"  # `drawn`: all that is marked so
    profile: Literal["straight", "circle", "reverse", "weave", "random"] = "straight"  # drawn
    speed: Two = (23.0, 23.0)  # m/s
    turn: Two = (0.0, 0.0)  # clockwise positive, rad/s
    switch: Two = (20.0, 40.0)  # of `reverse`: straight, and the other way, s
    weave: Three = (0.0, 0.0, 0.0)  # amplitude ahead, to the right, down, m
    weave_rate: Two = (0.3, 0.3)  # rad/s
    leader_sd_lat: float = 0.0  # of `random`: first lateral acceleration, standard deviation, m/s^2
    leader_decay: float = 0.0  # its decay, 1/s
    leader_q_lat: float = 0.0  # its random walk, m^2/s^5
    leader_q_a: float = 0.0  # white acceleration of every axis, m^2/s^3
    wingspan: float = 8.75 * FOOT  # m
    # start of `drawn`
    offset_drawn: Three = (10.0, 6.0, 4.0)  # half width of the draws of offset and step, m
    start_error: float = 2.0  # standard deviation of each axis of the position, m
    start_velocity_error: float = 0.5  # and of the velocity, m/s
    # camera; the leader's sights are drawn about the truth, or found in rendered pictures, where it
    # banks and turns as it flies. With images nothing is drawn of what the camera or its detector
    # does: sigma_image is what the filter assumes, p_lose and p_regain tell nothing, `facing` and
    # `flat` are as `points`, and where the first picture shows no leader its first sight is drawn
    perception: Literal["points", "images"] = "points"
    picture: int = 320  # width of a picture, pixels
    paint: Literal["red", "white"] = "red"  # of all aircraft; white often is not registered
    view: Two = (math.radians(30.0), math.radians(22.5))  # half angles, rad
    sigma_image: float = 0.002  # noise of every image point
    wings: Literal["facing", "points", "flat", "none"] = "facing"  # wing-tip angle; see sensors
    p_lose: float = 0.02  # chance from one image to the next that the processor loses the leader
    p_regain: float = 0.2  # and finds it again; 1 - p_lose and this the same: independent
    blackout: Two = (50.0, 3.0)  # its start and length, s; drawn
    # what the follower is told
    size_bias: float = 0.0  # of the wingspan: told / true - 1
    size_error: float = 0.0  # standard deviation of its logarithm, true about told
    range_bias: float = 0.0  # of the first range, where no wing tips are seen: told / true - 1
    range_error: float = 0.0
    # filter
    sd_size: float = 0.02  # relative uncertainty of the wingspan; 0: it is taken as told
    sd_range: float = 0.3  # of the first range, where no wing tips are seen
    sd_velocity: float = 10 * FOOT  # of the relative velocity at first, m/s
    sd_lat: float = 10 * FOOT  # of a_lat at first, m/s^2; 0 and q_lat = 0 leave it out
    sd_up: float = 10 * FOOT  # of a_up of the nine-state filters
    q_a: float = 0.1 * FOOT**2  # white acceleration of the leader, m^2/s^3
    q_lat: float = 0.04 * FOOT**2  # drift of a_lat, m^2/s^5
    q_up: float = 0.04 * FOOT**2
    q_velocity: float = 1.0 * FOOT**2  # white acceleration that the "kf" filters assume, m^2/s^3
    q_jerk: float = 4.0 * FOOT**2  # of "kf-singer": noise of its acceleration, m^2/s^5
    singer_rate: float = 0.1  # and its decay, 1/s
    adapt_gain: float = 0.1  # of the network's weights, 1/s
    adapt_decay: float = 0.1 / FOOT  # their e-modification, s^2/m
    vision: Two = (0.0, 0.0)  # from the truth to the estimate between these times, s
    score_from: float = 20.0  # estimation errors count from here, s
    # what the meandering laws are told; the task itself does not use it
    meander_reach: float = 5 * FOOT  # to either side of the offset, m
    meander_segment: float = 8.0  # from one side to the other, s
    meander_weight: float = 2000.0  # K of the effort against the range's information, s^2
    meander_window: Two = (0.0, 1e9)  # from when to when, s

    def __post_init__(self) -> None:
        validate(self)
        steps = [t for t in self.step_times if t > 0]
        require(
            self,
            followers=self.followers >= 1,
            dt=self.dt > 0,
            t_f=self.t_f >= self.dt,
            s_r=self.s_r > 0,
            lost_error=self.lost_error >= 0,
            lost_after=self.lost_after >= self.dt,
            lost_range=self.lost_range > self.wingspan,
            a_max=self.a_max > 0,
            a_max_down=0 < self.a_max_down <= self.a_max,
            lag=self.lag > 0,
            turn_smoothing=self.turn_smoothing > 0,
            offset=self.offset[0] > 0 and math.hypot(*self.offset) > self.wingspan,
            step_times=steps == sorted(steps) and tuple(steps) == self.step_times[: len(steps)],
            speed=0 < self.speed[0] <= self.speed[1],
            turn=self.turn[0] <= self.turn[1],
            switch=0 <= self.switch[0] <= self.switch[1],
            weave_rate=0 < self.weave_rate[0] <= self.weave_rate[1],
            leader_sd_lat=self.leader_sd_lat >= 0,
            leader_decay=self.leader_decay >= 0,
            leader_q_lat=self.leader_q_lat >= 0,
            leader_q_a=self.leader_q_a >= 0,
            meander_reach=self.meander_reach >= 0,
            meander_segment=self.meander_segment > 0,
            meander_weight=self.meander_weight > 0,
            meander_window=0 <= self.meander_window[0] <= self.meander_window[1],
            score_from=self.score_from >= 0,
        )
        self._require_sight()
        try:
            check_segment(self.sigma_image, self.meander_weight, self.meander_segment)
        except ValueError as error:
            raise ValueError(f"FormationConfig.meander_segment: {error}") from None

    def _require_sight(self) -> None:
        """Refuse what camera and filters cannot work with."""
        require(
            self,
            wingspan=self.wingspan > 0,
            offset_drawn=min(self.offset_drawn) >= 0 and self.offset[0] > self.offset_drawn[0],
            start_error=self.start_error >= 0,
            start_velocity_error=self.start_velocity_error >= 0,
            picture=64 <= self.picture <= 2048,
            view=all(0 < angle < math.pi / 2 for angle in self.view),
            sigma_image=self.sigma_image > 0,
            p_lose=0 <= self.p_lose <= 1,
            p_regain=0 <= self.p_regain <= 1,
            blackout=min(self.blackout) >= 0,
            size_bias=self.size_bias > -1,
            size_error=self.size_error >= 0,
            range_bias=self.range_bias > -1,
            range_error=0 <= self.range_error < 1 / 3,
            sd_size=self.sd_size >= 0,
            sd_range=self.sd_range > 0,
            sd_velocity=self.sd_velocity > 0,
            sd_lat=self.sd_lat >= 0,
            sd_up=self.sd_up >= 0,
            q_a=self.q_a >= 0,
            q_lat=self.q_lat >= 0,
            q_up=self.q_up >= 0,
            q_velocity=self.q_velocity > 0,
            q_jerk=self.q_jerk > 0,
            singer_rate=self.singer_rate >= 0,
            adapt_gain=self.adapt_gain >= 0,
            adapt_decay=self.adapt_decay >= 0,
            vision=0 <= self.vision[0] <= self.vision[1],
        )
        if self.perception == "images" and max(self.view) > WIDEST:
            raise ValueError(
                f"FormationConfig.view={self.view}: a rendered picture is of one plane, at most "
                f"{WIDEST:g} rad to each side; write `view=(0.52, 0.39)`"
            )


DRAWN = code(FormationConfig, "start", "drawn")
INERTIAL = code(FormationConfig, "offset_frame", "inertial")
WHITE = code(FormationConfig, "paint", "white")
V_FORMATION = code(FormationConfig, "formation", "v")

# Leaders of every profile, offsets, wingspans a little off, dropouts: what ranks policies.
RANDOM = FormationConfig(
    start="drawn",
    speed=(18.0, 25.0),
    turn=(-0.12, 0.12),
    weave=(4.0, 6.0, 2.0),
    weave_rate=(0.15, 0.4),
    leader_sd_lat=1.0,
    leader_decay=0.1,
    leader_q_lat=0.2,
    leader_q_a=0.02,
    size_error=0.02,
    blackout=(50.0, 3.0),
    q_a=1.0 * FOOT**2,
)
# The MURI research airplanes of thesis 2.3.2 (table 1 has the others); its commands are a picture
STRAIGHT = FormationConfig(
    t_f=130.0,
    sd_lat=0.0,
    q_lat=0.0,
    speed=(100 * FOOT, 100 * FOOT),
    wingspan=15.7 * FOOT,
    offset=(100 * FOOT, 0.0, -20 * FOOT),
    step_times=(30.0, 60.0, 90.0),
    step_1=(100 * FOOT, 25 * FOOT, -20 * FOOT),
    step_2=(100 * FOOT, -25 * FOOT, -20 * FOOT),
    step_3=(100 * FOOT, 0.0, -20 * FOOT),
)
# The GTMax behind the GTEdge, thesis 2.3.3
GTMAX = FormationConfig(
    t_f=120.0,
    profile="circle",
    speed=(65 * FOOT, 65 * FOOT),
    turn=(0.1, 0.1),
    offset=(100 * FOOT, -15 * FOOT, -20 * FOOT),
)
SCENARIOS = {
    "random": RANDOM,
    "straight": STRAIGHT,
    "gtmax": GTMAX,
    # The GTYak behind the GTEdge; [800 -20] in the tracking paper is [80 0 -20]
    "gtyak": replace(GTMAX, speed=(75 * FOOT, 75 * FOOT), offset=(80 * FOOT, 0.0, -20 * FOOT)),
    # Bearings alone, tracking paper section 4: closer by half at t = 10 s
    "bearing-only": FormationConfig(
        t_f=90.0,
        wings="none",
        speed=(75 * FOOT, 75 * FOOT),
        offset=(100 * FOOT, 10 * FOOT, 0.0),
        step_times=(10.0, 0.0, 0.0),
        step_1=(50 * FOOT, 0.0, 0.0),
        range_error=0.15,
        sd_lat=0.0,
        q_lat=0.0,
        q_a=0.01 * FOOT**2,
        meander_window=(20.0, 1e9),
    ),
    # A circling leader of unknown acceleration, tracking paper section 5, from GPS to vision
    "adaptive": FormationConfig(
        estimator="kf-integrator",
        adapt_gain=0.5,
        adapt_decay=0.01 / FOOT,
        blackout=(0.0, 0.0),
        t_f=180.0,
        profile="circle",
        speed=(75 * FOOT, 75 * FOOT),
        turn=(0.1, 0.1),
        offset=(60 * FOOT, 15 * FOOT, 10 * FOOT),
        vision=(20.0, 60.0),
        score_from=80.0,
    ),
    # Five in a V behind leaders of every profile
    "team": replace(
        RANDOM, followers=5, formation="v", offset=(30.0, 8.0, 0.0), offset_drawn=(4.0, 3.0, 3.0)
    ),
}
