"""Environments of one process that step together: with one field and one launch for all, or with one for each."""

from collections.abc import Sequence
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
from robosim.config.tool import ToolConfig
from robosim.envs.carrier import ORIGIN, Carrier
from robosim.envs.episode import Episode, Horizon, check_horizon
from robosim.envs.start import DEFAULT_START, StartOptions, read_start
from robosim.envs.world import Memory, Setters, World, check_options
from robosim.randomization.ranges import Ranges
from robosim.senses.perception import PerceptionOptions, Terms
from robosim.senses.senses import TermOptions
from robosim.senses.term import SenseScene, Sight
from robosim.tasks.actions import ActionScaling, DelayLine, Velocity, check_action_repeat, delay_steps
from robosim.tasks.counting import TOOL
from robosim.tasks.task import TaskConfig

Info = dict[str, Any]
BatchStep = tuple[list[Any], np.ndarray, np.ndarray, np.ndarray, list[Info], list[Info]]
"""Observations, rewards (n,), terminated (n,), truncated (n,), infos, and for each environment that ended
"final_obs" and "final_info"."""


class GrainBatch:
    """n environments that step together; each behaves as it would alone.

    The results are the same bit by bit after `mpm.init(fast_math=False)`, otherwise up to rounding, because the two
    kernels may sum in different orders. Options as of `GrainEnv`, which also has an arm and pictures. autoreset_mode:
    whether an environment that ended starts again in the same step, in the next one, or when `reset` says so.
    """

    metadata: dict[str, Any] = {}  # noqa: RUF012
    """Of pictures, which it has none of."""

    def __init__(self, name: str, n: int, *, task: TaskConfig | str | None = None, material: str | None = None,
                 action_repeat: int = 10, obs: Terms | None = None, flatten: bool = False, latency: float = 0.0,
                 noise: float = 0.0, dropout: float = 0.0, action_delay: float = 0.0,
                 privileged: Sequence[TermOptions] = (), horizon: Horizon = "terminate", clip_actions: bool = False,
                 randomize: str | Ranges | None = None,
                 autoreset_mode: AutoresetMode = AutoresetMode.SAME_STEP, tool: str | ToolConfig | None = None,
                 **numbers: float) -> None:
        check_horizon(horizon)
        self.autoreset_mode = autoreset_mode
        perception = PerceptionOptions(obs, flatten, privileged, latency, noise, dropout)
        self.world = World(name, task or name, material=material, perception=perception, numbers=numbers,
                           randomize=randomize, tool=tool)
        self.world.observer.build(SenseScene(self.world.task, self.world.material, self.world.solver))
        self.action_repeat = check_action_repeat(action_repeat)
        self.max_episode_steps = -(-self.world.task.steps // self.action_repeat)
        self.batch = mpm.Batch(self.world.solver, n, readings=min(action_repeat, MAX_READINGS))
        self.actions = ActionScaling(self.world.task, clip=clip_actions)
        self.observation_space, self.action_space = self.world.observer.space, self.actions.space
        self.episodes = [Episode(self.world.task, horizon) for _ in range(n)]
        self._carriers = [Carrier(self.world.task) for _ in range(n)]
        self._rngs: list[np.random.Generator | None] = [None] * n
        self._seeds: list[int | None] = [None] * n
        self._observations: list[Any] = [None] * n
        self._senses: list[Any] = [None] * n
        delay = delay_steps(action_delay, self.world.task.step_dt)
        self._delays = [DelayLine(delay, self.actions.rest) for _ in range(n)]
        self._options = self.world.describe(action_delay=delay, arm=False, grasp=None, horizon=horizon,
                                            action_repeat=self.action_repeat, clip_actions=clip_actions)

    def reset(self, seeds: list[int | None], options: dict[str, Any] | None,
              mask: np.ndarray) -> tuple[list[Any], list[Info]]:
        """Start episodes in the environments of a mask (n,); infos of the others are empty.

        Raises ConfigError where the mask leaves out an environment that has no episode yet.
        """
        check_owner()
        start = read_start(options)
        check_mask(mask, [rng is not None for rng in self._rngs])
        infos: list[Info] = [{} for _ in self.episodes]
        for e in np.flatnonzero(mask):
            if seeds[e] is not None or self._rngs[e] is None:
                self._rngs[e], self._seeds[e] = seeding.np_random(seeds[e])
            infos[e] = self._start(int(e), start)
        return list(self._observations), infos

    def _start(self, e: int, options: StartOptions = DEFAULT_START) -> Info:
        """Start an episode of environment e."""
        rng, world = self._rngs[e], self.world
        assert rng is not None
        draw = world.draw(rng, options)
        setting, settled = world.setting(draw), world.settle(draw)
        batch = self.batch
        world.set_numbers(draw, setting, Setters(partial(batch.set_material, e, 0), partial(batch.set_volume, e, 0),
                                                 partial(batch.set_friction, e), partial(batch.place, e)))
        tool = self._carriers[e].restart(world.tool_pose(draw), setting)
        reading = self.batch.load(e, world.start_state(settled, draw, setting, tool))
        assert reading is not None
        self._delays[e].restart()
        info = self.episodes[e].restart(self.batch.collider_pose(e, TOOL), reading, setting)
        sight = self._look(e)
        self._senses[e] = world.observer.begin(sight, draw.sensors, world.randomization.sensors(draw))
        return info | self._observe(e, sight) | {"draw": draw._asdict()}

    def _look(self, e: int) -> Sight:
        """Return what the terms of the observation see in environment e."""
        episode, carrier, count = self.episodes[e], self._carriers[e], len(self.world.observer.grains)
        return Sight(episode.time, episode.progress, episode.pose, episode.counts, self.batch.sampled(e)[:count],
                     carrier.received, carrier.duration, carrier.setting)

    def _observe(self, e: int, sight: Sight) -> Info:
        """Take the observation of environment e; return the info's part of it."""
        self._observations[e] = self.world.observer.read(sight, self._senses[e])
        return self.world.observer.read_info(sight, self._senses[e])

    def state(self, e: int) -> dict[str, Any]:
        """Return the state of environment e, as `GrainEnv.state` does."""
        check_owner()
        self.batch.select(e)
        memory = Memory(self._rngs[e], self._seeds[e], self._observations[e], self._senses[e],
                        self._delays[e].waiting)
        return self.world.save(self._options, self.episodes[e], self._carriers[e], memory)

    def load(self, e: int, state: dict[str, Any]) -> None:
        """Continue environment e from a state of any environment with the same task and options.

        Raises ConfigError, and changes nothing, for another one, and with SAME_STEP for a state without a running
        episode.
        """
        check_owner()
        check_options(state, self._options)
        check_running(state, self.autoreset_mode)
        memory = self.world.restore(state, self._options, self.episodes[e], self._carriers[e])
        self._rngs[e], self._seeds[e], self._observations[e], self._senses[e], self._delays[e].waiting = memory
        self.batch.adopt(e)

    def step(self, actions: np.ndarray) -> BatchStep:
        """Apply actions (n, dimensions).

        SAME_STEP: observation and info of an environment that ended are those of its next start, the last ones are in
        the last of the results. NEXT_STEP: an environment that ended in the step before ignores its action and starts.
        Raises ConfigError for an action that cannot be used, and where no episode is running, before any environment
        moves.
        """
        check_owner()
        n = len(self.episodes)
        velocities = [self.actions.velocities(action, f"action of environment {e}") for e, action in enumerate(actions)]
        starts = np.array([self.autoreset_mode is AutoresetMode.NEXT_STEP and not episode.running and rng is not None
                           for episode, rng in zip(self.episodes, self._rngs)])
        left = np.array([0 if now else episode.begin_action(self.action_repeat)
                         for episode, now in zip(self.episodes, starts)])
        for carrier in self._carriers:
            carrier.begin_action()
        while left.any():
            left -= self._advance(velocities, np.minimum(left, MAX_READINGS))
            left[[episode.diverged is not None for episode in self.episodes]] = 0
        rewards, terminated, truncated = np.zeros(n), np.zeros(n, bool), np.zeros(n, bool)
        infos: list[Info] = [{} for _ in range(n)]
        finals: list[Info] = [{} for _ in range(n)]
        for e, episode in enumerate(self.episodes):
            if starts[e]:
                infos[e] = self._start(e)
                continue
            sensed: Info = {}
            if episode.diverged is None:
                sensed = self._observe(e, self._look(e))
            rewards[e], terminated[e], truncated[e], infos[e] = episode.end_action()
            infos[e] |= sensed
            if not episode.running and self.autoreset_mode is AutoresetMode.SAME_STEP:
                finals[e] = {"final_obs": self._observations[e], "final_info": infos[e]}
                infos[e] = self._start(e)
        return list(self._observations), rewards, terminated, truncated, infos, finals

    def _advance(self, velocities: list[Velocity], steps: np.ndarray) -> np.ndarray:
        """Advance each environment by its number of steps (n,), 0: not at all; return them."""
        paths = [[carrier.command(*now) for *now, lasts in line.push(velocity, int(count))
                  for _ in range(lasts)]
                 for carrier, line, velocity, count in zip(self._carriers, self._delays, velocities, steps)]
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
            self._carriers[e].receive(impulse, steps[e] * self.world.task.step_dt)
        return steps

    def close(self) -> None:
        """Give the field to the next batch of an equal task; this one is of no more use."""
        self.world.observer.close()
        self.world.solver.close()


class EnvBatch:
    """n environments, with an arm or pictures, that step one after another; each has a field and kernels of its own.

    Methods as of `GrainBatch`, options as of `GrainEnv`.
    """

    def __init__(self, name: str, n: int, *, autoreset_mode: AutoresetMode = AutoresetMode.SAME_STEP,
                 **options: Any) -> None:
        self.autoreset_mode = autoreset_mode
        self.envs: list[Any] = [gymnasium.make(f"robosim/{name}-v0", disable_env_checker=True, **options).unwrapped
                                for _ in range(n)]
        env = self.envs[0]
        self.metadata, self.actions, self.max_episode_steps = env.metadata, env.actions, env.max_episode_steps
        self.observation_space, self.action_space = env.observation_space, env.action_space

    def reset(self, seeds: list[int | None], options: dict[str, Any] | None,
              mask: np.ndarray) -> tuple[list[Any], list[Info]]:
        """Start episodes in the environments of a mask (n,); infos of the others are empty."""
        check_mask(mask, [env.observation is not None for env in self.envs])
        infos = [env.reset(seed=seed, options=options)[1] if now else {}
                 for env, seed, now in zip(self.envs, seeds, mask)]
        return [env.observation for env in self.envs], infos

    def state(self, e: int) -> dict[str, Any]:
        """Return the state of environment e."""
        return self.envs[e].state()

    def load(self, e: int, state: dict[str, Any]) -> None:
        """Continue environment e from a state of any environment with the same task and options."""
        check_running(state, self.autoreset_mode)
        self.envs[e].load(state)

    def step(self, actions: np.ndarray) -> BatchStep:
        """Apply actions (n, dimensions)."""
        n = len(self.envs)
        starts = [self.autoreset_mode is AutoresetMode.NEXT_STEP and env.observation is not None
                  and not env.episode.running for env in self.envs]
        for env, now in zip(self.envs, starts):
            if not now:  # raises here where no episode is running, before any environment moves
                env.episode.begin_action(env.action_repeat)
        rewards, terminated, truncated = np.zeros(n), np.zeros(n, bool), np.zeros(n, bool)
        infos: list[Info] = [{} for _ in range(n)]
        finals: list[Info] = [{} for _ in range(n)]
        for e, env in enumerate(self.envs):
            if starts[e]:
                infos[e] = env.reset()[1]
                continue
            observation, rewards[e], terminated[e], truncated[e], infos[e] = env.step(actions[e])
            if not env.episode.running and self.autoreset_mode is AutoresetMode.SAME_STEP:
                finals[e] = {"final_obs": observation, "final_info": infos[e]}
                infos[e] = env.reset()[1]
        return [env.observation for env in self.envs], rewards, terminated, truncated, infos, finals

    def call(self, name: str, arguments: tuple[Any, ...], options: dict[str, Any]) -> list[Any]:
        """Call a method of each environment with arguments; return the results, or the values of an attribute."""
        found = [getattr(env, name) for env in self.envs]
        return [one(*arguments, **options) if callable(one) else one for one in found]

    def set_attr(self, name: str, values: list[Any]) -> None:
        """Set an attribute of each environment."""
        for env, value in zip(self.envs, values):
            setattr(env, name, value)

    def close(self) -> None:
        """Close the environments; this batch is of no more use."""
        for env in self.envs:
            env.close()


def check_mask(mask: np.ndarray, begun: list[bool]) -> None:
    """Raise ConfigError where a mask (n,) of `reset` leaves out an environment that has no episode yet."""
    if not (mask | begun).all():
        raise ConfigError("reset_mask leaves out environments that never began; reset all of them first")


def check_running(state: Any, mode: AutoresetMode) -> None:
    """Raise ConfigError for a state without a running episode where none waits for a start."""
    episode = state.get("episode") if isinstance(state, dict) else None
    if mode is AutoresetMode.SAME_STEP and isinstance(episode, dict) and not episode.get("running"):
        raise ConfigError("load: the state's episode has ended or never began; accepted with autoreset_mode "
                          "SAME_STEP: one of a running episode")
