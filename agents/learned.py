"""Learned policies, loaded without running anybody's code.

An SB3 zip holds JSON, pickles and tensors. Here the architecture is read from the card or from the
zip's JSON as data, the weights through `torch.load(weights_only=True)`; pickles are not touched.
torch and stable-baselines3 are imported only when a policy is loaded.
"""

from __future__ import annotations

import hashlib
import io
import json
import zipfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from gymnasium.spaces import Box
from numpy.typing import NDArray

from visenvs.core.lanes import Task
from visenvs.core.layout import Choices, Layout

from .policy import Actions, Rows, State
from .residual import Residual

# The layer that reads the observation tells the algorithm; recurrent PPO also has plain PPO's.
# Maskable PPO's network is plain PPO's: that actions are choices tells.
FIRST_LAYER = {
    "sac": "actor.latent_pi.0.weight",
    "td3": "actor.mu.0.weight",
    "recurrent_ppo": "lstm_actor.weight_ih_l0",
    "ppo": "mlp_extractor.policy_net.0.weight",
}
PICTURES = "features_extractor.full.0.weight"  # our own, see `pictures.py`
LINEAR = "action_net.weight"  # the layer that reads where PPO's network has no hidden one
SETS = "features_extractor.encoder."  # our own, see `sets.py`
CHOOSING = "action_net.apiece.weight"  # our own, see `choosing.py`
CARD = ("information", "algo", "residual", "steps")  # what is read of it besides its sha256
RESIDUAL = {"law", "scale"}  # and "reads" where the network is told the law's command
ACTIVATIONS = ("Tanh", "ReLU", "ELU", "LeakyReLU", "SiLU", "GELU")


class LearnedPolicy:
    """A network, alone or as a residual on a law; among choices, it is told which may be taken."""

    def __init__(self, network: Any, task: Task, residual: Residual | None = None) -> None:
        self._network = network
        self._task = task
        self._residual = residual
        self._plain = task.frames is None and _is_plain(network)

    def predict(
        self,
        observation: Rows,
        state: State | None = None,
        episode_start: NDArray[np.bool_] | None = None,
        deterministic: bool = True,
    ) -> tuple[Actions, State | None]:
        """Actions of the network, plus the law's where it is a residual."""
        choices = self._task.action
        if isinstance(choices, Choices):
            allowed = choices.allowed(observation, self._task.observation)
            told = observation, state, episode_start, deterministic
            return self._network.predict(*told, action_masks=allowed)
        seen, command = observation, None
        if self._residual is not None:
            command = self._residual.command(observation)
            seen = self._residual.seen(observation, command)
        if self._plain and deterministic:
            action = np.clip(_mean(self._network, seen), -1.0, 1.0)
        else:
            action, state = self._network.predict(seen, state, episode_start, deterministic)
        if self._residual is not None and command is not None:
            action = self._residual.combine(command, action)
        return np.clip(action, -1.0, 1.0), state


def _is_plain(network: Any) -> bool:
    """Whether a network is PPO's actor without memory, whose mean action is one forward pass."""
    from stable_baselines3.common.policies import ActorCriticPolicy

    return isinstance(network, ActorCriticPolicy) and not hasattr(network, "lstm_actor")


def _mean(network: Any, observation: NDArray[Any]) -> Rows:
    """The mean action, as SB3's `predict` gives it, without its overhead for small networks."""
    import torch

    with torch.inference_mode():
        rows = torch.from_numpy(np.ascontiguousarray(observation))
        features = network.pi_features_extractor(rows)  # shared with the critic or not
        return network.action_net(network.mlp_extractor.forward_actor(features)).numpy()


@dataclass(frozen=True)
class Architecture:
    """What it takes to rebuild an SB3 policy: algorithm, layer widths, activation, special widths.

    `lstm`, `sets` and `pictures` are the widths of a memory, of a network for lists and of one for
    pictures, 0 where there is none.
    """

    algo: str
    net_arch: Any
    activation: str
    lstm: int = 0
    sets: int = 0
    pictures: int = 0


def digest(path: Path) -> str:
    """sha256 of a file, hexadecimal."""
    return hashlib.sha256(path.read_bytes()).hexdigest()


