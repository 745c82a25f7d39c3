"""Stairs with a landing to be reached: the smallest environment of choices, some forbidden."""

from __future__ import annotations

from dataclasses import dataclass

from visenvs.core.compile import kernel
from visenvs.core.config import validate
from visenvs.core.lanes import Task, lane_dtype
from visenvs.core.layout import Choices, Field, Layout
from visenvs.core.noise import uniform
from visenvs.core.outcome import RUNNING, SUCCESS

ENV_ID = "visenvs/Stairs-v0"


@dataclass(frozen=True)
class StairsConfig:
    dt: float = 1.0  # s
    steps: int = 6
    longest: int = 40

    def __post_init__(self) -> None:
        validate(self)


@kernel
def look(lane, cfg):
    """Down is forbidden at the bottom, up at the top."""
    lane["allowed"][0] = 1.0
    lane["allowed"][1] = 1.0 if lane["height"] > 0.5 else 0.0
    lane["allowed"][2] = 1.0 if lane["height"] < cfg["steps"] - 0.5 else 0.0


@kernel
def reset_lanes(lanes, config):
    for i in range(lanes.shape[0]):
        u = uniform(lanes[i]["seed"], lanes[i]["episode"], 0, 0, 0)
        lanes[i]["height"] = float(int(u * (config[0]["steps"] + 1)))
        lanes[i]["landing"] = float(int(u * 1e6) % (config[0]["steps"] + 1))
        look(lanes[i], config[0])


@kernel
def step_lanes(lanes, actions, config):
    for i in range(lanes.shape[0]):
        lane = lanes[i]
        if lane["outcome"] == RUNNING:
            if actions[i, 0] == 1.0:
                lane["height"] -= 1.0
            if actions[i, 0] == 2.0:
                lane["height"] += 1.0
            lane["cost_time"] = 1.0
            lane["total_cost"] += 1.0
            look(lane, config[0])
            if lane["height"] == lane["landing"]:
                lane["outcome"] = SUCCESS


TASK = Task(
    id=ENV_ID,
    summary="reach the landing",
    scenarios={"plain": StairsConfig()},
    lane=lane_dtype(
        [
            *((name, "f8") for name in ("height", "landing", "cost_time", "total_cost")),
            ("allowed", "f8", (3,)),
        ]
    ),
    observation=Layout(
        (
            Field("height", 1, "", "", 0.0, 100.0, 10.0, "step one stands on"),
            Field("landing", 1, "", "", 0.0, 100.0, 10.0, "step to be reached"),
            Field("allowed", 3, "", "", 0.0, 1.0, 1.0, "1 for each choice that may be taken"),
        )
    ),
    action=Choices(("stay", "down", "up"), mask="allowed"),
    costs=("cost_time",),
    metrics={"total_cost": ""},
    reset_lanes=reset_lanes,
    step_lanes=step_lanes,
    max_steps=lambda config: config.longest,
)
