"""Carts in a row that each follow the one before: the smallest team there can be.

Its only `Gymnasium` scenario has one cart; `several` is flown together.
"""

from __future__ import annotations

from dataclasses import dataclass

from visenvs.core.compile import kernel
from visenvs.core.config import require, validate
from visenvs.core.lanes import Task, lane_dtype
from visenvs.core.layout import Field, Layout
from visenvs.core.noise import normal
from visenvs.core.outcome import LOST, RUNNING, SUCCESS

ENV_ID = "visenvs/Convoy-v0"


@dataclass(frozen=True)
class ConvoyConfig:
    dt: float = 0.1  # s
    carts: int = 1
    longest: int = 30  # steps
    lost: float = 3.0  # a gap this far from 1 m is lost, m

    def __post_init__(self) -> None:
        validate(self)
        require(self, carts=self.carts >= 1)


@kernel
def see(team):
    """Everybody looks at the cart before it; the first at a fixed point."""
    for k in range(team.shape[0]):
        ahead = team[k - 1]["x"] if k else 1.0
        team[k]["gap"] = ahead - team[k]["x"]


@kernel
def reset_lanes(lanes, config):
    n = config[0]["carts"]
    for first in range(0, lanes.shape[0], n):
        team = lanes[first : first + n]
        for k in range(n):
            team[k]["x"] = -k + 0.3 * normal(team[k]["seed"], team[k]["episode"], k, 0, 0)
        see(team)


@kernel
def step_lanes(lanes, actions, config):
    cfg, n = config[0], config[0]["carts"]
    for first in range(0, lanes.shape[0], n):
        team = lanes[first : first + n]
        for k in range(n):
            if team[k]["outcome"] == RUNNING:
                team[k]["x"] += cfg["dt"] * actions[first + k, 0]
        see(team)
        for k in range(n):
            if team[k]["outcome"] == RUNNING:
                team[k]["cost_gap"] = cfg["dt"] * (team[k]["gap"] - 1.0) ** 2
                team[k]["total_cost"] += team[k]["cost_gap"]
                if abs(team[k]["gap"] - 1.0) > cfg["lost"]:
                    team[k]["outcome"] = LOST
                elif team[k]["step"] >= cfg["longest"]:
                    team[k]["outcome"] = SUCCESS


TASK = Task(
    id=ENV_ID,
    summary="keep the gap",
    scenarios={"alone": ConvoyConfig()},
    lane=lane_dtype([(name, "f8") for name in ("x", "gap", "cost_gap", "total_cost")]),
    observation=Layout(
        (
            Field("x", 1, "m", "", -100.0, 100.0, 1.0, "own place"),
            Field("gap", 1, "m", "", -10.0, 10.0, 1.0, "to the cart before"),
        )
    ),
    action=Layout((Field("v", 1, "m/s", "", -1.0, 1.0, 1.0, "speed"),)),
    costs=("cost_gap",),
    metrics={"total_cost": "m^2 s"},
    reset_lanes=reset_lanes,
    step_lanes=step_lanes,
    team=lambda config: config.carts,
)
