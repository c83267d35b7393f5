"""Environments of one sub-task that take turns in one field: one launch, one kernel, one process."""

from typing import Any

import numpy as np
from gymnasium.utils import seeding

import mpm
from robosim.envs.carrier import Carrier
from robosim.envs.episode import Episode, Horizon, checked_horizon
from robosim.envs.world import Ranges, World, checked_options
from robosim.errors import ConfigError
from robosim.tasks.actions import Actions, checked_repeat
from robosim.tasks.counting import MAX_READINGS, TOOL
from robosim.tasks.observation import Layout
from robosim.tasks.task import TaskConfig

Info = dict[str, Any]


class GrainBatch:
    """n environments in step; what each does is what it would do alone: to the bit after `mpm.init(fast_math=False)`,
    else to rounding, which two kernels may do in another order. Options as of `GrainEnv`, which has the arm and
    pictures, too. One that ends begins anew in the same step (Gymnasium's SAME_STEP)."""

    def __init__(self, name: str, n: int, *, task: TaskConfig | str | None = None, material: str | None = None,
                 action_repeat: int = 10, obs: Layout = "flat", horizon: Horizon = "terminate",
                 clip_actions: bool = False, randomize: Ranges | None = None, **numbers: float) -> None:
        checked_horizon(horizon)
        self.world = World(name, task or name, material=material, obs=obs, numbers=numbers, randomize=randomize)
        self.action_repeat = checked_repeat(action_repeat)
        self.batch = mpm.Batch(self.world.solver, n, looks=min(action_repeat, MAX_READINGS))
        self.actions = Actions(self.world.task, clip=clip_actions)
        self.observation_space, self.action_space = self.world.observer.space, self.actions.space
        self.episodes = [Episode(self.world.task, horizon) for _ in range(n)]
        self._carriers = [Carrier(self.world.task) for _ in range(n)]
        self._rngs: list[np.random.Generator | None] = [None] * n
        self._seen: list[Any] = [None] * n

    def reset(self, seeds: list[int | None], options: dict[str, Any] | None,
              chosen: np.ndarray) -> tuple[list[Any], list[Info]]:
        """Start episodes in the chosen environments (n,), and say nothing of the others."""
        nominal = checked_options(options)
        if not all(begun or now for begun, now in zip((rng is not None for rng in self._rngs), chosen)):
            raise ConfigError("reset_mask leaves out environments that never began; reset all of them first")
        infos: list[Info] = [{} for _ in self.episodes]
        for e in np.flatnonzero(chosen):
            if seeds[e] is not None or self._rngs[e] is None:
                self._rngs[e] = seeding.np_random(seeds[e])[0]
            infos[e] = self._begin(int(e), nominal)
        return list(self._seen), infos

    def _begin(self, e: int, nominal: bool = False) -> Info:
        """Start an episode."""
        rng, world = self._rngs[e], self.world
        assert rng is not None
        law = world.drawn_law(rng)
        if law is not None:
            self.batch.set_material(e, 0, law)
        tool, pile = world.drawn_start(rng, nominal=nominal)
        reading = self.batch.load(e, world.placed(self._carriers[e].restart(tool), pile))
        assert reading is not None
        info = self.episodes[e].restart(self.batch.collider_pose(e, TOOL), world.counter.translate(reading))
        self._look(e)
        return info

    def _look(self, e: int) -> None:
        """Take an observation."""
        episode = self.episodes[e]
        self._seen[e] = self.world.observer.read(self.batch.seen(e)[: len(self.world.observer.chosen)], episode.pose,
                                                 episode.now, episode.progress)

    def step(self, actions: np.ndarray) -> tuple[list[Any], np.ndarray, np.ndarray, np.ndarray, list[Info], list[Info]]:
        """Observations, rewards (n,), ended (n,), cut (n,), infos, and of those that ended "final_obs" and
        "final_info"; the observation and info of such a one are those of its next start."""
        n = len(self.episodes)
        # all are checked before any is told to move
        velocities = [self.actions.velocities(action, f"action of environment {e}") for e, action in enumerate(actions)]
        left = np.array([episode.steps(self.action_repeat) for episode in self.episodes])
        while left.any():
            left -= self._advance(velocities, np.minimum(left, MAX_READINGS))
            left[[episode.diverged is not None for episode in self.episodes]] = 0
        rewards, ended, cut = np.zeros(n), np.zeros(n, bool), np.zeros(n, bool)
        infos: list[Info] = [{} for _ in range(n)]
        finals: list[Info] = [{} for _ in range(n)]
        for e, episode in enumerate(self.episodes):
            if episode.diverged is None:
                self._look(e)
            rewards[e], ended[e], cut[e], infos[e] = episode.outcome()
            if not episode.running:
                finals[e] = {"final_obs": self._seen[e], "final_info": infos[e]}
                infos[e] = self._begin(e)
        return list(self._seen), rewards, ended, cut, infos, finals

    def _advance(self, velocities: list[tuple[np.ndarray, np.ndarray]], steps: np.ndarray) -> np.ndarray:
        """Advance each environment by some steps (n,), none: it rests; returns them."""
        ways = [[carrier.command(*velocity) for _ in range(count)]
                for carrier, velocity, count in zip(self._carriers, velocities, steps)]
        for e, way in enumerate(ways):
            if way:
                self.batch.set_collider_motion(e, TOOL, self.batch.collider_pose(e, TOOL), *way)
        for episode, read, way in zip(self.episodes, self.batch.advance(steps * self.world.task.step_dt, steps), ways):
            if isinstance(read, mpm.SimulationDiverged):
                episode.give_up(read)
            else:
                for reading, pose in zip(read, way, strict=True):
                    episode.take(self.world.counter.translate(reading), pose)
        return steps
