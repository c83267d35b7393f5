"""Episodes of a run, whatever learns in them: where each starts, what it came to, and the best of them."""

import time
from collections.abc import Callable
from typing import Any, NamedTuple

import gymnasium
import numpy as np


class Episode(NamedTuple):
    """What an episode came to."""

    row: dict[str, Any]
    """Numbers for a table. needed: decisions after which no reading changed any more."""
    actions: np.ndarray
    """(decisions, dimensions)"""

    @property
    def total(self) -> float:
        """Sum of the rewards."""
        return self.row["return"]


class Episodes(gymnasium.Wrapper):
    """Starts the k-th episode from numbers that depend on the run's seed and on k only, so that a run that is resumed
    sees the starts that it would have seen; reports every episode that ends.

    options are handed to every reset. on_end is called with every Episode, before the next one starts.
    """

    def __init__(self, env: gymnasium.Env, seed: int, options: dict[str, Any] | None,
                 on_end: Callable[[Episode], None]) -> None:
        super().__init__(env)
        self.seed, self.options, self.on_end, self.count = seed, options, on_end, 0
        """count: episodes that have ended"""
        self._actions: list[np.ndarray] = []
        self._readings: dict[str, float] | None = None
        self._start = self._needed = 0
        self._total, self._simulating, self._began = 0.0, 0.0, time.perf_counter()

    @property
    def under_way(self) -> bool:
        """Whether an episode has begun and not ended."""
        return bool(self._actions)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Start the episode that is due; a seed given here is not used, for the run's own rules."""
        self._actions, self._total, self._simulating, self._began = [], 0.0, 0.0, time.perf_counter()
        self._readings, self._needed = None, 0
        self._start = int(np.random.SeedSequence([self.seed, self.count]).generate_state(1)[0])
        return self.env.reset(seed=self._start, options=options or self.options)

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        """As the environment's; info["episode"] at the end, as gymnasium and stable_baselines3 name it."""
        began = time.perf_counter()
        observation, reward, terminated, truncated, info = self.env.step(action)
        self._simulating += time.perf_counter() - began
        self._actions.append(np.array(action))
        if info.get("readings") != self._readings:
            self._readings, self._needed = dict(info["readings"]), len(self._actions)
        self._total += float(reward)
        if terminated or truncated:
            self._end(info)
        return observation, reward, terminated, truncated, info

    def _end(self, info: dict[str, Any]) -> None:
        seconds = time.perf_counter() - self._began
        row: dict[str, Any] = {"episode": self.count, "start": self._start, "return": self._total}
        if "tcs" in info:
            row |= {"tcs": info["tcs"], "is_success": info["is_success"], **info["readings"], "needed": self._needed}
        row |= {"decisions": len(self._actions), "seconds": round(seconds, 3),
                "simulating": round(self._simulating, 3), "diverged": info.get("diverged", "")}
        info["episode"] = {"r": self._total, "l": len(self._actions), "t": seconds}
        self.count += 1
        actions, self._actions = np.array(self._actions), []
        self.on_end(Episode(row, actions))
