"""What defines a mapping task: its settings, what is refused, and the published scenes."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal

from visenvs.core.config import require, validate
from visenvs.core.units import FOOT

EDGES, SOLIDS = 128, 8  # that a scene can hold: 8 gabled houses, or 8 x 8 points of terrain
SLOTS, SEGMENTS = 192, 160  # lines of a map, segments of an image
TOKENS = 32  # lines that the row tells of
SIDE = 8  # cells of the coverage grid along each side of the area
POINTS = 8  # of the terrain along each side, at most


@dataclass(frozen=True)
class MappingConfig:
    """Everything that defines a mapping task, SI and radians."""

    # which residuals of a segment the filter uses; `printed` sums the gains of several segments of
    # one line as (2.40)-(2.41) do
    estimator: Literal["four", "d-only", "printed"] = "four"
    dt: float = 0.5  # control period, s
    images: int = 2  # in a control period, evenly spaced
    t_f: float = 60.0  # end of the episode, s
    a_max: float = 4.0  # length of the longest acceleration, m/s^2
    v_max: float = 10.0  # highest speed, m/s
    tilt_max: float = math.radians(35.0)  # largest angle of the camera from straight down, rad
    altitude: float = 30.0  # of the flight, constant, m
    area: float = 60.0  # half side of the square that is to be mapped, about the origin, m
    start: tuple[float, float] = (0.0, 0.0)  # in N, m
    start_drawn: tuple[float, float] = (60.0, 60.0)  # half width of a uniform draw about it, m
    # cost: time mean of the weighted terms, each from 0 to 1
    w_error: float = 1.0  # of the map's error, as a mean over the length of all edges
    w_uncertainty: float = 0.5  # of the deviation that the filter states, likewise
    w_uncovered: float = 0.5  # of the share of the area that no image has shown
    w_effort: float = 0.05  # of (acceleration / a_max)^2
    error_scale: float = 1.0  # an error or deviation no smaller counts as no map at all, m
    success_error: float = 0.25  # a final mean error no larger counts as success, m
    # scene
    scene: Literal["town", "pyramid", "frame", "terrain"] = "town"
    houses: tuple[float, float] = (5.0, 8.0)  # fewest and most
    side: tuple[float, float] = (8.0, 18.0)  # of their footprints, m
    wall: tuple[float, float] = (4.0, 12.0)  # their height, m
    roof: tuple[float, float] = (2.0, 5.0)  # height of a gable above the walls, m
    base: float = 40 * FOOT  # side of pyramid and frame, m
    height: float = 30 * FOOT  # of pyramid and frame; highest point of terrain, m
    points: int = POINTS  # of terrain along each side
    spacing: float = 20 * FOOT  # between them, m
    # camera
    half_width: float = math.tan(math.radians(30.0))  # of the square picture, focal lengths
    near: float = 1.0  # depth of the nearest plane that is seen, m
    sigma_image: float = 0.002  # noise of an image coordinate, focal lengths
    min_length: float = 0.02  # a shorter segment is not found, focal lengths
    p_detect: float = 0.9  # chance that a segment is found
    p_split: float = 0.05  # chance that it falls in two
    p_false: float = 0.05  # chance of a false segment in an image
    hidden: int = 1  # 1: what a house hides is not seen; 0: all houses are of wire
    # map
    s_ray: float = 8.0  # deviation of a new line's ends along their rays, m
    horizon: float = 0.05  # least downward part of a ray of unit depth that starts a line
    range_max: float = 150.0  # greatest depth at which one starts, m
    ztest_max: float = 30.0  # a segment with a larger z-test value is not of a line
    e_gate: float = 4.0  # deviations beyond which two ends are not the same
    extend_max: float = 0.5  # a line grows no more in an image, of its length
    delete_after: int = 5  # images one after another in which a line may be missed
    patience: float = 0.5  # and so many more for each image that it was seen in
    confirm: int = 3  # a line seen in fewer images is gone
    age_out: int = 20  # so many images later, wherever it is

    def __post_init__(self) -> None:
        validate(self)
        require(
            self,
            dt=self.dt > 0,
            images=self.images >= 1,
            t_f=self.t_f >= self.dt,
            a_max=self.a_max > 0,
            v_max=self.v_max > 0,
            tilt_max=0 <= self.tilt_max <= math.radians(80.0),
            altitude=self.altitude > 0,
            area=self.area > 0,
            start_drawn=min(self.start_drawn) >= 0,
            w_error=self.w_error >= 0,
            w_uncertainty=self.w_uncertainty >= 0,
            w_uncovered=self.w_uncovered >= 0,
            w_effort=self.w_effort >= 0,
            error_scale=self.error_scale > 0,
            success_error=self.success_error >= 0,
            houses=0 <= self.houses[0] <= self.houses[1] <= SOLIDS,
            side=0 < self.side[0] <= self.side[1],
            wall=0 < self.wall[0] <= self.wall[1],
            roof=0 < self.roof[0] <= self.roof[1],
            base=self.base > 0,
            height=self.height > 0,
            points=2 <= self.points <= POINTS,
            spacing=self.spacing > 0,
            half_width=self.half_width > 0,
            near=self.near > 0,
            sigma_image=self.sigma_image > 0,
            min_length=self.min_length > 0,
            p_detect=0 <= self.p_detect <= 1,
            p_split=0 <= self.p_split <= 1,
            p_false=0 <= self.p_false <= 1,
            hidden=self.hidden in (0, 1),
            s_ray=self.s_ray > 0,
            horizon=self.horizon > 0,
            range_max=self.range_max > 0,
            ztest_max=self.ztest_max > 0,
            e_gate=self.e_gate > 0,
            extend_max=self.extend_max >= 0,
            delete_after=self.delete_after >= 1,
            patience=self.patience >= 0,
            confirm=self.confirm >= 0,
            age_out=self.age_out >= 0,
        )
        if self.scene == "town" and self.side[1] > self.area:
            raise ValueError(
                f"MappingConfig.side: houses of up to {self.side[1]:g} m need an area of at least "
                f"that half side, got {self.area:g} m; write area={2.0 * self.side[1]:g}"
            )
        tallest = self.wall[1] + self.roof[1] if self.scene == "town" else self.height
        if self.altitude <= tallest + self.near:
            raise ValueError(
                f"MappingConfig.altitude: {self.altitude:g} m is not above a scene of up to "
                f"{tallest:g} m; write altitude={tallest + self.near + 10.0:g}"
            )


# 2.4.4: an image processor that sees every edge, through everything, in every image
CLEAN = MappingConfig(
    dt=0.2,
    images=4,
    p_detect=1.0,
    p_split=0.0,
    p_false=0.0,
    hidden=0,
    start_drawn=(0.0, 0.0),
    s_ray=30 * FOOT,
    min_length=0.01,
    patience=0.0,
)
SCENARIOS = {
    "town": MappingConfig(),
    # figure 15: eight edges that fit into one picture; sizes and altitude are ours
    "pyramid": replace(
        CLEAN,
        scene="pyramid",
        t_f=20.0,
        altitude=100 * FOOT,
        area=30 * FOOT,
        start=(100 * FOOT * math.tan(math.radians(30.0)), 0.0),
    ),
    # figure 16: the camera sees but a part of four edges
    "frame": replace(
        CLEAN,
        scene="frame",
        t_f=30.0,
        altitude=40 * FOOT,
        area=45 * FOOT,
        start=(-30 * FOOT, -30 * FOOT),
        v_max=15 * FOOT,
        base=60 * FOOT,
        height=10 * FOOT,
    ),
    # figures 18 and 19, a quarter of them: 8 x 8 of 16 x 16 points; `eval.reproduce` maps them all
    "terrain": replace(
        CLEAN,
        scene="terrain",
        dt=0.5,
        images=2,
        t_f=100.0,
        altitude=120 * FOOT,
        area=80 * FOOT,
        start=(50 * FOOT, 0.0),
        v_max=20 * FOOT,
        height=25 * FOOT,
    ),
}
