"""The cases that every environment must pass: each preset, the first under each estimator.

Toys (`tests/toys/envs/`) are among them. They are registered by being there, as any environment
is, so that their cases also say that a new environment is one file. Where actions are choices, the
cases choose at random, and a forbidden choice gives way to the next one that is allowed.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import get_args

import gymnasium as gym
import numpy as np
import pytest

from tests.toys import toys
from visenvs.core import registry
from visenvs.core.config import field_types, override
from visenvs.core.lanes import Lanes
from visenvs.core.layout import Choices

SAME_STEP = gym.vector.AutoresetMode.SAME_STEP


@dataclass(frozen=True)
class Case:
    env_id: str
    scenario: str
    settings: dict = field(default_factory=dict)
    toy: bool = False

    def __str__(self):
        return "-".join([self.env_id.split("/")[1], self.scenario, *self.settings.values()])

    @property
    def kwargs(self):
        return {"scenario": self.scenario, **self.settings}

    @property
    def task(self):
        task = registry.load_task(self.env_id)
        return task.under(override(task.scenarios[self.scenario], self.settings))

    def lanes(self, count, **changes):
        preset = self.task.scenarios[self.scenario]
        return Lanes(self.task, override(preset, self.settings | changes), count)

    def single(self, **kwargs):
        return gym.make(self.env_id, **self.kwargs, **kwargs)

    def vector(self, count, **kwargs):
        return gym.make_vec(self.env_id, count, **self.kwargs, **kwargs)

    def loop(self, count):
        """Gymnasium's own loop of single environments, in the same autoreset mode."""
        return self.vector(
            count, vectorization_mode="sync", vector_kwargs={"autoreset_mode": SAME_STEP}
        )

    @property
    def chooses(self):
        return isinstance(self.task.action, Choices)

    def actions(self, *shape, seed=7):
        action, rng = self.task.action, np.random.default_rng(seed)
        if self.chooses:
            return rng.integers(len(action.names), size=shape)
        return rng.uniform(-1, 1, (*shape, action.size)).astype(np.float32)


def cases(toy):
    for env_id in registry.environment_files():
        task = registry.load_task(env_id)
        alone = {name: p for name, p in task.scenarios.items() if task.team(p) == 1}
        for k, (scenario, preset) in enumerate(alone.items()):
            choices = get_args(field_types(type(preset)).get("estimator")) if k == 0 else ()
            for settings in [{"estimator": choice} for choice in choices] or [{}]:
                yield Case(env_id, scenario, settings, toy)


REAL = list(cases(toy=False))
with toys():
    CASES = REAL + list(cases(toy=True))
FILTERED = [case for case in REAL if case.lanes(1).config.estimator != "truth"]


def step_allowed(lanes, actions, step=Lanes.step):
    """`Lanes.step`, with every forbidden choice replaced by the next that is allowed."""
    chosen = np.asarray(actions)
    if isinstance(lanes.task.action, Choices) and np.issubdtype(chosen.dtype, np.integer):
        count, allowed = len(lanes.task.action.names), lanes.allowed
        for _ in range(count):
            forbidden = ~allowed[np.arange(lanes.count), chosen.ravel()]
            chosen = np.where(forbidden.reshape(chosen.shape), (chosen + 1) % count, chosen)
        actions = chosen
    return step(lanes, actions)


@pytest.fixture(params=CASES, ids=str)
def case(request, monkeypatch):
    """Each preset of each environment under each estimator, and of the toys."""
    monkeypatch.setattr(Lanes, "step", step_allowed)
    if not request.param.toy:
        yield request.param
        return
    with toys():
        yield request.param


@pytest.fixture(params=FILTERED, ids=str)
def filtered(request, monkeypatch):
    """Each preset of each environment, with a filter between truth and row."""
    monkeypatch.setattr(Lanes, "step", step_allowed)
    return request.param
