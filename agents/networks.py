"""Networks as stable-baselines3 builds them, with readers of our own for lists and pictures.

torch and stable-baselines3 are imported only when a network is built.
"""

from __future__ import annotations

from pathlib import Path
from textwrap import shorten
from typing import Any

import numpy as np
from gymnasium.spaces import Box

from visenvs.core.lanes import Task
from visenvs.core.layout import Choices, Layout

from .architecture import CHOOSING, FIRST_LAYER, LINEAR, Architecture

IF_YOURS = "(--trust loads it as stable-baselines3 does, if you made the file yourself)"


def set_network(layout: Layout, width: int) -> dict[str, Any]:
    """Arguments of an SB3 policy that reads the things that a row lists in any order."""
    from .sets import SetNetwork

    settings = {"layout": layout, "width": width}
    return {
        "features_extractor_class": SetNetwork,
        "features_extractor_kwargs": settings,
        "share_features_extractor": False,  # large values would drown what the actor learns
    }


def picture_network(width: int) -> dict[str, Any]:
    """Arguments of an SB3 policy that reads pictures."""
    from .pictures import PictureNetwork

    return {
        "features_extractor_class": PictureNetwork,
        "features_extractor_kwargs": {"width": width},
    }


def choice_network(task: Task, width: int) -> tuple[Any, dict[str, Any]]:
    """Class and arguments of an SB3 policy that chooses among listed things in any order."""
    from .choosing import SetChoicePolicy

    return SetChoicePolicy, {"choices": task.action, "layout": task.observation, "width": width}


def rebuild(arch: Architecture, weights: dict[str, Any], task: Task, path: Path) -> Any:
    """The SB3 policy of this architecture with these weights; a ValueError if they do not fit.

    Of SAC, TD3 and their like only the actor: critics, however many, fly nothing.
    """
    from torch import nn

    if CHOOSING in weights:
        chooser, choosing = choice_network(task, arch.sets)
        return _fill(chooser(*_spaces(task), _no_training, **choosing), weights, arch, task, path)
    kwargs: dict[str, Any] = {
        "net_arch": arch.net_arch,
        "activation_fn": getattr(nn, arch.activation),
    }
    if arch.algo == "recurrent_ppo":
        kwargs |= {
            "lstm_hidden_size": arch.lstm,
            "n_lstm_layers": sum(name.startswith("lstm_actor.weight_ih_l") for name in weights),
            "enable_critic_lstm": "lstm_critic.weight_ih_l0" in weights,
            "shared_lstm": not any(
                name.startswith(("lstm_critic.", "critic.")) for name in weights
            ),
        }
    if "actor.log_std" in weights:
        kwargs |= {"use_sde": True, "clip_mean": arch.clip_mean}
    if "log_std" in weights and weights["log_std"].ndim == 2:
        kwargs["use_sde"] = True  # exploration that depends on the state
    if arch.squash:
        kwargs |= {"use_sde": True, "squash_output": True}  # SB3 squashes only with it
    algo = "maskable_ppo" if isinstance(task.action, Choices) else arch.algo
    policy_class = algorithm_class(algo).policy_aliases[
        "MlpLstmPolicy" if arch.lstm else "MlpPolicy"
    ]
    layer = FIRST_LAYER[arch.algo]
    size = int(weights[layer if layer in weights else LINEAR].shape[1])
    if arch.pictures:
        if task.frames is None:
            raise ValueError(
                f"{path} reads pictures, {task.id} gives {task.observation.size} numbers; "
                + _advice(task, next(iter(task.pictures), ""))
            )
        kwargs |= picture_network(arch.pictures)
    elif arch.sets and any(field.each > 1 for field in task.observation.fields):
        kwargs |= set_network(task.observation, arch.sets)
    elif task.frames is not None or size != task.observation.size:
        raise wrong_space(path, task, (size,))
    policy = policy_class(*_spaces(task), _no_training, **kwargs)
    if arch.algo in ("sac", "td3"):
        actor = {name: value for name, value in weights.items() if name.startswith("actor.")}
        weights = {name.removeprefix("actor."): value for name, value in actor.items()}
        policy = policy.actor
    return _fill(policy, weights, arch, task, path)


def _spaces(task: Task) -> tuple[Any, Any]:
    seen = task.space
    if task.frames is not None:  # SB3 puts the channels of pictures first
        seen = Box(0, 255, (seen.shape[2], *seen.shape[:2]), np.uint8)
    return seen, task.action.space


def _fill(policy: Any, weights: dict[str, Any], arch: Architecture, task: Task, path: Path) -> Any:
    try:
        policy.load_state_dict(weights)
    except RuntimeError as error:
        why = str(error).splitlines()[1:2] or [str(error)]  # the first is SB3's name of the class
        raise ValueError(
            f"{path}: the weights do not fit {arch.algo} on {task.id}: "
            f"{shorten(why[0], 120, placeholder=' ...')} {IF_YOURS}"
        ) from None
    return policy


def _no_training(_left: float) -> float:
    return 0.0


def algorithm_class(algo: str) -> Any:
    """The SB3 algorithm of this name."""
    import stable_baselines3
    from sb3_contrib import MaskablePPO, RecurrentPPO

    classes = {
        "maskable_ppo": MaskablePPO,
        "ppo": stable_baselines3.PPO,
        "sac": stable_baselines3.SAC,
        "td3": stable_baselines3.TD3,
    }
    return {**classes, "recurrent_ppo": RecurrentPPO}[algo]


def wrong_space(path: Path, task: Task, shape: tuple[int, ...]) -> ValueError:
    """The error that a network reads something else than the task gives."""
    trained, given = (
        f"{size[0]} numbers" if len(size) == 1 else f"pictures {size}"
        for size in (shape, task.space.shape)
    )
    names = f" ({', '.join(task.observation.names)})" if task.frames is None else ""
    return ValueError(
        f"{path} was trained on observations of {trained}, {task.id} gives "
        f"{given}{names}; {_advice(task, _observation(task, shape))}"
    )


def check_kind(path: Path, task: Task, chooses: bool) -> None:
    """Refuse a network that chooses where numbers are flown, or the other way round."""
    if chooses != isinstance(task.action, Choices):
        kinds = {name: isinstance(action, Choices) for name, action in task.modes.items()}
        fits = next((name for name, kind in kinds.items() if kind == chooses), "")
        with_it = f'; load it from Python with action_mode="{fits}" in the configuration'
        raise ValueError(
            f"{path} was trained {'to choose' if chooses else 'on actions of numbers'}, "
            f"{task.takes}{with_it if fits else ''}"
        )


def _observation(task: Task, shape: tuple[int, ...]) -> str:
    """The choice of the setting `observation` that gives such observations; empty if none does."""
    if len(shape) == 3:
        return next(
            (name for name, f in task.pictures.items() if 3 * f.shots in (shape[0], shape[2])), ""
        )
    return next((name for name, view in task.views.items() if (view.size,) == shape), "")


def _advice(task: Task, observation: str) -> str:
    train = f"train with `python -m train.sb3 --env {task.id}"
    if not observation:
        return f"{train}`"
    return (
        f'it may fit observation="{observation}": {train} --observation {observation}`, whose card '
        f'says so, or load it from Python with observation="{observation}" in the configuration'
    )
