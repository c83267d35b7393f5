"""Generative adversarial imitation (Ho & Ermon 2016): a discriminator learns to tell the policy's transitions from the
demonstrations', and what it takes for demonstrated is rewarded."""

from typing import Any

import numpy as np
import torch
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.vec_env import DummyVecEnv, VecEnvWrapper
from torch import nn
from torch.nn import functional

from policies.runs.training import Training

WIDTH, RATE, BATCH = 64, 3e-4, 128


class Imitated(VecEnvWrapper):
    """Rewards -log(1 - D) of what is seen and done instead of the environment's; keeps both for the discriminator."""

    def __init__(self, venv: Any, judge: nn.Module) -> None:
        super().__init__(venv)
        self._judge, self.recent = judge, []
        self._seen: Any = None
        self._done: Any = None

    def reset(self) -> Any:
        """The first observation."""
        self._seen = self.venv.reset()
        return self._seen

    def step_async(self, actions: np.ndarray) -> None:
        """Act."""
        self._done = actions
        self.venv.step_async(actions)

    def step_wait(self) -> Any:
        """As the environment answers, with the other reward."""
        pair = torch.as_tensor(np.concatenate([self._seen, self._done], 1), dtype=torch.float32)
        self.recent.append(pair)
        observations, _, dones, infos = self.venv.step_wait()
        self._seen = observations
        with torch.no_grad():
            rewards = functional.softplus(self._judge(pair)).numpy()[:, 0]
        return observations, rewards, dones, infos


class Discriminator(BaseCallback):
    """Learns after every batch of the policy's transitions."""

    def __init__(self, venv: Imitated, judge: nn.Module, demonstrated: torch.Tensor, updates: int) -> None:
        super().__init__()
        self._venv, self._judge, self._demonstrated, self._updates = venv, judge, demonstrated, updates
        self._optimizer = torch.optim.Adam(judge.parameters(), RATE)

    def state(self) -> dict[str, Any]:
        """What the next updates depend on."""
        return {"judge": self._judge.state_dict(), "optimizer": self._optimizer.state_dict(),
                "recent": list(self._venv.recent)}

    def load(self, state: dict[str, Any]) -> None:
        """Return to a state."""
        self._judge.load_state_dict(state["judge"])
        self._optimizer.load_state_dict(state["optimizer"])
        self._venv.recent = list(state["recent"])

    def _on_step(self) -> bool:
        return True

    def _on_rollout_end(self) -> None:
        own, shown = torch.cat(self._venv.recent), self._demonstrated
        self._venv.recent.clear()
        for _ in range(self._updates):
            pairs = torch.cat((own[torch.randint(len(own), (BATCH,))], shown[torch.randint(len(shown), (BATCH,))]))
            said = self._judge(pairs)[:, 0]
            truth = torch.cat((torch.zeros(BATCH), torch.ones(BATCH)))
            loss = functional.binary_cross_entropy_with_logits(said, truth)
            self._optimizer.zero_grad()
            loss.backward()
            self._optimizer.step()


def imitate(training: Training) -> None:
    """Run GAIL to its end."""
    torch.manual_seed(training.seed)
    pairs = np.array([np.concatenate([step.observation, step.action]) for step in training.demonstrated()], np.float32)
    shown = torch.as_tensor(pairs)
    judge = nn.Sequential(Standardised(shown), nn.Linear(pairs.shape[1], WIDTH), nn.Tanh(), nn.Linear(WIDTH, WIDTH),
                          nn.Tanh(), nn.Linear(WIDTH, 1))
    venv = Imitated(DummyVecEnv([lambda: training.acting]), judge)
    training.learn(venv, Discriminator(venv, judge, shown, training.preset.discriminator_updates))


class Standardised(nn.Module):
    """Inputs less the demonstrations' mean, over their spread; what never varied there is left as wide as it is."""

    mean: torch.Tensor
    scale: torch.Tensor

    def __init__(self, shown: torch.Tensor) -> None:
        super().__init__()
        spread = shown.std(0)
        self.register_buffer("mean", shown.mean(0))
        self.register_buffer("scale", torch.where(spread > 1e-6, spread, torch.ones_like(spread)))

    def forward(self, pairs: torch.Tensor) -> torch.Tensor:
        """(batch, n) to the same."""
        return (pairs - self.mean) / self.scale
