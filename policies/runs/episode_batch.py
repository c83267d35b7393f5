"""Episodes of a run that are simulated together, in one field with one launch for all."""

import time
from collections.abc import Callable
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode

import mpm
from policies.learners.buffers import map_parts
from policies.learners.vec_env import SB3VecEnv, select_info
from policies.learners.wrappers import ScaledObservation
from policies.learning.environments import make_vector_environment
from policies.runs.episodes import Episode, EpisodeRecord, start_seed


class EpisodeBatch(SB3VecEnv):
    """Seeds and reports the episodes of a run in n environments, for Stable-Baselines3.

    An environment whose episode ends begins the run's next one in the same step. Episodes that end together are
    reported in the order of their environments.

    task, options: of the environments. single: one of them, alone, as the policy sees it: its observations may be
    scaled. reset_options: of every reset. on_end: called with every finished Episode. most: episodes of the run; what
    goes beyond is simulated, as all environments step together, but not reported."""

    is_resumable = True
    """At any decision: a checkpoint has the running episodes, too."""

    def __init__(self, task: str, n: int, single: gymnasium.Env, seed: int, reset_options: dict[str, Any] | None,
                 on_end: Callable[[Episode], None], most: int, **options: Any) -> None:
        vector = make_vector_environment(task, n, autoreset_mode=AutoresetMode.DISABLED, **options)
        self._scale: Callable[[Any], Any] = single.observation if isinstance(single, ScaledObservation) else \
            lambda observations: observations
        super().__init__(vector, AutoresetMode.DISABLED)
        self.observation_space = single.observation_space
        self.seed_of_run, self.reset_options, self.on_end, self.most = seed, reset_options, on_end, most
        self.count = 0
        """Finished episodes."""
        self.updating = 0.0
        """Seconds of updates since the last episodes ended."""
        self._next, self._records = 0, [EpisodeRecord(0, 0)] * n

    def reset(self) -> Any:
        """Start the run's next episodes, one in every environment; returns observations (n, ...)."""
        self._next = self.count
        return self._start(np.ones(self.num_envs, bool))

    def _start(self, mask: np.ndarray) -> Any:
        """Start the next episodes in the environments of a mask (n,); return the observations of all."""
        seeds: list[int | None] = [None] * self.num_envs
        for e in np.flatnonzero(mask):
            seeds[e] = start = start_seed(self.seed_of_run, self._next)
            self._records[e] = EpisodeRecord(self._next, start)
            self._next += 1
        observations, infos = self.vector.reset(seed=seeds,  # pyright: ignore[reportArgumentType]
                                                options={**(self.reset_options or {}), "reset_mask": mask})
        for e in np.flatnonzero(mask):
            self.reset_infos[e] = select_info(infos, int(e))
        self._began = time.perf_counter()
        return self._scale(observations)

    def step_wait(self) -> tuple[Any, np.ndarray, np.ndarray, list[dict[str, Any]]]:
        """Step; returns observations (n, ...), rewards (n,), dones (n,) and infos, as `SB3VecEnv` does."""
        began, n = time.perf_counter(), self.num_envs
        observations, rewards, terminated, truncated, infos = self.vector.step(self._actions)
        now = time.perf_counter()
        seen, dones = self._scale(observations), terminated | truncated
        rows = [select_info(infos, e) | {"TimeLimit.truncated": bool(truncated[e] and not terminated[e])}
                for e in range(n)]
        for record, action, reward, row in zip(self._records, self._actions, rewards, rows):
            record.add(action, reward, row, (now - began) / n)
            record.seconds += (now - self._began) / n
        self._began = now
        ended, seconds = np.flatnonzero(dones), self.updating / max(int(dones.sum()), 1)
        for e in ended:
            rows[e]["terminal_observation"] = map_parts(lambda part: np.array(part[e]), seen)  # noqa: B023
            episode = self._records[e].end(rows[e], self._records[e].seconds, updating=seconds)
            if self.count < self.most:
                self.count += 1
                self.on_end(episode)
        if len(ended):
            self.updating, seen = 0.0, self._start(dones)
        return seen, rewards.astype(np.float32), dones, rows

    def state(self) -> dict[str, Any]:
        """Return the state of all environments and of their episodes, for a bitwise identical continuation."""
        return {"environments": [self.vector.state(e) for e in range(self.num_envs)],  # pyright: ignore[reportAttributeAccessIssue]
                "records": [vars(record) | {"actions": list(record.actions)} for record in self._records],
                "next": self._next}

    def load(self, state: dict[str, Any]) -> None:
        """Continue from a state; raises mpm.InvalidValue for that of another number of environments."""
        stored = state["environments"]
        if len(stored) != self.num_envs:
            raise mpm.InvalidValue(f"checkpoint of {len(stored)} environments; accepted: {self.num_envs}")
        self.vector.reset(options=self.reset_options)
        for e, one in enumerate(stored):
            self.vector.load(e, one)  # pyright: ignore[reportAttributeAccessIssue]
            self._records[e] = EpisodeRecord(0, 0)
            vars(self._records[e]).update(state["records"][e])
        self._next, self._began = state["next"], time.perf_counter()
