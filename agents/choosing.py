"""A network that chooses among services of listed things, whatever their order.

Every thing goes through the same small network beside what the row tells once; what comes out is
pooled over all things, and a second network turns each thing and the pool into the logits of that
thing's choices. Another order of the things puts their logits in that order and changes nothing
else (permutation equivariance, Zaheer et al. 2017).
"""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import torch
from sb3_contrib.common.maskable.policies import MaskableActorCriticPolicy
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor
from torch import Tensor, nn

from visenvs.core.layout import Choices, Layout


def layers(entering: int, width: int, leaving: int) -> nn.Sequential:
    """A network with one hidden layer."""
    return nn.Sequential(nn.Linear(entering, width), nn.ReLU(), nn.Linear(width, leaving))


class Things(BaseFeaturesExtractor):
    """Features of a row: what it tells once and the pooled things, then each thing's own.

    Args:
        observation_space: of the rows.
        layout: of the same rows; it says which columns belong to which thing.
        width: of the hidden layers, and of what is kept of a thing.
    """

    def __init__(self, observation_space: gym.Space[Any], layout: Layout, width: int) -> None:
        once, listed = layout.members()
        self.each, self.pooled = len(listed), len(once) + 2 * width
        super().__init__(observation_space, self.pooled + self.each * width)
        self.beside, self.own = nn.Linear(len(once), width), nn.Linear(listed.shape[1], width)
        self.second = nn.Linear(width, width)
        self._once, self._listed = torch.from_numpy(once), torch.from_numpy(listed)

    def forward(self, observations: Tensor) -> Tensor:
        """Features (n, features_dim) of rows (n, size)."""
        once, things = observations[:, self._once], observations[:, self._listed]
        present = (things != 0).any(dim=2, keepdim=True)
        first = torch.relu(self.own(things) + self.beside(once)[:, None, :])
        found = torch.relu(self.second(first)) * present
        pool = [once, found.amax(dim=1), found.mean(dim=1)]
        return torch.cat([*pool, found.flatten(1)], dim=1)


class Head(nn.Module):
    """Logits of all choices from the features of `Things`."""

    def __init__(self, pooled: int, each: int, width: int, choices: Choices) -> None:
        super().__init__()
        self._pooled, self._each, self._first = pooled, each, choices.first
        others = len(choices.names) - each * choices.apiece
        self.beside, self.own = nn.Linear(pooled, width), nn.Linear(width, width)
        self.apiece = nn.Linear(width, choices.apiece)
        self.others = layers(pooled, width, others)

    def forward(self, features: Tensor) -> Tensor:
        """Logits (n, choices)."""
        pool, things = features[:, : self._pooled], features[:, self._pooled :]
        things = things.view(len(features), self._each, -1)
        hidden = torch.relu(self.own(things) + self.beside(pool)[:, None, :])
        own = self.apiece(hidden).flatten(1)
        others = self.others(pool)
        return torch.cat([others[:, : self._first], own, others[:, self._first :]], dim=1)


class Worth(nn.Module):
    """Value of a row from the pooled part of the features of `Things`."""

    def __init__(self, pooled: int, width: int) -> None:
        super().__init__()
        self._pooled = pooled
        self.net = layers(pooled, width, 1)

    def forward(self, features: Tensor) -> Tensor:
        """Values (n, 1)."""
        return self.net(features[:, : self._pooled])


class SetChoicePolicy(MaskableActorCriticPolicy):
    """SB3's masked actor and critic with these networks.

    Args:
        choices: the actions; each listed thing has choices of its own (`Choices.first`, `apiece`).
        layout, width: see `Things`.
    """

    def __init__(
        self, *args: Any, choices: Choices, layout: Layout, width: int, **kwargs: Any
    ) -> None:
        self._choices, self._width = choices, width
        super().__init__(
            *args,
            **kwargs
            | {
                "net_arch": [],
                "features_extractor_class": Things,
                "features_extractor_kwargs": {"layout": layout, "width": width},
                "share_features_extractor": False,
            },
        )

    def _build(self, lr_schedule: Any) -> None:
        super()._build(lr_schedule)
        things: Any = self.features_extractor
        self.action_net = Head(things.pooled, things.each, self._width, self._choices)
        self.value_net = Worth(things.pooled, self._width)
        last: Any = self.action_net.others[-1]
        with torch.no_grad():  # begin with nearly equal chances
            self.action_net.apiece.weight.mul_(0.1)
            last.weight.mul_(0.1)
        make: Any = self.optimizer_class
        self.optimizer = make(self.parameters(), lr=lr_schedule(1), **self.optimizer_kwargs)
