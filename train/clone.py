"""Behaviour cloning from a Minari dataset: `python -m train.clone --help`.

The baseline of offline learning: a network is fitted to the recorded actions by least squares, and
nothing is flown meanwhile (Pomerleau 1989). It is written as `train.sb3` writes models, so that the
leaderboard flies it beside its expert.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from visenvs.core.cli import launch
from visenvs.core.config import field_types, override, pick, to_json
from visenvs.core.files import write_json
from visenvs.core.layout import Choices
from visenvs.core.provenance import provenance
from visenvs.core.registry import load_task

from . import options as training
from .build import build_lanes, build_model
from .callbacks import validate
from .minari_export import library
from .presets import preset_for
from .record import card as card_of
from .tutor import fit

BATCH = 2048
RATE = 1e-3  # falls linearly to a twentieth


@dataclass(frozen=True)
class Options:
    """What to learn from, and where to write the model."""

    dataset: str
    """Minari's name, as `train.minari_export` prints it"""
    out: Path
    """folder for model.zip and card.json"""
    passes: int = 30
    """how often all steps are learnt from"""
    seed: int = 0
    """of the network and of the order"""


def run(options: Options) -> None:
    """Fit a network to the actions of a dataset, and validate it in flight."""
    if options.passes < 1 or options.seed < 0:
        raise ValueError(
            f"passes must be at least 1 and the seed not negative, got {options.passes}, "
            f"{options.seed}"
        )
    dataset = opened(options.dataset)
    spec = dataset.env_spec
    env, asked = spec.id, spec.kwargs
    task = load_task(env)
    scenario = asked.get("scenario", next(iter(task.scenarios)))
    config = pick("scenario", scenario, task.scenarios)
    known = field_types(type(config))
    config = override(config, {name: value for name, value in asked.items() if name in known})
    task = task.under(config)
    if isinstance(task.action, Choices) or task.frames is not None:
        raise ValueError(f"only rows and continuous actions are cloned, not those of {env}")
    rows, actions = steps_of(dataset)
    torch.set_num_threads(1)
    made = training.Options(out=options.out, env=env, scenario=scenario, seed=options.seed)
    preset = preset_for(env, "ppo")
    lanes, validation = build_lanes(made, preset, task, config, 0)
    model: Any = build_model(made, preset, lanes)
    learn(model.policy, rows, actions, options.passes)
    best = {**validate(model, validation), "steps": len(rows)}
    options.out.mkdir(parents=True, exist_ok=True)
    model.save(options.out / "model.zip")
    curve = [[len(rows), best["cost_mean"], best["cost_median"]]]
    told = {"best": best, "curve": curve, "config": to_json(config), **provenance("train.clone")}
    card = card_of(made, task, scenario, preset, told) | {"dataset": options.dataset}
    write_json(options.out / "card.json", card)
    reached = f"mean cost {best['cost_mean']:.4g}, success {best['success_rate']:.3f}"
    print(f"from {len(rows):,} steps: {reached}")
    print(
        f"try it: python -m eval.leaderboard --env {env} "
        f"--policies {task.reference},{options.out / 'model.zip'}"
    )


def opened(name: str) -> Any:
    """A dataset of one of our environments, or a ValueError that says what there is."""
    minari = library()
    known = minari.list_local_datasets()
    if name not in known:
        raise ValueError(
            f"no dataset {name!r}; there are: {', '.join(known) or 'none'}; "
            f"write `python -m train.minari_export --dataset {name}`"
        )
    dataset = minari.load_dataset(name)
    if dataset.env_spec is None or not dataset.env_spec.id.startswith("visenvs/"):
        raise ValueError(f"{name} is not a dataset of a visenvs environment")
    return dataset


def steps_of(dataset: Any) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """All rows (n, k) in which a decision was made, and the decisions (n, size)."""
    episodes = list(dataset.iterate_episodes())
    rows = np.concatenate([episode.observations[:-1] for episode in episodes])
    actions = np.concatenate([episode.actions for episode in episodes])
    return rows.astype(np.float32, copy=False), actions.astype(np.float32, copy=False)


def learn(
    policy: Any, rows: NDArray[np.float32], actions: NDArray[np.float32], passes: int
) -> None:
    """Fit the mean of an SB3 policy in place."""
    optimiser = torch.optim.Adam(policy.parameters(), lr=RATE)
    for k in range(passes):
        for group in optimiser.param_groups:
            group["lr"] = RATE * max(1.0 - k / passes, 0.05)
        fit(policy, optimiser, rows, actions, BATCH)


if __name__ == "__main__":
    launch("train.clone", Options, run)
