"""The Gymnasium environment that all sub-tasks and dosing tasks share."""

import copy
from collections.abc import Sequence
from typing import Any, get_args

import gymnasium
import numpy as np

import mpm
from mpm.backend import check_owner
from robosim.base.errors import ConfigError, RobotDiverged, UnknownName, UnreachableWaypoint
from robosim.config.arm import Grip
from robosim.config.tool import ToolConfig
from robosim.envs import task_name
from robosim.envs.carrier import Carrier, KinematicTool
from robosim.envs.episode import Episode, HasCopies, HasEpisodeLength, Horizon, check_horizon, check_open
from robosim.envs.start import StartOptions, read_start
from robosim.envs.world import NO_GRAINS, Memory, World
from robosim.randomization.draw import Draw, Setting
from robosim.randomization.ranges import Ranges
from robosim.randomization.variants import placed
from robosim.rewards.reward import Reward
from robosim.senses.perception import PerceptionOptions, Terms
from robosim.senses.senses import TermOptions
from robosim.senses.term import SenseScene, Sight
from robosim.tasks.actions import ActionScaling, DelayLine, check_action_repeat, delay_steps
from robosim.tasks.counting import TOOL
from robosim.tasks.handover import Load
from robosim.tasks.objective import build_objective
from robosim.tasks.task import TaskConfig, load_task

CAMERAS = ("task", "side", "overview", "close")
ATTEMPTS = 16
"""Random starts that are drawn until an arm reaches one."""