def read_card(model: Path) -> dict[str, Any]:
    """`card.json` beside a model, its sha256 checked; empty where there is none."""
    path = model.with_name("card.json")
    if not path.exists():
        return {}
    try:
        card = json.loads(path.read_text(encoding="utf-8"))
    except ValueError as error:
        raise ValueError(f"{path} is not JSON: {error}") from None
    if not isinstance(card, dict) or card.get("sha256") != digest(model):
        raise ValueError(
            f"{path} does not belong to {model.name}: the sha256 differs; "
            "take both files from one training, "
            "or remove the card to load the network alone"
        )
    if lacking := [name for name in CARD if name not in card]:
        raise ValueError(
            f"{path} does not say {', '.join(lacking)}; expected what `python -m train.sb3` writes"
        )
    residual = card["residual"]
    if residual is not None and not (
        isinstance(residual, dict)
        and set(residual) in (RESIDUAL, RESIDUAL | {"reads"})
        and isinstance(residual.get("reads", []), list)
    ):
        raise ValueError(
            f'{path}: residual must be null or {{"law": NAME, "scale": NUMBER}}, and may have '
            f'"reads": [FIELD, ...], got {residual!r}'
        )
    return card


def load_network(path: Path, task: Task, trust: bool = False) -> Any:
    """The SB3 policy in a zip, ready to predict.

    Args:
        path: an SB3 zip of PPO, RecurrentPPO, SAC or TD3 with an MLP policy.
        task: the environment that it is to fly; its spaces must fit.
        trust: let SB3 unpickle what the zip holds (custom policies need it). That runs code of
            whoever made the file.

    Raises:
        ValueError: not an SB3 zip, an architecture that cannot be rebuilt, or other spaces.
    """
    weights, data = _read_zip(path)
    algo = _algorithm(path, weights)
    if trust:
        masked = algo == "ppo" and isinstance(task.action, Choices)
        algo = "maskable_ppo" if masked else algo
        network = _unpickled(path, algo)
    else:
        try:
            network = _rebuild(_architecture(path, algo, weights, data), weights, task, path)
        except (IndexError, KeyError, TypeError, RuntimeError) as error:
            raise ValueError(f"{path}: its weights make no network: {error}") from error
    seen = network.observation_space.shape
    if task.frames is not None and len(seen) == 3:
        seen = (*seen[1:], seen[0])  # SB3 puts the channels of pictures first
    if seen != task.space.shape:
        raise _wrong_space(path, task, seen)
    network.set_training_mode(False)
    return network


def _unpickled(path: Path, algo: str) -> Any:
    try:
        return _algorithm_class(algo).load(path, device="cpu").policy
    except Exception as error:  # the file's own code runs
        raise ValueError(
            f"{path} cannot be loaded, even with --trust: {type(error).__name__}: {error}"
        ) from error


def _read_zip(path: Path) -> tuple[dict[str, Any], dict[str, Any]]:
    import torch

    try:
        with zipfile.ZipFile(path) as archive:
            data = json.loads(archive.read("data"))
            weights = torch.load(
                io.BytesIO(archive.read("policy.pth")), map_location="cpu", weights_only=True
            )
    except FileNotFoundError:
        raise ValueError(f"no file {path}") from None
    except Exception as error:
        raise ValueError(
            f"{path} is not a stable-baselines3 model that can be read safely "
            f"({type(error).__name__}: {error}); "
            "expected what `model.save(...)` writes"
        ) from None
    if not isinstance(data, dict) or not _is_state(weights):
        raise ValueError(f"{path} is not a stable-baselines3 model: its parts have the wrong types")
    return weights, data


def _is_state(weights: Any) -> bool:
    """Whether these are tensors by name, none of which claims more numbers than the file holds."""
    import torch

    return isinstance(weights, dict) and all(
        isinstance(name, str)
        and isinstance(value, torch.Tensor)
        and value.numel() * value.element_size() <= value.untyped_storage().nbytes()
        for name, value in weights.items()
    )


def _algorithm(path: Path, weights: dict[str, Any]) -> str:
    if CHOOSING in weights:
        return "ppo"
    for algo, layer in FIRST_LAYER.items():
        if layer in weights:
            return algo
    if LINEAR in weights:
        return "ppo"
    raise ValueError(f"{path}: the weights are not of a PPO, RecurrentPPO, SAC or TD3 policy")


