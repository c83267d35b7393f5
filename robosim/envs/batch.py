"""Environments of one process that step together, with one field and one launch for all; what each one remembers."""

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode

import mpm
from mpm.backend import check_owner
from mpm.observers.region_counter import MAX_READINGS
from robosim.base.errors import ConfigError, UnreachableWaypoint
from robosim.envs.carrier import ORIGIN, Carrier
from robosim.envs.episode import EnvOptions, Episode
from robosim.envs.start import DEFAULT_START, StartOptions, read_start
from robosim.envs.world import Memory, Setters, World, check_options
from robosim.randomization.draw import Draw, Setting
from robosim.senses.term import SenseScene, Sight
from robosim.tasks.actions import ActionScaling, DelayLine, Velocity, delay_steps
from robosim.tasks.counting import TOOL

ATTEMPTS = 16
"""Random starts that are drawn until an arm reaches one."""
Info = dict[str, Any]
BatchStep = tuple[list[Any], np.ndarray, np.ndarray, np.ndarray, list[Info], list[Info]]
"""Observations, rewards (n,), terminated (n,), truncated (n,), infos, and for each environment that ended
"final_obs" and "final_info"."""


class MemberField(NamedTuple):
    """The field of one environment."""

    setters: Setters
    load: Callable[[dict[str, np.ndarray]], tuple[mpm.Counts, mpm.Pose]]
    """Loads a state in which an episode starts, and returns its counts and the tool's pose."""
    grains: Callable[[], np.ndarray]
    """Returns position [m] and velocity [m/s] (n, 6) of the observed grains."""


class Member:
    """One environment of a world: its episode, what moves its tool, and what it keeps from step to step."""

    def __init__(self, world: World, options: EnvOptions, carrier: Carrier) -> None:
        self.world, self.carrier, self.episode = world, carrier, Episode(world.task, options.horizon)
        self.actions = ActionScaling(world.task, clip=options.clip_actions)
        delay = delay_steps(options.action_delay, world.task.step_dt)
        self.delay = DelayLine(delay, self.actions.rest)
        arm = {"robot": list(options.hardware)} if options.arm else {}
        self.identity = world.describe(action_delay=delay, arm=options.arm, grasp=options.grasp if arm else None,
                                       action_repeat=options.action_repeat, horizon=options.horizon,
                                       clip_actions=options.clip_actions, **arm)
        """All that a state depends on."""
        self.generator: np.random.Generator | None = None
        """None before the first episode."""
        self.seed: int | None = None
        self.observation: Any = None
        """The last one."""
        self._senses: Any = None

    @property
    def has_ended(self) -> bool:
        """Whether its last episode has ended."""
        return self.generator is not None and not self.episode.running

    def start(self, options: StartOptions, field: MemberField) -> Info:
        """Start an episode; return its info.

        Raises UnreachableWaypoint where an arm reaches none of ATTEMPTS random starts, or not one that is asked for.
        """
        world = self.world
        draw, setting, tool = self._restart_carrier(options)
        settled = world.settle(draw)
        world.set_numbers(draw, setting, field.setters)
        counts, pose = field.load(world.start_state(settled, draw, setting, tool))
        self.delay.restart()
        info = self.episode.restart(pose, counts, setting)
        sight = self.look(field.grains())
        self._senses = world.observer.begin(sight, draw.sensors, world.randomization.sensors(draw))
        return info | self._observe(sight) | {"draw": draw._asdict()}

    def _restart_carrier(self, options: StartOptions) -> tuple[Draw, Setting, mpm.Pose]:
        """Draw an episode that the carrier can begin, and begin it; return the tool's pose, too."""
        assert self.generator is not None
        for attempt in range(ATTEMPTS):
            draw = self.world.draw(self.generator, options)
            setting = self.world.setting(draw)
            try:
                return draw, setting, self.carrier.restart(self.world.tool_pose(draw), setting)
            except UnreachableWaypoint:
                if options.draw is not None or options.nominal or attempt == ATTEMPTS - 1:
                    raise
        raise AssertionError("unreachable")

    def end_action(self, grains: np.ndarray) -> tuple[float, bool, bool, Info]:
        """Observe, unless the simulation diverged; return the action's reward, terminated, truncated and info."""
        sensed = self._observe(self.look(grains)) if self.episode.diverged is None else {}
        reward, terminated, truncated, info = self.episode.end_action()
        return reward, terminated, truncated, info | sensed

    def look(self, grains: np.ndarray) -> Sight:
        """Return what the terms of the observation see now."""
        episode, carrier = self.episode, self.carrier
        qpos = None if carrier.robot_data is None else carrier.robot_data.qpos
        return Sight(episode.time, episode.progress, episode.pose, episode.counts, grains, carrier.received,
                     carrier.duration, carrier.setting, carrier.sensors, qpos)

    def _observe(self, sight: Sight) -> Info:
        """Take an observation; return the info's part of it."""
        self.observation = self.world.observer.read(sight, self._senses)
        return self.world.observer.read_info(sight, self._senses)

    def state(self) -> dict[str, Any]:
        """Return the state of the environment, whose field the solver holds now."""
        memory = Memory(self.generator, self.seed, self.observation, self._senses, self.delay.waiting)
        return self.world.save(self.identity, self.episode, self.carrier, memory)

    def load(self, state: dict[str, Any]) -> None:
        """Continue from a state; raises ConfigError, and changes nothing, for one that cannot be used."""
        memory = self.world.restore(state, self.identity, self.episode, self.carrier)
        self.generator, self.seed, self.observation, self._senses, self.delay.waiting = memory


