"""What network a zip of stable-baselines3 holds, told from the names and shapes of its weights."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

# The layer that reads the observation tells the algorithm; recurrent PPO also has plain PPO's.
# Maskable PPO's network is plain PPO's: that actions are choices tells. So are those of A2C and
# TRPO; TQC's actor is SAC's, and DDPG's is TD3's.
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
EXTRACTORS = ("", "FlattenExtractor", "SetNetwork", "PictureNetwork")  # that are rebuilt
OURS = ("stable_baselines3.", "sb3_contrib.", "agents.")  # where policies that are rebuilt are
ACTIVATIONS = ("Tanh", "ReLU", "ELU", "LeakyReLU", "SiLU", "GELU")


@dataclass(frozen=True)
class Architecture:
    """What it takes to rebuild an SB3 policy: algorithm, layer widths, activation, special widths.

    `lstm`, `sets` and `pictures` are the widths of a memory, of a network for lists and of one for
    pictures, 0 where there is none. `squash`: the mean action goes through a tanh (PPO's policies);
    `clip_mean`: the largest mean of SAC before it, where exploration depends on the state.
    """

    algo: str
    net_arch: Any
    activation: str
    lstm: int = 0
    sets: int = 0
    pictures: int = 0
    squash: bool = False
    clip_mean: float = 2.0


def algorithm_of(path: Path, weights: dict[str, Any]) -> str:
    """The algorithm whose weights these are; a ValueError where there is none."""
    if CHOOSING in weights:
        return "ppo"
    for algo, layer in FIRST_LAYER.items():
        if layer in weights and weights[layer].ndim == 2:
            return algo
    if LINEAR in weights:
        return "ppo"
    raise ValueError(
        f"{path}: the weights are not of a PPO, RecurrentPPO, SAC or TD3 policy, with or without "
        "--trust; fly it as `module:factory`"
    )


def architecture_of(
    path: Path, algo: str, weights: dict[str, Any], data: dict[str, Any]
) -> Architecture:
    """How the network is built, or a ValueError where it cannot be told without running code.

    Args:
        path: for errors.
        algo: from `algorithm_of`.
        weights: tensors by name.
        data: the zip's JSON.
    """
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
    kwargs = kwargs if isinstance(kwargs, dict) else {}
    _check_classes(path, kwargs.get("features_extractor_class", ""), data.get("policy_class"))
    named = _last(kwargs.get("activation_fn", ""))
    default = "Tanh" if algo in ("ppo", "recurrent_ppo") else "ReLU"
    activation = named or default
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
        squash = kwargs.get("squash_output") is True
        return Architecture(algo, {"pi": pi, "vf": vf}, activation, lstm, sets, pictures, squash)
    pi = _widths(weights, "actor.latent_pi") if algo == "sac" else _widths(weights, "actor.mu")[:-1]
    clip_mean = kwargs.get("clip_mean", Architecture.clip_mean)
    return Architecture(algo, {"pi": pi, "qf": []}, activation, clip_mean=clip_mean)


def _check_classes(path: Path, extractor: Any, policy: Any) -> None:
    """Refuse classes of others: one without weights would be left out and nobody would see it."""
    if _last(extractor) not in EXTRACTORS:
        raise ValueError(
            f"{path}: has a features extractor of its own ({_last(extractor)}); it needs --trust"
        )
    module = policy.get("__module__", OURS[0]) if isinstance(policy, dict) else OURS[0]
    if not str(module).startswith(OURS):
        raise ValueError(f"{path}: has a policy class of its own (in {module}); it needs --trust")


def _last(named: Any) -> str:
    """The name of a class that SB3's JSON shows as "<class 'package.module.Name'>"."""
    return str(named).rsplit(".", 1)[-1].rstrip("'>")


def _widths(weights: dict[str, Any], prefix: str) -> list[int]:
    layers = [
        name for name in weights if name.startswith(f"{prefix}.") and name.endswith(".weight")
    ]
    return [
        int(weights[name].shape[0]) for name in sorted(layers, key=lambda n: int(n.split(".")[-2]))
    ]
