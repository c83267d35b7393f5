"""Actor-critics beyond Stable-Baselines3's own: normalised critics, a delayed actor."""

from typing import Any

from stable_baselines3.common.policies import ContinuousCritic
from stable_baselines3.sac.policies import SACPolicy
from torch import nn
from torch.nn import functional


class NormalisedReLU(nn.Module):
    """Layer normalisation without parameters, then max(0, x)."""

    def forward(self, x: Any) -> Any:
        """Map (..., features) to the same shape."""
        return functional.relu(functional.layer_norm(x, x.shape[-1:]))


class NormalisedCritic(SACPolicy):
    """SAC's policy with layer normalisation in its critics (Ball et al. 2023)."""

    def make_critic(self, features_extractor: Any = None) -> ContinuousCritic:
        """Make the critic as Stable-Baselines3 does, with another activation."""
        arguments = self._update_features_extractor(self.critic_kwargs, features_extractor)
        return ContinuousCritic(**{**arguments, "activation_fn": NormalisedReLU}).to(self.device)


class DelayedActorMixin:
    """Mixed into an actor-critic of Stable-Baselines3: a delayed, slower actor.

    The actor makes its first update after `actor_waits` decisions, with a learning rate `actor_rate` x the critics'.
    An actor that starts from a good motion would otherwise follow critics that are still inaccurate.
    """

    actor_waits, actor_rate = 0, 1.0
    num_timesteps: int
    actor: Any

    def _update_learning_rate(self, optimizers: Any) -> None:
        """Set learning rates before an update, as Stable-Baselines3 calls it."""
        super()._update_learning_rate(optimizers)  # pyright: ignore[reportAttributeAccessIssue]
        for group in self.actor.optimizer.param_groups:
            group["lr"] *= self.actor_rate if self.num_timesteps >= self.actor_waits else 0.0
