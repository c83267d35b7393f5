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


class SetEncoder(BaseFeaturesExtractor):
    """A network applied to every grain, pooled over the grains, joined with the rest of the observation.

    slices: parts of the flat observation; "particles" holds positions and velocities, 6 numbers a grain."""

    POOLS = 1
    """Pooled values per feature."""

    def __init__(self, space: gymnasium.Space, slices: dict[str, slice], width: int = WIDTH) -> None:
        grains = slices["particles"]
        assert space.shape is not None
        rest = space.shape[0] - (grains.stop - grains.start)
        super().__init__(space, self.POOLS * width + rest)
        self._grains, self._tool = grains, slices["tool"]
        self._each = nn.Sequential(*embedding(6, width), *embedding(width, width))

    def _split(self, observations: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Return grains (batch, n, 6), positions and velocities, and the rest (batch, m)."""
        grains = observations[:, self._grains].reshape(len(observations), -1, 6)
        return grains, cut_out(observations, self._grains)


class PointNet(SetEncoder):
    """Maximum of every feature over the grains, in world axes (Qi et al. 2017)."""

    def forward(self, observations: torch.Tensor) -> Any:
        """Map (batch, observation) to (batch, features)."""
        grains, rest = self._split(observations)
        return torch.cat((self._each(grains).amax(1), rest), 1)


class DeepSets(SetEncoder):
    """Mean and maximum of every feature, with positions relative to the tool (Zaheer et al. 2017).

    A maximum alone does not depend on the number of grains, which is what the reward counts."""

    POOLS = 2

    def forward(self, observations: torch.Tensor) -> Any:
        """Map (batch, observation) to (batch, features)."""
        grains, rest = self._split(observations)
        tool_position = observations[:, None, self._tool.start : self._tool.start + 3]
        features = self._each(torch.cat((grains[..., :3] - tool_position, grains[..., 3:]), 2))
        return torch.cat((features.mean(1), features.amax(1), rest), 1)