def _architecture(
    path: Path, algo: str, weights: dict[str, Any], data: dict[str, Any]
) -> Architecture:
    extra = [
        name
        for name in weights
        if name.startswith(("features_extractor.", "actor.features_extractor."))
        and not (algo == "ppo" and (name.startswith(SETS) or CHOOSING in weights))
        and PICTURES not in weights
    ]
    if extra:
        raise ValueError(
            f"{path}: has a features extractor of its own ({extra[0]}); it needs --trust"
        )
    kwargs = data.get("policy_kwargs")
    named = str(kwargs.get("activation_fn", "")) if isinstance(kwargs, dict) else ""
    default = "Tanh" if algo in ("ppo", "recurrent_ppo") else "ReLU"
    activation = named.rsplit(".", 1)[-1].rstrip("'>") or default
    if activation not in ACTIVATIONS:
        raise ValueError(
            f"{path}: activation {activation!r} is not one of {', '.join(ACTIVATIONS)}; "
            "it needs --trust"
        )
    if CHOOSING in weights:
        return Architecture(algo, [], activation, sets=weights[CHOOSING].shape[1])
    if algo in ("ppo", "recurrent_ppo"):
        pi, vf = (_widths(weights, f"mlp_extractor.{part}_net") for part in ("policy", "value"))
        lstm = weights["lstm_actor.weight_hh_l0"].shape[1] if algo == "recurrent_ppo" else 0
        first = weights.get(f"{SETS}0.weight")
        sets = 0 if first is None else first.shape[0]
        pictures = 0 if PICTURES not in weights else weights[PICTURES].shape[0]
        return Architecture(algo, {"pi": pi, "vf": vf}, activation, lstm, sets, pictures)
    pi = _widths(weights, "actor.latent_pi") if algo == "sac" else _widths(weights, "actor.mu")[:-1]
    return Architecture(algo, {"pi": pi, "qf": _widths(weights, "critic.qf0")[:-1]}, activation)


def _widths(weights: dict[str, Any], prefix: str) -> list[int]:
    layers = [
        name for name in weights if name.startswith(f"{prefix}.") and name.endswith(".weight")
    ]
    return [
        int(weights[name].shape[0]) for name in sorted(layers, key=lambda n: int(n.split(".")[-2]))
    ]


def _rebuild(arch: Architecture, weights: dict[str, Any], task: Task, path: Path) -> Any:
    from torch import nn

    if CHOOSING in weights and isinstance(task.action, Choices):
        chooser, choosing = choice_network(task, arch.sets)
        return _fill(chooser(*_spaces(task), _no_training, **choosing), weights, arch, task, path)
    kwargs: dict[str, Any] = {
        "net_arch": arch.net_arch,
        "activation_fn": getattr(nn, arch.activation),
    }
    if arch.algo == "recurrent_ppo":
        kwargs |= {
            "lstm_hidden_size": arch.lstm,
            "enable_critic_lstm": "lstm_critic.weight_ih_l0" in weights,
        }
    if "log_std" in weights and weights["log_std"].ndim == 2:
        kwargs["use_sde"] = True  # exploration that depends on the state
    algo = "maskable_ppo" if isinstance(task.action, Choices) else arch.algo
    policy_class = _algorithm_class(algo).policy_aliases[
        "MlpLstmPolicy" if arch.lstm else "MlpPolicy"
    ]
    layer = FIRST_LAYER[arch.algo]
    size = int(weights[layer if layer in weights else LINEAR].shape[1])
    if arch.pictures:
        if task.frames is None:
            raise ValueError(
                f"{path} reads pictures, {task.id} gives {task.observation.size} numbers; write "
                f"observation='pixels', or train with `python -m train.sb3 --env {task.id}`"
            )
        kwargs |= picture_network(arch.pictures)
    elif arch.sets and any(field.each > 1 for field in task.observation.fields):
        kwargs |= set_network(task.observation, arch.sets)
    elif size != task.observation.size:
        raise _wrong_space(path, task, (size,))
    policy = policy_class(*_spaces(task), _no_training, **kwargs)
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
        raise ValueError(
            f"{path}: the weights do not fit {arch.algo} on {task.id}: {error}"
        ) from None
    return policy


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


def _no_training(_left: float) -> float:
    return 0.0


def _algorithm_class(algo: str) -> Any:
    import stable_baselines3
    from sb3_contrib import MaskablePPO, RecurrentPPO

    classes = {
        "maskable_ppo": MaskablePPO,
        "ppo": stable_baselines3.PPO,
        "sac": stable_baselines3.SAC,
        "td3": stable_baselines3.TD3,
    }
    return {**classes, "recurrent_ppo": RecurrentPPO}[algo]


def _wrong_space(path: Path, task: Task, shape: tuple[int, ...]) -> ValueError:
    trained, given = (
        f"{size[0]} numbers" if len(size) == 1 else f"pictures {size}"
        for size in (shape, task.space.shape)
    )
    names = f" ({', '.join(task.observation.names)})" if task.frames is None else ""
    return ValueError(
        f"{path} was trained on observations of {trained}, {task.id} gives "
        f"{given}{names}; train with `python -m train.sb3 --env {task.id}`"
    )
