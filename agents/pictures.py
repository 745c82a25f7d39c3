"""A small network that reads pictures: three convolutions and one full layer."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import torch
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor
from torch import Tensor, nn


class PictureNetwork(BaseFeaturesExtractor):
    """Features of pictures with the channels first, in [0, 1], as SB3 hands them on.

    A tenth of the numbers of SB3's own: pictures are small, and so is what a policy weighs.

    Args:
        observation_space: of the pictures, (channels, rows, columns).
        width: of the full layer, and of the features.
    """

    def __init__(self, observation_space: gym.Space[Any], width: int) -> None:
        super().__init__(observation_space, width)
        shape: Any = observation_space.shape
        self.convolutions = nn.Sequential(
            nn.Conv2d(shape[0], 16, 5, 2),
            nn.ReLU(),
            nn.Conv2d(16, 32, 3, 2),
            nn.ReLU(),
            nn.Conv2d(32, 32, 3, 2),
            nn.ReLU(),
            nn.Flatten(),
        )
        with torch.no_grad():
            size = self.convolutions(torch.zeros(1, *shape)).shape[1]
        self.full = nn.Sequential(nn.Linear(size, width), nn.ReLU())

    def forward(self, observations: Tensor) -> Tensor:
        """Features (n, width) of pictures (n, channels, rows, columns)."""
        return self.full(self.convolutions(observations))
