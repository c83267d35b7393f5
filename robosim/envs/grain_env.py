"""The Gymnasium environment that all sub-tasks and dosing tasks share."""

import copy
from typing import Any

import gymnasium
import numpy as np

import mpm
from mpm.backend import check_owner
from robosim.base.errors import ConfigError, RobotDiverged
from robosim.config.arm import Grip
from robosim.envs import task_name
from robosim.envs.batch import Member, MemberField
from robosim.envs.carrier import Carrier, KinematicTool
from robosim.envs.episode import RENDER_MODES, EnvOptions, HasCopies, HasEpisodeLength, check_open
from robosim.envs.start import read_start
from robosim.envs.world import NO_GRAINS, World
from robosim.randomization.variants import placed
from robosim.rewards.reward import Reward
from robosim.senses.term import SenseScene
from robosim.tasks.counting import TOOL
from robosim.tasks.objective import build_objective
from robosim.tasks.task import TaskConfig, load_task


class GrainEnv(HasCopies, HasEpisodeLength, gymnasium.Env):
    """Environment with a tool, or the whole arm, and grains; base class of all sub-tasks.

    The pages of the sub-tasks describe spaces, rewards and arguments, which are those of
    `robosim.envs.episode.EnvOptions` and any number of the material. Raises UnknownName or ConfigError for arguments
    that are not accepted.
    """

    metadata: dict[str, Any] = {"render_modes": list(RENDER_MODES), "render_fps": 50}  # noqa: RUF012
    TASK: str = ""
    """Name of the task of configs/tasks, or of the task's file without folder and extension."""

    def __init__(self, render_mode: str | None = None, **options: Any) -> None:
        given = EnvOptions.read({"render_mode": render_mode, **options})
        task = given.task
        if not (task or self.TASK):
            raise ConfigError(f"task {task!r}; accepted: a task's .yaml file, or a TaskConfig")
        self.source = task if isinstance(task, str) else self.TASK
        """Name or file of the task, as commands accept it; empty for a TaskConfig."""
        if type(self).TASK and task is not None:
            self._check_kind(task if isinstance(task, TaskConfig) else load_task(task))
        self.TASK = self.TASK or task_name(self.source)
        self.world = World(self.TASK or "task", self.TASK, given)
        self.task, self.material = self.world.task, self.world.material
        self.action_repeat, self._hardware = int(given.action_repeat), given.hardware
        self.max_episode_steps = -(-self.task.steps // self.action_repeat)
        self.solver, self.counter = self.world.solver, self.world.counter
        self.render_mode, self.camera, self.arm = render_mode, given.camera, given.arm
        rate = max(1, round(1.0 / (self.action_repeat * self.task.step_dt)))
        self.metadata = {**type(self).metadata, "render_fps": rate}
        self.carrier = self._build_carrier(given.grasp)
        arm = self.carrier if given.arm else None
        self.world.observer.build(SenseScene(self.task, self.material, self.solver, arm))
        self._member = Member(self.world, given, self.carrier)
        self.episode, self.actions = self._member.episode, self._member.actions
        self.action_space, self.observation_space = self.actions.space, self.world.observer.space
        self.observation_slices = self.world.observer.slices
        self._renderer, self._is_closed = None, False

    def _check_kind(self, task: TaskConfig) -> None:
        """Raise ConfigError where a registered sub-task is given a task with another tool or other terms."""
        given, accepted = (f"{', '.join(one.reward)} with the {one.tool_name}"
                           for one in (task, load_task(self.TASK)))
        if given != accepted:
            raise ConfigError(f"task: {given}; accepted for robosim/{self.TASK}-v0: {accepted}; any other with "
                              f"gymnasium.make('robosim/Task-v0', task=...)")

    @property
    def observation(self) -> Any:
        """The last observation of `reset` or `step`."""
        return self._member.observation

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

        return ArmTool(self.task, self.solver, grasp, *self._hardware, has_sensors=self.world.observer.reads_arm)

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
        start = read_start(options)
        self._share_generator()
        info = self._member.start(start, MemberField(self.world.own_setters, self._load_start, self.world.grains))
        if self.render_mode == "human":
            self.render()
        return copy.deepcopy(self.observation), info

    def _load_start(self, state: dict[str, np.ndarray]) -> tuple[mpm.Counts, mpm.Pose]:
        """Load a state in which an episode starts; return its counts and the tool's pose."""
        self.solver.load(state)
        self.counter.restart()
        return self.counter.read(), self.solver.collider_pose(TOOL)

    def _share_generator(self) -> None:
        """Let episodes be drawn from Gymnasium's generator, which is made here if there is none."""
        self._member.generator, self._member.seed = self.np_random, self._np_random_seed

    def step(self, action: np.ndarray) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Apply an action for `action_repeat` steps, or until the episode ends.

        Returns observation, reward, terminated, truncated and info. Where the simulation diverges, the observation is
        the last finite one and info["diverged"] has the reason.
        Raises ConfigError for an action that cannot be used, where no episode is running, and once it is closed.
        """
        check_owner()
        check_open("step", self._is_closed)
        episode, member = self.episode, self._member
        velocity = self.actions.velocities(action)
        steps = episode.begin_action(self.action_repeat)
        self.carrier.begin_action()
        try:
            for *now, count in member.delay.push(velocity, steps):
                for reading, pose in self.carrier.advance(now, count):
                    episode.add_step(reading, pose)
        except (mpm.SimulationDiverged, RobotDiverged) as error:
            episode.diverge(error)
        sample = self.world.sample
        reward, terminated, truncated, info = member.end_action(NO_GRAINS if sample is None else sample.values)
        if self.carrier.arm_readings:
            info["arm"] = dict(self.carrier.arm_readings)
        if self.render_mode == "human":
            self.render()
        return copy.deepcopy(self.observation), reward, terminated, truncated, info

    # states ---------------------------------------------------------------------------------------------------------
    def state(self) -> dict[str, Any]:
        """Return the state, for a bitwise identical continuation: arrays and plain values, which `pickle` accepts.

        Raises ConfigError after `close`.
        """
        check_owner()
        check_open("state", self._is_closed)
        if self._np_random is not None:
            self._share_generator()
        return self._member.state()

    def load(self, state: dict[str, Any]) -> None:
        """Continue from a state of this environment, or of one with the same task and options.

        Raises ConfigError, and changes nothing, for a state of another task or of other options, and after `close`.
        """
        check_owner()
        check_open("load", self._is_closed)
        self._member.load(state)
        self._np_random, self._np_random_seed = self._member.generator, self._member.seed

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

        return Reach(self.task, *self._hardware)

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
