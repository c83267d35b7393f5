"""Networks beyond Stable-Baselines3's own: encoders of grains, and a delayed actor."""

from typing import Any

import gymnasium
import torch
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor
from torch import nn

WIDTH = 64
"""Features per grain."""


class DelayedActorMixin:
    """Mixed into an actor-critic of Stable-Baselines3: a delayed, slower actor.

    The actor makes its first update after `actor_waits` decisions, with a learning rate `actor_rate` x the critics'.
    An actor that starts from a good motion would otherwise follow critics that are still inaccurate."""

    actor_waits, actor_rate = 0, 1.0
    num_timesteps: int
    actor: Any

    def _update_learning_rate(self, optimizers: Any) -> None:
        """Set learning rates before an update, as Stable-Baselines3 calls it."""
        super()._update_learning_rate(optimizers)  # pyright: ignore[reportAttributeAccessIssue]
        for group in self.actor.optimizer.param_groups:
            group["lr"] *= self.actor_rate if self.num_timesteps >= self.actor_waits else 0.0


def embedding(size: int, width: int) -> nn.Sequential:
    """Return layers that embed `size` numbers, in units of their own, as `width` features."""
    return nn.Sequential(nn.Linear(size, width), nn.LayerNorm(width), nn.ReLU())


def cut_out(observations: torch.Tensor, part: slice) -> torch.Tensor:
    """Return observations (batch, n) without a part."""
    return torch.cat((observations[:, : part.start], observations[:, part.stop :]), 1)


class PartsEncoder(BaseFeaturesExtractor):
    """Embeds all grains in one layer and the rest of the observation in another, and joins them.

    slices: parts of the flat observation; "particles" holds the grains."""

    def __init__(self, space: gymnasium.Space, slices: dict[str, slice], width: int = WIDTH) -> None:
        assert space.shape is not None
        super().__init__(space, 2 * width)
        self._grains = slices["particles"]
        size = self._grains.stop - self._grains.start
        self._of_grains, self._of_rest = embedding(size, width), embedding(space.shape[0] - size, width)

    def forward(self, observations: torch.Tensor) -> Any:
        """Map (batch, observation) to (batch, features)."""
        rest = cut_out(observations, self._grains)
        return torch.cat((self._of_grains(observations[:, self._grains]), self._of_rest(rest)), 1)


class PointNet(BaseFeaturesExtractor):
    """A network applied to every grain, in world axes; the maximum of every feature, and the rest of the observation.

    Source: Qi et al. 2017. slices: parts of the flat observation; "particles" holds positions and velocities, 6 numbers
    a grain."""

    def __init__(self, space: gymnasium.Space, slices: dict[str, slice], width: int = WIDTH) -> None:
        grains = slices["particles"]
        assert space.shape is not None
        super().__init__(space, width + space.shape[0] - (grains.stop - grains.start))
        self._grains = grains
        self._each = nn.Sequential(*embedding(6, width), *embedding(width, width))

    def forward(self, observations: torch.Tensor) -> Any:
        """Map (batch, observation) to (batch, features)."""
        grains = observations[:, self._grains].reshape(len(observations), -1, 6)
        return torch.cat((self._each(grains).amax(1), cut_out(observations, self._grains)), 1)