class GrainEnv(HasCopies, HasEpisodeLength, gymnasium.Env):
    """Environment with a tool, or the whole arm, and grains; base class of all sub-tasks.

    The pages of the sub-tasks describe spaces, rewards and arguments. Raises UnknownName or ConfigError for arguments
    that are not accepted.
    """

    metadata: dict[str, Any] = {"render_modes": ["rgb_array", "human"], "render_fps": 50}  # noqa: RUF012
    TASK: str = ""
    """Name of the task of configs/tasks, or of the task's file without folder and extension."""

    def __init__(
        self, render_mode: str | None = None, *, arm: bool = False, material: str | None = None,
        action_repeat: int = 10, obs: Terms | None = None, flatten: bool = False, latency: float = 0.0,
        noise: float = 0.0, dropout: float = 0.0, privileged: Sequence[TermOptions] = (), action_delay: float = 0.0,
        horizon: Horizon = "terminate", clip_actions: bool = False,
        randomize: str | Ranges | None = None, task: TaskConfig | str | None = None,
        camera: str = "task", grasp: Grip = "weld", load: Load | None = None,
        tool: str | ToolConfig | None = None, robot: str | None = None, gripper: str | None = None, **numbers: float,
    ) -> None:
        for option, value, valid in (("render_mode", render_mode, (None, *self.metadata["render_modes"])),
                                     ("grasp", grasp, get_args(Grip))):
            if value not in valid:
                raise UnknownName(option, value, [name for name in valid if name])
        if render_mode is not None and camera not in CAMERAS:
            raise UnknownName("camera", camera, CAMERAS)
        if not arm and (robot or gripper):
            raise ConfigError(f"robot = {robot!r}, gripper = {gripper!r} with arm = False; accepted: arm = True")
        self._robot = (robot or "iiwa14", gripper)
        """Arm and hand, by name or file; a hand of None is the arm's usual one."""
        self.action_repeat = check_action_repeat(action_repeat)
        check_horizon(horizon)
        if not (task or self.TASK):
            raise ConfigError(f"task {task!r}; accepted: a task's .yaml file, or a TaskConfig")
        self.source = task if isinstance(task, str) else self.TASK
        """Name or file of the task, as commands accept it; empty for a TaskConfig."""
        if type(self).TASK and task is not None:
            self._check_kind(task if isinstance(task, TaskConfig) else load_task(task))
        self.TASK = self.TASK or task_name(self.source)
        self.world = World(self.TASK or "task", task or self.TASK, material=material, numbers=numbers,
                           perception=PerceptionOptions(obs, flatten, privileged, latency, noise, dropout),
                           randomize=randomize, mobile=arm, load=load, tool=tool)
        self.task, self.material = self.world.task, self.world.material
        self.max_episode_steps = -(-self.task.steps // self.action_repeat)
        self.solver, self.counter = self.world.solver, self.world.counter
        self.render_mode, self.camera, self.arm = render_mode, camera, arm
        rate = max(1, round(1.0 / (action_repeat * self.task.step_dt)))
        self.metadata = {**type(self).metadata, "render_fps": rate}
        self.episode = Episode(self.task, horizon)
        self.carrier = self._build_carrier(grasp)
        self.world.observer.build(SenseScene(self.task, self.material, self.solver, self.carrier if arm else None))
        self.actions = ActionScaling(self.task, clip=clip_actions)
        self.action_space, self.observation_space = self.actions.space, self.world.observer.space
        self.observation_slices = self.world.observer.slices
        self.observation: Any = None
        """The last observation of `reset` or `step`."""
        self._senses: Any = None
        self._delay = DelayLine(delay_steps(action_delay, self.task.step_dt), self.actions.rest)
        self._options = self.world.describe(action_delay=self._delay.steps, arm=arm, grasp=grasp if arm else None,
                                            action_repeat=self.action_repeat, horizon=horizon,
                                            clip_actions=clip_actions,
                                            **({"robot": list(self._robot)} if arm else {}))
        self._renderer, self._is_closed = None, False

    def _check_kind(self, task: TaskConfig) -> None:
        """Raise ConfigError where a registered sub-task is given a task with another tool or other terms."""
        given, accepted = (f"{', '.join(one.reward)} with the {one.tool_name}"
                           for one in (task, load_task(self.TASK)))
        if given != accepted:
            raise ConfigError(f"task: {given}; accepted for robosim/{self.TASK}-v0: {accepted}; any other as "
                              f"robosim.envs.GrainEnv(task=...)")

    @property
    def reward(self) -> Reward:
        """Reward and score of the running episode."""
        return self.episode.reward

    @property
    def step_count(self) -> int:
        """Steps of `step_dt` since the episode's start."""
        return self.episode.step_count

    def _build_carrier(self, grasp: Grip) -> Carrier:
        """Build what moves the tool; the arm's modules are imported only with an arm."""
        if not self.arm:
            return KinematicTool(self.task, self.solver)
        from robosim.envs.arm_tool import ArmTool

        return ArmTool(self.task, self.solver, grasp, *self._robot, has_sensors=self.world.observer.reads_arm)

    # episodes -------------------------------------------------------------------------------------------------------
    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Start an episode; return observation and info.

        options: {"nominal": True} for the start without its random displacement; "shift", a displacement [m] (3,) of
        the tool, and "turn_deg", a turn about the vertical through it, besides; {"draw": info["draw"]} of another reset
        repeats its episode.
        Raises UnknownName for another option, ConfigError for one that cannot be used and once it is closed.
        """
        check_owner()
        check_open("reset", self._is_closed)
        super().reset(seed=seed)
        world, solver = self.world, self.solver
        draw, setting, tool = self._restart_carrier(read_start(options))
        settled = world.settle(draw)
        world.set_numbers(draw, setting, world.own_setters)
        solver.load(world.start_state(settled, draw, setting, tool))
        self.counter.restart()
        self._delay.restart()
        counts, pose = self.counter.read(), self.solver.collider_pose(TOOL)
        info = self.episode.restart(pose, counts, setting)
        sight = self._look(world.grains())
        self._senses = world.observer.begin(sight, draw.sensors, world.randomization.sensors(draw))
        info |= self._observe(sight) | {"draw": draw._asdict()}
        if self.render_mode == "human":
            self.render()
        return copy.deepcopy(self.observation), info

    def _restart_carrier(self, options: StartOptions) -> tuple[Draw, Setting, mpm.Pose]:
        """Draw an episode that the carrier can begin, and begin it; return the tool's pose, too.

        Raises UnreachableWaypoint where an arm reaches none of ATTEMPTS random starts, or not one that is asked for.
        """
        for attempt in range(ATTEMPTS):
            draw = self.world.draw(self.np_random, options)
            setting = self.world.setting(draw)
            try:
                return draw, setting, self.carrier.restart(self.world.tool_pose(draw), setting)
            except UnreachableWaypoint:
                if options.draw is not None or options.nominal or attempt == ATTEMPTS - 1:
                    raise
        raise AssertionError("unreachable")

    def step(self, action: np.ndarray) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Apply an action for `action_repeat` steps, or until the episode ends.

        Returns observation, reward, terminated, truncated and info. Where the simulation diverges, the observation is
        the last finite one and info["diverged"] has the reason.
        Raises ConfigError for an action that cannot be used, where no episode is running, and once it is closed.
        """
        check_owner()
        check_open("step", self._is_closed)
        episode, world = self.episode, self.world
        velocity = self.actions.velocities(action)
        steps = episode.begin_action(self.action_repeat)
        self.carrier.begin_action()
        try:
            for *now, count in self._delay.push(velocity, steps):
                for reading, pose in self.carrier.advance(now, count):
                    episode.add_step(reading, pose)
        except (mpm.SimulationDiverged, RobotDiverged) as error:
            episode.diverge(error)
            sensed = {}
        else:
            sensed = self._observe(self._look(NO_GRAINS if world.sample is None else world.sample.values))
        reward, terminated, truncated, info = episode.end_action()
        info |= sensed
        if self.carrier.arm_readings:
            info["arm"] = dict(self.carrier.arm_readings)
        if self.render_mode == "human":
            self.render()
        return copy.deepcopy(self.observation), reward, terminated, truncated, info

    def _look(self, grains: np.ndarray) -> Sight:
        """Return what the terms of the observation see now."""
        episode, carrier = self.episode, self.carrier
        return Sight(episode.time, episode.progress, episode.pose, episode.counts, grains, carrier.received,
                     carrier.duration, carrier.setting, carrier.sensors,
                     None if self.carrier.robot_data is None else self.carrier.robot_data.qpos)

    def _observe(self, sight: Sight) -> dict[str, Any]:
        """Take an observation; return the info's part of it."""
        observer = self.world.observer
        self.observation = observer.read(sight, self._senses)
        return observer.read_info(sight, self._senses)

    # states ---------------------------------------------------------------------------------------------------------
    def state(self) -> dict[str, Any]:
        """Return the state, for a bitwise identical continuation: arrays and plain values, which `pickle` accepts.

        Raises ConfigError after `close`.
        """
        check_owner()
        check_open("state", self._is_closed)
        memory = Memory(self._np_random, self._np_random_seed, self.observation, self._senses,
                        self._delay.waiting)
        return self.world.save(self._options, self.episode, self.carrier, memory)

    def load(self, state: dict[str, Any]) -> None:
        """Continue from a state of this environment, or of one with the same task and options.

        Raises ConfigError, and changes nothing, for a state of another task or of other options, and after `close`.
        """
        check_owner()
        check_open("load", self._is_closed)
        memory = self.world.restore(state, self._options, self.episode, self.carrier)
        self._np_random, self._np_random_seed, self.observation, self._senses, self._delay.waiting = memory

    def _travelling(self) -> tuple[Any, ...]:
        return self.state(), self._spec, self.action_space, self.observation_space

    def _arrive(self, state: tuple[Any, ...]) -> None:
        own, self._spec, self.action_space, self.observation_space = state
        self.load(own)

    # gradients ------------------------------------------------------------------------------------------------------
    def rollout(self, n_steps: int | None = None, **options: Any) -> mpm.Rollout:
        """Make a differentiable rollout from the current state.

        n_steps: of `step_dt`; None: a whole episode. options: as of `mpm.Rollout`.
        Raises mpm.InvalidValue with an arm, because the rollout prescribes the tool's motion.
        """
        check_open("rollout", self._is_closed)
        steps = self.task.steps if n_steps is None else n_steps
        return mpm.Rollout(self.solver, steps, step_dt=self.task.step_dt, **options)

    def objective(self) -> Any:
        """Make the loss of a rollout that corresponds to the reward of the sub-task."""
        return build_objective(placed(self.task, self.carrier.setting.place))

    def reach(self) -> Any:
        """Make the arm's kinematics with this task's tool, a `robosim.envs.reach.Reach`."""
        from robosim.envs.reach import Reach  # imports the arm's modules

        return Reach(self.task, *self._robot)

    # rendering ------------------------------------------------------------------------------------------------------
    def render(self) -> np.ndarray | None:  # pyright: ignore[reportIncompatibleMethodOverride]
        """Return a picture (height, width, 3), uint8, or show it in a window with render_mode="human"."""
        if self.render_mode is None:
            gymnasium.logger.warn("render: the environment was made without a render_mode")
            return None
        check_open("render", self._is_closed)
        if self._renderer is None:
            from robosim.envs.picture import Picture  # opens an OpenGL context

            self._renderer = Picture(self.task, self.material, self.camera, arm=self.carrier.build_spec(),
                                     window=self.render_mode == "human")
        return self._renderer.draw(self.solver, self.carrier.robot_data, self.carrier.setting.place)

    def close(self) -> None:
        """Free the renderer; give the field to the next environment of an equal task. This one is of no more use."""
        self._is_closed = True
        if self._renderer is not None:
            self._renderer.close()
            self._renderer = None
        self.world.observer.close()
        self.solver.close()
