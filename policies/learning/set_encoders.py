"""Encoders that see grains as a set: what they tell does not depend on the grains' order."""

from typing import Any

import gymnasium
import torch
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor
from torch import nn

WIDTH = 64


class _Sets(BaseFeaturesExtractor):
    """A network that is applied to every grain, a pool over them, and what is no grain beside it."""

    POOLS = 1

    def __init__(self, space: gymnasium.Space, slices: dict[str, slice], width: int = WIDTH) -> None:
        grains = slices["particles"]
        assert space.shape is not None
        rest = space.shape[0] - (grains.stop - grains.start)
        super().__init__(space, self.POOLS * width + rest)
        self._grains, self._tool = grains, slices["tool"]
        self._each = nn.Sequential(nn.Linear(6, width), nn.LayerNorm(width), nn.ReLU(), nn.Linear(width, width),
                                   nn.LayerNorm(width), nn.ReLU())

    def _parts(self, observations: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Grains (batch, n, 6), positions and velocities, and the rest (batch, m)."""
        grains = observations[:, self._grains].reshape(len(observations), -1, 6)
        return grains, torch.cat((observations[:, : self._grains.start], observations[:, self._grains.stop :]), 1)


class PointNet(_Sets):
    """The largest of every feature over all grains (Qi et al. 2017), in the world's axes."""

    def forward(self, observations: torch.Tensor) -> Any:
        """(batch, observation) to (batch, features)."""
        grains, rest = self._parts(observations)
        return torch.cat((self._each(grains).amax(1), rest), 1)


class DeepSets(_Sets):
    """Mean and largest of every feature (Zaheer et al. 2017), of positions relative to the tool: a
    largest value alone is blind to how many grains there are, which is what the reward counts."""

    POOLS = 2

    def forward(self, observations: torch.Tensor) -> Any:
        """(batch, observation) to (batch, features)."""
        grains, rest = self._parts(observations)
        place = observations[:, None, self._tool.start : self._tool.start + 3]
        features = self._each(torch.cat((grains[..., :3] - place, grains[..., 3:]), 2))
        return torch.cat((features.mean(1), features.amax(1), rest), 1)
