"""Residual policies: actions that correct a recorded motion (Silver et al. 2018)."""

from typing import Any

import gymnasium
import numpy as np
from torch import nn

import mpm

INITIAL_NOISE = 0.2
"""Standard deviation of a residual policy's actions before learning."""


class ResidualActionWrapper(gymnasium.ActionWrapper):
    """Adds an action, scaled by `share`, to a motion (decisions, dimensions), and clips the sum to -1 .. 1.

    Each decision costs `cost` x the mean square of its action: in states that the critics have not visited, the
    recorded motion is to be preferred.
    """

    def __init__(self, env: gymnasium.Env, motion: np.ndarray, share: float, cost: float = 0.0) -> None:
        super().__init__(env)
        self._motion, self._share, self._cost, self._decision = motion, share, cost, 0

    def reset(self, **options: Any) -> Any:
        """Reset the environment and restart the motion."""
        self._decision = 0
        return self.env.reset(**options)

    def step(self, action: np.ndarray) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        """Step with the corrected action; the reward is reduced by the cost."""
        observation, reward, terminated, truncated, info = super().step(action)
        return observation, float(reward) - self._cost * float(np.mean(np.square(action))), terminated, truncated, info

    def action(self, action: np.ndarray) -> np.ndarray:
        """Return the corrected action (dimensions,); the motion's last action is repeated after its end."""
        recorded = self._motion[min(self._decision, len(self._motion) - 1)]
        self._decision += 1
        return np.clip(recorded + self._share * action, -1.0, 1.0).astype(np.float32)


def zero_residual(model: Any, learner: str) -> None:
    """Initialise a policy to make no correction, with small noise.

    With the usual initialisation the first episodes would leave the motion that is to be corrected, and the critics
    would learn from these alone.

    Raises:
        mpm.InvalidValue: the learner's policy has no state-dependent standard deviation.
    """
    actor = getattr(model, "actor", None)
    if actor is None or not isinstance(getattr(actor, "log_std", None), nn.Linear):
        raise mpm.InvalidValue(f"residual with learner {learner}; accepted: SAC, TQC or CrossQ, without use_sde")
    for layer, value in ((actor.mu, 0.0), (actor.log_std, float(np.log(INITIAL_NOISE)))):
        nn.init.zeros_(layer.weight)
        nn.init.constant_(layer.bias, value)
