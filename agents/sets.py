"""A network that reads a list of things in any order (Zaheer et al. 2017, "Deep Sets").

Every thing, beside what the row tells once, goes through the same small network; what comes out is
pooled by maximum and by sum. Things that are not there, zeros in the row, count for nothing.
"""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import torch
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor
from torch import Tensor, nn

from visenvs.core.layout import Layout


class SetNetwork(BaseFeaturesExtractor):
    """Features of a row: what it tells once, and the pooled things that it lists.

    Args:
        observation_space: of the rows.
        layout: of the same rows; it says which columns belong to which thing.
        width: of the hidden layers, and of what is pooled.
    """

    def __init__(self, observation_space: gym.Space[Any], layout: Layout, width: int) -> None:
        once, listed = layout.members()
        super().__init__(observation_space, len(once) + 2 * width)
        self.encoder = nn.Sequential(
            nn.Linear(len(once) + listed.shape[1], width),
            nn.ReLU(),
            nn.Linear(width, width),
            nn.ReLU(),
        )
        self._once, self._listed = torch.from_numpy(once), torch.from_numpy(listed)

    def forward(self, observations: Tensor) -> Tensor:
        """Features (n, features_dim) of rows (n, size)."""
        once, things = observations[:, self._once], observations[:, self._listed]
        present = (things != 0).any(dim=2, keepdim=True)
        beside = once[:, None, :].expand(-1, things.shape[1], -1)
        found = self.encoder(torch.cat([beside, things], dim=2)) * present
        return torch.cat([once, found.amax(dim=1), found.sum(dim=1)], dim=1)
