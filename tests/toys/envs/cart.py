"""A cart on a line that must stop at the origin: the smallest environment there can be."""

from __future__ import annotations

from dataclasses import dataclass

from visenvs.core.compile import kernel
from visenvs.core.config import validate
from visenvs.core.lanes import Task, lane_dtype
from visenvs.core.layout import Field, Layout
from visenvs.core.noise import normal
from visenvs.core.outcome import RUNNING, SUCCESS

ENV_ID = "visenvs/Cart-v0"


@dataclass(frozen=True)
class CartConfig:
    dt: float = 0.1  # s
    radius: float = 0.1  # nearer to the origin is success, m
    longest: int = 30  # steps

    def __post_init__(self) -> None:
        validate(self)


@kernel
def reset_lanes(lanes, config):
    for i in range(lanes.shape[0]):
        lanes[i]["x"] = normal(lanes[i]["seed"], lanes[i]["episode"], 0, 0, 0)


@kernel
def step_lanes(lanes, actions, config):
    for i in range(lanes.shape[0]):
        lane, cfg = lanes[i], config[0]
        if lane["outcome"] == RUNNING:
            lane["v"] += cfg["dt"] * actions[i, 0]
            lane["x"] += cfg["dt"] * lane["v"]
            lane["cost_position"] = cfg["dt"] * lane["x"] ** 2
            lane["cost_control"] = cfg["dt"] * actions[i, 0] ** 2
            lane["total_cost"] += lane["cost_position"] + lane["cost_control"]
            if abs(lane["x"]) < cfg["radius"]:
                lane["outcome"] = SUCCESS


TASK = Task(
    id=ENV_ID,
    summary="stop at the origin",
    scenarios={"plain": CartConfig(), "endless": CartConfig(radius=0.0, longest=0)},
    lane=lane_dtype(
        [(name, "f8") for name in ("x", "v", "cost_position", "cost_control", "total_cost")]
    ),
    observation=Layout(
        (
            Field("x", 1, "m", "N", -10.0, 10.0, 2.0, "position"),
            Field("v", 1, "m/s", "N", -10.0, 10.0, 3.0, "velocity"),
        )
    ),
    action=Layout((Field("a", 1, "m/s^2", "N", -1.0, 1.0, 1.0, "acceleration"),)),
    costs=("cost_position", "cost_control"),
    metrics={"total_cost": "m^2 s"},
    reset_lanes=reset_lanes,
    step_lanes=step_lanes,
    max_steps=lambda config: config.longest,
)
