"""Generative adversarial imitation learning (Ho & Ermon 2016), with PPO.
A discriminator learns to tell the policy's transitions from the demonstrations'; the policy is rewarded for those that
it takes for demonstrated."""

from collections.abc import Callable
from typing import Any

import numpy as np
import torch
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.vec_env import DummyVecEnv, VecEnvWrapper
from torch import nn
from torch.nn import functional

from policies.runs.training import Training

WIDTH, RATE, BATCH = 64, 3e-4, 128
"""Of the discriminator: width of a layer, learning rate, pairs from each side in a batch."""


class DiscriminatorReward(VecEnvWrapper):
    """Replaces the reward by -log(1 - D) of observation and action, and stores these pairs for the discriminator.
    standardise: maps pairs (n, features) to those that the discriminator takes."""

    def __init__(self, venv: Any, discriminator: nn.Module, standardise: Callable[[np.ndarray], torch.Tensor]) -> None:
        super().__init__(venv)
        self._discriminator, self._standardise = discriminator, standardise
        self.recent: list[torch.Tensor] = []
        """Pairs of the policy since the discriminator's last update."""
        self._observations: Any = None
        self._actions: Any = None

    def reset(self) -> Any:
        """Reset the environments; returns their observations."""
        self._observations = self.venv.reset()
        return self._observations

    def step_async(self, actions: np.ndarray) -> None:
        """Set the actions of the next step."""
        self._actions = actions
        self.venv.step_async(actions)

    def step_wait(self) -> Any:
        """Step the environments; returns the discriminator's rewards."""
        pairs = self._standardise(np.concatenate([self._observations, self._actions], 1))
        self.recent.append(pairs)
        observations, _, dones, infos = self.venv.step_wait()
        self._observations = observations
        with torch.no_grad():
            rewards = functional.softplus(self._discriminator(pairs)).numpy()[:, 0]
        return observations, rewards, dones, infos


class DiscriminatorTraining(BaseCallback):
    """Updates the discriminator after every batch of the policy's transitions."""

    def __init__(self, venv: DiscriminatorReward, discriminator: nn.Module, demonstrated: torch.Tensor,
                 updates: int) -> None:
        super().__init__()
        self._venv, self._discriminator, self._demonstrated, self._updates = venv, discriminator, demonstrated, updates
        self._optimizer = torch.optim.Adam(discriminator.parameters(), RATE)

    def state(self) -> dict[str, Any]:
        """Return what the next updates depend on."""
        return {"discriminator": self._discriminator.state_dict(), "optimizer": self._optimizer.state_dict(),
                "recent": list(self._venv.recent)}

    def load(self, state: dict[str, Any]) -> None:
        """Restore a state."""
        self._discriminator.load_state_dict(state["discriminator"])
        self._optimizer.load_state_dict(state["optimizer"])
        self._venv.recent = list(state["recent"])

    def _on_step(self) -> bool:
        return True

    def _on_rollout_end(self) -> None:
        own, demonstrated = torch.cat(self._venv.recent), self._demonstrated
        self._venv.recent.clear()
        for _ in range(self._updates):
            pairs = torch.cat((own[torch.randint(len(own), (BATCH,))],
                               demonstrated[torch.randint(len(demonstrated), (BATCH,))]))
            logits = self._discriminator(pairs)[:, 0]
            labels = torch.cat((torch.zeros(BATCH), torch.ones(BATCH)))
            loss = functional.binary_cross_entropy_with_logits(logits, labels)
            self._optimizer.zero_grad()
            loss.backward()
            self._optimizer.step()


def imitate(training: Training) -> None:
    """Train policy and discriminator together until the run is over."""
    torch.manual_seed(training.seed)
    pairs = np.array([np.concatenate([step.observation, step.action])
                      for step in training.demonstration_transitions()], np.float32)
    mean, spread = pairs.mean(0), pairs.std(0, ddof=1)
    scale = np.where(spread > 1e-6, spread, 1.0)

    def standardise(pairs: np.ndarray) -> torch.Tensor:
        return torch.as_tensor((pairs - mean) / scale, dtype=torch.float32)

    discriminator = nn.Sequential(nn.Linear(pairs.shape[1], WIDTH), nn.Tanh(), nn.Linear(WIDTH, WIDTH), nn.Tanh(),
                                  nn.Linear(WIDTH, 1))
    venv = DiscriminatorReward(DummyVecEnv([lambda: training.agent_env]), discriminator, standardise)
    training.learn(venv, DiscriminatorTraining(venv, discriminator, standardise(pairs),
                                               training.preset.discriminator_updates))
