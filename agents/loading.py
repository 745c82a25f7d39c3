"""A network from a zip of stable-baselines3, without running anybody's code.

Such a zip holds JSON, pickles and tensors. Here the architecture is read from the zip's JSON and
from its weights as data, the weights through `torch.load(weights_only=True)`; pickles are not
touched. torch is imported only when a network is loaded.
"""

from __future__ import annotations

import io
import json
import zipfile
from pathlib import Path
from typing import Any

from visenvs.core.lanes import Task
from visenvs.core.layout import Choices

from .architecture import algorithm_of, architecture_of
from .networks import IF_YOURS, algorithm_class, check_kind, rebuild, wrong_space


def load_network(path: Path, task: Task, trust: bool = False) -> Any:
    """The SB3 policy in a zip, ready to predict.

    Args:
        path: an SB3 zip of PPO, A2C, TRPO, RecurrentPPO, SAC, TQC, TD3 or DDPG with an MLP policy.
        task: the environment that it is to fly; its spaces must fit.
        trust: let SB3 unpickle what the zip holds (custom policies need it). That runs code of
            whoever made the file.

    Raises:
        ValueError: not an SB3 zip, an architecture that cannot be rebuilt, or other spaces.
    """
    weights, data = _read_zip(path)
    algo = algorithm_of(path, weights)
    check_kind(path, task, algo in ("ppo", "recurrent_ppo") and "log_std" not in weights)
    if trust:
        masked = algo == "ppo" and isinstance(task.action, Choices)
        algo = "maskable_ppo" if masked else algo
        network = _unpickled(path, algo)
    else:
        try:
            network = rebuild(architecture_of(path, algo, weights, data), weights, task, path)
        except (IndexError, KeyError, TypeError, RuntimeError) as error:
            raise ValueError(f"{path}: its weights make no network: {error} {IF_YOURS}") from error
    seen = network.observation_space.shape
    if task.frames is not None and len(seen) == 3:
        seen = (*seen[1:], seen[0])  # SB3 puts the channels of pictures first
    if seen != task.space.shape:
        raise wrong_space(path, task, seen)
    acts, taken = network.action_space, task.action.space
    if (acts.shape, getattr(acts, "n", 0)) != (taken.shape, getattr(taken, "n", 0)):
        raise ValueError(f"{path} was trained on actions {acts}; {task.takes}")
    network.set_training_mode(False)
    return network


def _unpickled(path: Path, algo: str) -> Any:
    try:
        return algorithm_class(algo).load(path, device="cpu").policy
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
