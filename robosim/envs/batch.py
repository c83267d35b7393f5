"""Environments that step together: in one process with one field and one launch for all, or one after another."""

from functools import partial
from typing import Any

import gymnasium
import numpy as np
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode

import mpm
from mpm.backend import check_owner
from mpm.observers.region_counter import MAX_READINGS
from robosim.base.errors import ConfigError
from robosim.envs.carrier import ORIGIN, Carrier
from robosim.envs.episode import EnvOptions
from robosim.envs.member import Info, Member, check_options
from robosim.envs.start import read_start
from robosim.envs.world import FieldAccess, World
from robosim.senses.term import SenseScene
from robosim.tasks.actions import ActionScaling, Velocity
from robosim.tasks.counting import TOOL

BatchStep = tuple[list[Any], np.ndarray, np.ndarray, np.ndarray, list[Info], list[Info]]
"""Observations, rewards (n,), terminated (n,), truncated (n,), infos, and for each environment that ended
"final_obs" and "final_info"."""


class GrainBatch:
    """n environments that step together, with one field and one launch for all; each behaves as it would alone.
    The results are the same bit by bit after `mpm.init(fast_math=False)`, otherwise up to rounding, because the two
    kernels may sum in different orders. options: as of `GrainEnv`, which also has an arm and pictures. autoreset_mode:
    whether an environment that ended starts again in the same step, in the next one, or when `reset` says so."""

    metadata: dict[str, Any] = {}  # noqa: RUF012
    """Gymnasium's metadata; empty, as these batches render nothing."""

    def __init__(self, name: str, n: int, *, autoreset_mode: AutoresetMode = AutoresetMode.SAME_STEP,
                 **options: Any) -> None:
        self.autoreset_mode = autoreset_mode
        given = EnvOptions.read(options)
        self.action_repeat, self.world = given.action_repeat, World(name, name, given)
        world = self.world
        world.observer.build(SenseScene(world.task, world.material, world.solver))
        self.max_episode_steps = -(-world.task.steps // self.action_repeat)
        self.batch = mpm.Batch(world.solver, n, readings=min(self.action_repeat, MAX_READINGS))
        self.members: list[Member] = [Member(world, given, Carrier(world.task), self._field(e)) for e in range(n)]
        self.episodes, self.actions = [member.episode for member in self.members], self.members[0].actions
        self.observation_space: gymnasium.Space[Any] = world.observer.space

    def describe(self) -> tuple[gymnasium.Space[Any], ActionScaling, int, dict[str, Any]]:
        """Return observation space, action scaling, actions of an episode and metadata."""
        return self.observation_space, self.actions, self.max_episode_steps, self.metadata

    def _field(self, e: int) -> FieldAccess:
        batch = self.batch

        def load(state: dict[str, np.ndarray]) -> tuple[mpm.Counts, mpm.Pose]:
            counts = batch.load(e, state)
            assert counts is not None
            return counts, batch.collider_pose(e, TOOL)

        return FieldAccess(partial(batch.set_material, e, 0), partial(batch.set_volume, e, 0),
                           partial(batch.set_friction, e), partial(batch.place, e), load,
                           lambda: batch.sampled(e)[: len(self.world.observer.grains)])

    def reset(self, seeds: list[int | None], options: dict[str, Any] | None,
              mask: np.ndarray) -> tuple[list[Any], list[Info]]:
        """Start episodes in the environments of a mask (n,); infos of the others are empty.
        Raises ConfigError where the mask leaves out an environment that has no episode yet."""
        check_owner()
        if not (mask | [member.generator is not None for member in self.members]).all():
            raise ConfigError("reset_mask leaves out environments that never began; reset all of them first")
        infos = [self._start(e, seeds[e], options) if mask[e] else {} for e in range(len(self.members))]
        return [member.observation for member in self.members], infos

    def step(self, actions: np.ndarray) -> BatchStep:
        """Apply actions (n, dimensions).
        SAME_STEP: observation and info of an environment that ended are those of its next start, the last ones are in
        the last of the results. NEXT_STEP: an environment that ended in the step before ignores its action and starts.
        Raises ConfigError for an action that cannot be used, or without an episode, before any environment moves."""
        check_owner()
        n = len(self.members)
        starts = np.array([self.autoreset_mode is AutoresetMode.NEXT_STEP and one.has_ended for one in self.members])
        self._begin_step(actions, starts)
        rewards, terminated, truncated = np.zeros(n), np.zeros(n, bool), np.zeros(n, bool)
        infos: list[Info] = [{} for _ in range(n)]
        finals: list[Info] = [{} for _ in range(n)]
        for e, member in enumerate(self.members):
            if starts[e]:
                infos[e] = self._start(e)
                continue
            rewards[e], terminated[e], truncated[e], infos[e] = self._end_step(e, actions[e])
            if not member.episode.running and self.autoreset_mode is AutoresetMode.SAME_STEP:
                finals[e] = {"final_obs": member.observation, "final_info": infos[e]}
                infos[e] = self._start(e)
        return [member.observation for member in self.members], rewards, terminated, truncated, infos, finals

    def _start(self, e: int, seed: int | None = None, options: dict[str, Any] | None = None) -> Info:
        """Start an episode in environment e; return its info."""
        start, member = read_start(options), self.members[e]
        if seed is not None or member.generator is None:
            member.generator, member.seed = seeding.np_random(seed)
        return member.start(start)

    def _begin_step(self, actions: np.ndarray, starts: np.ndarray) -> None:
        """Carry out actions (n, dimensions) in all environments but those that start (n,).
        Raises ConfigError where no episode is running, before any environment moves."""
        velocities = [self.actions.velocities(action, f"action of environment {e}") for e, action in enumerate(actions)]
        left = np.array([0 if now else episode.begin_action(self.action_repeat)
                         for episode, now in zip(self.episodes, starts)])
        for member in self.members:
            member.carrier.begin_action()
        while left.any():
            left -= self._advance(velocities, np.minimum(left, MAX_READINGS))
            left[[episode.diverged is not None for episode in self.episodes]] = 0

    def _end_step(self, e: int, action: np.ndarray) -> tuple[float, bool, bool, Info]:
        """Return reward, terminated, truncated and info of environment e."""
        return self.members[e].end_action(self.members[e].field.grains())

    def _advance(self, velocities: list[Velocity], steps: np.ndarray) -> np.ndarray:
        """Advance each environment by its number of steps (n,), 0: not at all; return them."""
        paths = [[one.carrier.command(*now) for *now, lasts in one.delay.push(velocity, int(count))
                  for _ in range(lasts)] for one, velocity, count in zip(self.members, velocities, steps)]
        for e, path in enumerate(paths):
            if path:
                self.batch.set_collider_motion(e, TOOL, self.batch.collider_pose(e, TOOL), *path)
        outcomes = self.batch.advance(steps * self.world.task.step_dt, steps)
        for episode, outcome, path in zip(self.episodes, outcomes, paths):
            if isinstance(outcome, mpm.SimulationDiverged):
                episode.diverge(outcome)
            else:
                for reading, pose in zip(outcome, path, strict=True):
                    episode.add_step(reading, pose)
        for e in np.flatnonzero(steps):
            impulse = np.concatenate(self.batch.collider_impulse(int(e), TOOL, ORIGIN))
            self.members[e].carrier.receive(impulse, steps[e] * self.world.task.step_dt)
        return steps

    def check_running(self, state: Any) -> None:
        """Raise ConfigError for a state without a running episode where none waits for a start."""
        episode = state.get("episode") if isinstance(state, dict) else None
        if self.autoreset_mode is AutoresetMode.SAME_STEP and isinstance(episode, dict) and not episode.get("running"):
            raise ConfigError("load: the state's episode has ended or never began; accepted with autoreset_mode "
                              "SAME_STEP: one of a running episode")

    def state(self, e: int) -> dict[str, Any]:
        """Return the state of environment e, as `GrainEnv.state` does."""
        check_owner()
        self.batch.select(e)
        return self.members[e].state()

    def load(self, e: int, state: dict[str, Any]) -> None:
        """Continue environment e from a state of any environment with the same task and options.
        Raises ConfigError, and changes nothing, for others, and with SAME_STEP where no episode is running."""
        check_owner()
        check_options(state, self.members[e].identity)
        self.check_running(state)
        self.members[e].load(state)
        self.batch.adopt(e)

    def close(self) -> None:
        """Free fields and renderers; this batch is of no more use."""
        self.world.observer.close()
        self.world.solver.close()


class EnvBatch(GrainBatch):
    """Environments with an arm or pictures, one after another; each has a field and kernels of its own."""

    def __init__(self, name: str, n: int, *, autoreset_mode: AutoresetMode = AutoresetMode.SAME_STEP,
                 **options: Any) -> None:
        self.autoreset_mode = autoreset_mode
        self.envs: list[Any] = [gymnasium.make(f"robosim/{name}-v0", disable_env_checker=True, **options).unwrapped
                                for _ in range(n)]
        self.members, env = [env.member for env in self.envs], self.envs[0]
        self.metadata, self.actions, self.max_episode_steps = env.metadata, env.actions, env.max_episode_steps
        self.observation_space = env.observation_space

    def _start(self, e: int, seed: int | None = None, options: dict[str, Any] | None = None) -> Info:
        return self.envs[e].reset(seed=seed, options=options)[1]

    def _begin_step(self, actions: np.ndarray, starts: np.ndarray) -> None:
        for env, now in zip(self.envs, starts):
            if not now:
                env.episode.begin_action(env.action_repeat)

    def _end_step(self, e: int, action: np.ndarray) -> tuple[float, bool, bool, Info]:
        return self.envs[e].step(action)[1:]

    def state(self, e: int) -> dict[str, Any]:
        return self.envs[e].state()

    def load(self, e: int, state: dict[str, Any]) -> None:
        self.check_running(state)
        self.envs[e].load(state)

    def call(self, name: str, arguments: tuple[Any, ...], options: dict[str, Any]) -> list[Any]:
        """Call a method of each environment with arguments; return the results, or the values of an attribute."""
        found = [getattr(env, name) for env in self.envs]
        return [one(*arguments, **options) if callable(one) else one for one in found]

    def set_attr(self, name: str, values: list[Any]) -> None:
        """Set an attribute of each environment."""
        for env, value in zip(self.envs, values):
            setattr(env, name, value)

    def close(self) -> None:
        for env in self.envs:
            env.close()
