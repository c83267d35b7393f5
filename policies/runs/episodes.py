"""Episodes of a run, whatever method makes them: their starts, their figures, their actions."""

import time
from collections.abc import Callable
from typing import Any, NamedTuple

import gymnasium
import numpy as np


class Episode(NamedTuple):
    """A finished episode."""

    row: dict[str, Any]
    """Its figures, as a row of episodes.csv. needed: decisions up to the last change of a reading."""
    actions: np.ndarray
    """(decisions, dimensions)"""

    @property
    def total(self) -> float:
        """Sum of the rewards."""
        return self.row["return"]


class Episodes(gymnasium.Wrapper):
    """Seeds and reports the episodes of a run.

    The start of episode k depends on the run's seed and k only, so that a resumed run has the same starts.

    options: of every reset. on_end: called with every finished Episode, before the next one starts.
    """

    def __init__(self, env: gymnasium.Env, seed: int, options: dict[str, Any] | None,
                 on_end: Callable[[Episode], None]) -> None:
        super().__init__(env)
        self.seed, self.options, self.on_end = seed, options, on_end
        self.count = 0
        """Finished episodes."""
        self._actions: list[np.ndarray] = []
        self._readings: dict[str, float] | None = None
        self._start = self._needed = 0
        self._total, self._simulating, self._began = 0.0, 0.0, time.perf_counter()

    @property
    def is_under_way(self) -> bool:
        """Whether an episode has made a decision and not ended."""
        return bool(self._actions)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Start the next episode; `seed` is ignored, the run's own seed applies."""
        self._actions, self._total, self._simulating, self._began = [], 0.0, 0.0, time.perf_counter()
        self._readings, self._needed = None, 0
        self._start = int(np.random.SeedSequence([self.seed, self.count]).generate_state(1)[0])
        return self.env.reset(seed=self._start, options=options or self.options)

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        """Step the environment; the last info has "episode", as Gymnasium and Stable-Baselines3 name it."""
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
