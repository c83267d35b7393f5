"""The episode with the largest return so far, which an actor imitates.

Source of the idea: Oh et al. 2018, Self-Imitation Learning.
"""

from typing import Any

import numpy as np
import torch


class BestEpisode:
    """Follows the two buffers of a `DemoReplayBuffer`, and keeps observations and actions of their best episode."""

    def __init__(self) -> None:
        self.best = -np.inf
        """Sum of its rewards."""
        self._observations: Any = None
        self._actions: torch.Tensor | None = None
        self._seen = {"demo": 0, "own": 0}
        """Rows of each buffer that were looked at; more than it holds where it has begun again at its first row."""
        self._begun: dict[tuple[str, int], list[int]] = {}
        """Buffer and environment -> rows of the episode that goes on."""

    def follow(self, buffers: Any) -> None:
        """Look at the rows that were added."""
        for name in self._seen:
            self._follow(name, getattr(buffers, name))

    def _follow(self, name: str, buffer: Any) -> None:
        size = buffer.buffer_size
        added = (buffer.pos - self._seen[name]) % size
        for row in range(self._seen[name], self._seen[name] + added):
            for k in range(buffer.n_envs):
                rows = self._begun.setdefault((name, k), [])
                rows.append(row % size)
                if buffer.dones[row % size, k]:
                    self._judge(buffer, rows, k)
                    rows.clear()
        self._seen[name] = buffer.pos

    def _judge(self, buffer: Any, rows: list[int], k: int) -> None:
        total = float(buffer.rewards[rows, k].sum())
        if total > self.best:
            self.best = total
            seen = buffer.observations
            self._observations = {key: torch.as_tensor(part[rows, k].copy()) for key, part in seen.items()} \
                if isinstance(seen, dict) else torch.as_tensor(seen[rows, k].copy())
            self._actions = torch.as_tensor(buffer.actions[rows, k].copy())

    def distance(self, actor: Any) -> torch.Tensor:
        """Return the mean square of an actor's distance from the episode's actions; zero before there is one."""
        if self._actions is None:
            return torch.zeros(())
        return (actor(self._observations, deterministic=True) - self._actions).pow(2).mean()
