"""What happens during training: validation on fixed seeds, the best model kept, checkpoints."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from sb3_contrib import MaskablePPO
from sb3_contrib.common.maskable.evaluation import evaluate_policy as evaluate_masked
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import BaseCallback, ProgressBarCallback
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.off_policy_algorithm import OffPolicyAlgorithm

from visenvs.core.files import replacing

from .vec_env import LaneVecEnv


class Bar(ProgressBarCallback):
    """SB3's progress bar, which can also be closed when training breaks off."""

    def close(self) -> None:
        """Close the bar, if there is one: what is left open prints when nobody expects it."""
        if hasattr(self, "pbar"):
            self.pbar.close()


class Keeper(BaseCallback):
    """Validates every `every` steps, keeps the best model, and writes a checkpoint each time.

    Args:
        lanes: validation lanes, one episode each, the same at every validation.
        every: training steps between validations.
        out: folder for `model.zip` (the best so far) and `checkpoint.zip` (the newest).
        best: mean cost, steps and success rate of the best model of an earlier session, or None.
        note: called with these figures whenever there is a new best model, to write its card: a
            training that is killed must not leave a model without one.
        curve: receives steps, mean and median cost of every validation.
        at_once: also validate before the first step, where the network has learnt already.
    """

    def __init__(
        self,
        lanes: LaneVecEnv,
        every: int,
        out: Path,
        best: dict[str, Any] | None,
        note: Callable[[dict[str, Any]], None],
        at_once: bool = False,
        curve: list[Any] | None = None,
    ) -> None:
        super().__init__()
        self._lanes = lanes
        self._every = every
        self._out = out
        self._next = every
        self.best = best
        self._note = note
        self._at_once = at_once
        self._curve: list[Any] = [] if curve is None else curve

    def _on_training_start(self) -> None:
        self._next = self.num_timesteps + self._every
        if self._at_once:
            self.keep()

    def _on_step(self) -> bool:
        return True

    def _on_rollout_end(self) -> None:
        self.watch()

    def watch(self) -> None:
        """Validate where it is time to."""
        if self.num_timesteps >= self._next:
            self._next = self.num_timesteps + self._every
            self.keep()

    def keep(self) -> None:
        """Validate now, keep the model if it is the best, and write the checkpoint."""
        found = validate(self.model, self._lanes)
        self._curve.append([self.num_timesteps, found["cost_mean"], found["cost_median"]])
        for name, value in found.items() if self.n_calls else ():  # before training there is no log
            self.logger.record(f"validation/{name}", value)
        if self.best is None or found["cost_mean"] < self.best["cost_mean"]:
            with replacing(self._out / "model.zip") as path:
                self.model.save(path)
            self.best = {**found, "steps": self.num_timesteps}
            self._note(self.best)
        checkpoint(self.model, self._out)


def validate(model: BaseAlgorithm, lanes: LaneVecEnv) -> dict[str, float]:
    """Costs (SI) and success rate of the deterministic policy, one episode for each lane."""
    won: list[bool] = []

    def watch(local: dict[str, Any], _globals: dict[str, Any]) -> None:
        if local["done"]:
            won.append(local["info"]["is_success"])

    evaluate: Any = evaluate_masked if isinstance(model, MaskablePPO) else evaluate_policy
    returns, _ = evaluate(
        model,
        lanes,
        n_eval_episodes=lanes.num_envs,
        return_episode_rewards=True,
        warn=False,
        callback=watch,
    )
    costs = -np.asarray(returns, float)
    return {
        "cost_mean": float(costs.mean()),
        "cost_median": float(np.median(costs)),
        "cost_p95": float(np.percentile(costs, 95)),
        "success_rate": float(np.mean(won)),
        "episodes": len(costs),
    }


def checkpoint(model: BaseAlgorithm, out: Path) -> None:
    """Everything that is needed to go on: the model and, off policy, its replay buffer."""
    if isinstance(model, OffPolicyAlgorithm):
        with replacing(out / "replay.pkl") as path:
            model.save_replay_buffer(path)
    with replacing(out / "checkpoint.zip") as path:
        model.save(path)
