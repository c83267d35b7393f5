"""The episode with the largest return so far, which an actor imitates.

Source of the idea: Oh et al. 2018, Self-Imitation Learning.
"""

from itertools import product
from typing import Any

import numpy as np
import torch

from policies.learners.buffers import map_parts


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
        """Take over the rows that were added."""
        for name, seen in self._seen.items():
            buffer = getattr(buffers, name)
            added = np.arange(seen, seen + (buffer.pos - seen) % buffer.buffer_size) % buffer.buffer_size
            for row, k in product(added.tolist(), range(buffer.n_envs)):
                rows = self._begun.setdefault((name, k), [])
                rows.append(row)
                if buffer.dones[row, k]:
                    total = float(buffer.rewards[rows, k].sum())
                    if total > self.best:
                        self.best = total
                        self._observations, self._actions = (
                            map_parts(lambda part: torch.as_tensor(part[rows, k].copy()), whole)  # noqa: B023
                            for whole in (buffer.observations, buffer.actions))
                    rows.clear()
            self._seen[name] = buffer.pos

    def distance(self, actor: Any) -> torch.Tensor:
        """Return the mean square of an actor's distance from the episode's actions; zero before there is one."""
        if self._actions is None:
            return torch.zeros(())
        return (actor(self._observations, deterministic=True) - self._actions).pow(2).mean()