class GrainBatch:
    """n environments that step together; each behaves as it would alone.

    The results are the same bit by bit after `mpm.init(fast_math=False)`, otherwise up to rounding, because the two
    kernels may sum in different orders. options: as of `GrainEnv`, which also has an arm and pictures. autoreset_mode:
    whether an environment that ended starts again in the same step, in the next one, or when `reset` says so.
    """

    metadata: dict[str, Any] = {}  # noqa: RUF012
    """Gymnasium's metadata; empty, as batches render nothing."""

    def __init__(self, name: str, n: int, *, autoreset_mode: AutoresetMode = AutoresetMode.SAME_STEP,
                 **options: Any) -> None:
        given = EnvOptions.read(options)
        self.autoreset_mode, self.action_repeat = autoreset_mode, given.action_repeat
        self.world = world = World(name, name, given)
        world.observer.build(SenseScene(world.task, world.material, world.solver))
        self.max_episode_steps = -(-world.task.steps // self.action_repeat)
        self.batch = mpm.Batch(world.solver, n, readings=min(self.action_repeat, MAX_READINGS))
        self.members = [Member(world, given, Carrier(world.task)) for _ in range(n)]
        self.episodes, self.actions = [member.episode for member in self.members], self.members[0].actions
        self.observation_space, self.action_space = world.observer.space, self.actions.space

    def reset(self, seeds: list[int | None], options: dict[str, Any] | None,
              mask: np.ndarray) -> tuple[list[Any], list[Info]]:
        """Start episodes in the environments of a mask (n,); infos of the others are empty.

        Raises ConfigError where the mask leaves out an environment that has no episode yet.
        """
        check_owner()
        start = read_start(options)
        check_mask(mask, [member.generator is not None for member in self.members])
        infos: list[Info] = [{} for _ in self.members]
        for e in map(int, np.flatnonzero(mask)):
            member = self.members[e]
            if seeds[e] is not None or member.generator is None:
                member.generator, member.seed = seeding.np_random(seeds[e])
            infos[e] = member.start(start, self._field(e))
        return [member.observation for member in self.members], infos

    def _field(self, e: int) -> MemberField:
        """Return the field of environment e."""
        batch = self.batch

        def load(state: dict[str, np.ndarray]) -> tuple[mpm.Counts, mpm.Pose]:
            counts = batch.load(e, state)
            assert counts is not None
            return counts, batch.collider_pose(e, TOOL)

        setters = Setters(partial(batch.set_material, e, 0), partial(batch.set_volume, e, 0),
                          partial(batch.set_friction, e), partial(batch.place, e))
        return MemberField(setters, load, partial(self._grains, e))

    def _grains(self, e: int) -> np.ndarray:
        """Return position [m] and velocity [m/s] (n, 6) of the observed grains of environment e."""
        return self.batch.sampled(e)[: len(self.world.observer.grains)]

    def state(self, e: int) -> dict[str, Any]:
        """Return the state of environment e, as `GrainEnv.state` does."""
        check_owner()
        self.batch.select(e)
        return self.members[e].state()

    def load(self, e: int, state: dict[str, Any]) -> None:
        """Continue environment e from a state of any environment with the same task and options.

        Raises ConfigError, and changes nothing, for another one, and with SAME_STEP for a state without a running
        episode.
        """
        check_owner()
        check_options(state, self.members[e].identity)
        check_running(state, self.autoreset_mode)
        self.members[e].load(state)
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
        starts = np.array([self.autoreset_mode is AutoresetMode.NEXT_STEP and one.has_ended for one in self.members])
        left = np.array([0 if now else episode.begin_action(self.action_repeat)
                         for episode, now in zip(self.episodes, starts)])
        for member in self.members:
            member.carrier.begin_action()
        while left.any():
            left -= self._advance(velocities, np.minimum(left, MAX_READINGS))
            left[[episode.diverged is not None for episode in self.episodes]] = 0
        rewards, terminated, truncated = np.zeros(n), np.zeros(n, bool), np.zeros(n, bool)
        infos: list[Info] = [{} for _ in range(n)]
        finals: list[Info] = [{} for _ in range(n)]
        for e, member in enumerate(self.members):
            if starts[e]:
                infos[e] = member.start(DEFAULT_START, self._field(e))
                continue
            rewards[e], terminated[e], truncated[e], infos[e] = member.end_action(self._grains(e))
            if not member.episode.running and self.autoreset_mode is AutoresetMode.SAME_STEP:
                finals[e] = {"final_obs": member.observation, "final_info": infos[e]}
                infos[e] = member.start(DEFAULT_START, self._field(e))
        return [member.observation for member in self.members], rewards, terminated, truncated, infos, finals

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

    def close(self) -> None:
        """Give the field to the next batch of an equal task; this one is of no more use."""
        self.world.observer.close()
        self.world.solver.close()


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
