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


def start_seed(seed: int, episode: int) -> int:
    """Return the seed of an episode's start: it depends on the run's seed and the episode's number only, so that a
    resumed run has the same starts."""
    return int(np.random.SeedSequence([seed, episode]).generate_state(1)[0])


class EpisodeRecord:
    """What is known of a running episode, the run's `index`-th; its seconds begin now."""

    def __init__(self, index: int, start: int) -> None:
        self.index, self.start = index, start
        self.actions: list[np.ndarray] = []
        self.total, self.needed, self.seconds, self.simulating = 0.0, 0, 0.0, 0.0
        self._readings: dict[str, float] | None = None

    def add(self, action: Any, reward: float, info: dict[str, Any], simulating: float) -> None:
        """Add a decision; simulating: seconds that it took the environment."""
        self.actions.append(np.array(action))
        self.simulating += simulating
        self.total += float(reward)
        if info.get("readings") != self._readings:
            self._readings, self.needed = dict(info["readings"]), len(self.actions)

    def end(self, info: dict[str, Any], seconds: float, **more: float) -> Episode:
        """Return the episode, and give its last info "episode", as Gymnasium and Stable-Baselines3 name it."""
        row: dict[str, Any] = {"episode": self.index, "start": self.start, "return": self.total}
        if "tcs" in info:
            row |= {"tcs": info["tcs"], "is_success": info["is_success"], **info["readings"], "needed": self.needed}
        times = {"seconds": seconds, "simulating": self.simulating, **more}
        row |= {"decisions": len(self.actions), **{name: round(value, 3) for name, value in times.items()},
                "diverged": info.get("diverged", "")}
        info["episode"] = {"r": self.total, "l": len(self.actions), "t": seconds}
        return Episode(row, np.array(self.actions))


class Episodes(gymnasium.Wrapper):
    """Seeds and reports the episodes of a run.
    options: of every reset. on_end: called with every finished Episode, before the next one starts."""

    def __init__(self, env: gymnasium.Env, seed: int, options: dict[str, Any] | None,
                 on_end: Callable[[Episode], None]) -> None:
        super().__init__(env)
        self.seed, self.options, self.on_end = seed, options, on_end
        self.count = 0
        """Finished episodes."""
        self.updating = 0.0
        """Seconds of updates since the last episode ended."""
        self._record, self._began = EpisodeRecord(0, 0), time.perf_counter()

    @property
    def is_resumable(self) -> bool:
        """Whether no episode is under way: a checkpoint has none."""
        return not self._record.actions

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Start the next episode; `seed` is ignored, the run's own seed applies."""
        self._record, self._began = EpisodeRecord(self.count, start_seed(self.seed, self.count)), time.perf_counter()
        return self.env.reset(seed=self._record.start, options=options or self.options)

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        """Step the environment; the last info has "episode"."""
        began = time.perf_counter()
        observation, reward, terminated, truncated, info = self.env.step(action)
        self._record.add(action, float(reward), info, time.perf_counter() - began)
        if terminated or truncated:
            episode = self._record.end(info, time.perf_counter() - self._began, updating=self.updating)
            self._record, self.updating = EpisodeRecord(0, 0), 0.0
            self.count += 1
            self.on_end(episode)
        return observation, reward, terminated, truncated, info
