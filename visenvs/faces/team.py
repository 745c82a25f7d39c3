"""The lanes that fly together as a PettingZoo environment: all agents act at once.

`visenvs.formation_v0` and its like name the task; this is for any task with a team.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.utils import seeding
from numpy.typing import NDArray
from pettingzoo import AECEnv, ParallelEnv  # pyright: ignore[reportMissingTypeStubs]
from pettingzoo.utils import parallel_to_aec, wrappers  # pyright: ignore[reportMissingTypeStubs]

from visenvs.core.layout import Choices, Row
from visenvs.core.outcome import RUNNING
from visenvs.faces import common
from visenvs.faces.infos import OUTCOMES, term_names

METADATA: dict[str, Any] = {"render_modes": ["rgb_array"], "is_parallelizable": True}
Stepped = tuple[
    dict[str, Row], dict[str, float], dict[str, bool], dict[str, bool], dict[str, dict[str, Any]]
]


class TeamEnv(common.OnLanes, ParallelEnv[str, Row, Any]):
    """One team of one task. Agent k is lane k; an agent that has ended leaves `agents` for good.

    Its lane stays as it is, so that the others go on seeing where it was left.

    Args:
        env_id: which task, by its Gymnasium id.
        scenario: which preset of the task, the first when None.
        render_mode: "rgb_array" or None.
        prefix: of the agents' names, which are numbered from 0.
        settings: fields of the task's configuration to change.
    """

    metadata: dict[str, Any] = METADATA

    def __init__(
        self,
        env_id: str,
        scenario: str | None = None,
        render_mode: str | None = None,
        prefix: str = "agent_",
        **settings: Any,
    ) -> None:
        self.lanes = common.open_lanes(env_id, scenario, settings, 1)
        shown = common.rendering(self.lanes, METADATA, render_mode)
        self.metadata = METADATA | shown | {"name": common.module_name(env_id)}
        self.render_mode = render_mode
        self.possible_agents: list[str] = [f"{prefix}{i}" for i in range(self.lanes.count)]
        self.agents: list[str] = []
        self._places = {agent: i for i, agent in enumerate(self.possible_agents)}
        self.observation_spaces: dict[str, Any] = {}
        self.action_spaces: dict[str, Any] = {}
        for agent in self.possible_agents:
            self.observation_spaces[agent] = common.own_space(self.task)
            self.action_spaces[agent] = common.own_space(self.task.action)
        one = self.task.space
        low, high = (np.tile(side.ravel(), self.lanes.count) for side in (one.low, one.high))
        self.state_space = gym.spaces.Box(low, high, dtype=one.low.dtype.type)
        self._width = self.task.action.size
        self._terms = term_names(self.task)
        self._begun = False

    def observation_space(self, agent: str) -> Any:
        """The box of an agent's rows or pictures."""
        return self.observation_spaces[agent]

    def action_space(self, agent: str) -> Any:
        """What an agent may do."""
        return self.action_spaces[agent]

    def reset(
        self, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Row], dict[str, dict[str, Any]]]:
        """Start an episode: the first of `seed`, or the next one of the seed that the team has.

        Without a seed the first reset draws one. No options are read.
        """
        if seed is None and not self._begun:
            seed = int(seeding.np_random()[0].integers(common.SEEDS))
        self.lanes.reset(None if seed is None else [seed])
        self._begun = True
        self.agents = self.possible_agents[:]
        return self._rows(self.agents), {agent: self._mask(agent) for agent in self.agents}

    def step(self, actions: Mapping[str, Any]) -> Stepped:
        """Advance the team by one step; every agent that is still there decides.

        Infos are those of the single environment: an agent's `reward_terms` sum to its reward, and
        at its end `outcome` and `metrics` are there.

        Raises:
            ValueError: an agent has no action, one that has ended or is unknown has one, or an
                action is refused by the task; no lane has been touched then.
            ResetNeeded: no episode is running.
        """
        if not self.agents:
            raise common.reset_needed(
                "the episode is over" if self._begun else "no episode has begun"
            )
        acted, lanes = self.agents, self.lanes
        lanes.step(self._gather(actions))
        done, cut = lanes.done, lanes.truncated
        terms = lanes.terms.tolist()
        rewards: dict[str, float] = {}
        terminated: dict[str, bool] = {}
        truncated: dict[str, bool] = {}
        infos: dict[str, dict[str, Any]] = {}
        for agent in acted:
            i = self._places[agent]
            rewards[agent] = float(lanes.rewards[i])
            terminated[agent], truncated[agent] = bool(done[i] and not cut[i]), bool(cut[i])
            infos[agent] = {"reward_terms": dict(zip(self._terms, terms[i], strict=True))}
            infos[agent] |= self._mask(agent)
            if done[i]:
                metrics = lanes.results(i)
                metrics.pop("outcome")
                infos[agent] |= {"outcome": OUTCOMES[lanes.outcome[i]], "metrics": metrics}
        self.agents = [agent for agent in acted if not done[self._places[agent]]]
        return self._rows(acted), rewards, terminated, truncated, infos

    def state(self) -> Row:
        """The rows of all agents one after the other, also of those that have ended."""
        return self.lanes.rows.reshape(-1).copy()

    def render(self) -> NDArray[np.uint8] | None:
        """The picture of the team (height, width, 3)."""
        if not self._begun:
            raise common.reset_needed("there is nothing to draw")
        if self.render_mode is None:
            common.warn_no_render_mode(self.task)
            return None
        return common.draw(self.lanes, 0)

    def snapshot(self) -> NDArray[Any]:
        """A copy of the whole state, for `restore`."""
        if not self._begun:
            raise common.reset_needed("there is no state to copy")
        return self.lanes.snapshot()

    def restore(self, snapshot: NDArray[Any]) -> None:
        """Return to a snapshot, of this environment or another of the same task and team."""
        self.lanes.restore(snapshot)
        self._begun = True
        running = self.lanes.outcome == RUNNING
        self.agents = [agent for agent, i in self._places.items() if running[i]]

    def _gather(self, actions: Mapping[str, Any]) -> NDArray[np.float32]:
        got = list(actions) if hasattr(actions, "keys") else type(actions).__name__
        if set(got) != set(self.agents):
            raise ValueError(
                f"expected one action for each of {self.agents}, got {got}; "
                "write `env.step({agent: ... for agent in env.agents})`"
            )
        rows = np.zeros((self.lanes.count, self._width), np.float32)
        for agent, action in actions.items():
            row, space = np.asarray(action), self.action_spaces[agent]
            if row.shape != space.shape:
                raise ValueError(
                    f"the action of {agent} has shape {space.shape}, got {row.shape}: "
                    f"{self.task.takes}"
                )
            rows[self._places[agent]] = row
        return rows

    def _rows(self, agents: list[str]) -> dict[str, Row]:
        return {agent: self.lanes.rows[self._places[agent]].copy() for agent in agents}

    def _mask(self, agent: str) -> dict[str, Any]:
        if not isinstance(self.task.action, Choices):
            return {}
        return {"action_mask": self.lanes.allowed[self._places[agent]].astype(np.int8)}


def parallel_env(env_id: str, scenario: str | None = None, **settings: Any) -> TeamEnv:
    """A team in which all agents act at once; see `TeamEnv`."""
    return TeamEnv(env_id, scenario, **settings)


def raw_env(env_id: str, scenario: str | None = None, **settings: Any) -> AECEnv[str, Row, Any]:
    """The same by PettingZoo's conversion to agents that act in turn, on one snapshot."""
    return parallel_to_aec(parallel_env(env_id, scenario, **settings))


def env(env_id: str, scenario: str | None = None, **settings: Any) -> AECEnv[str, Row, Any]:
    """`raw_env` that tells what is called in the wrong order."""
    return wrappers.OrderEnforcingWrapper(raw_env(env_id, scenario, **settings))
