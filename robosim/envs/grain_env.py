"""The Gymnasium environment that all sub-tasks and dosing tasks share."""

import copy
from typing import Any

import gymnasium
import numpy as np

import mpm
from mpm.backend import check_owner
from robosim.base.errors import ConfigError, RobotDiverged
from robosim.envs import task_name
from robosim.envs.carrier import Carrier
from robosim.envs.episode import RENDER_MODES, Copied, EnvOptions, check_open
from robosim.envs.member import Member
from robosim.envs.start import read_start
from robosim.envs.world import NO_GRAINS, World
from robosim.randomization.variants import placed
from robosim.rewards.reward import Reward
from robosim.senses.term import SenseScene
from robosim.tasks.counting import TOOL
from robosim.tasks.objective import build_objective
from robosim.tasks.task import TaskConfig, load_task


class GrainEnv(Copied, gymnasium.Env):
    """Environment with a tool, or the whole arm, and grains; base class of all sub-tasks, whose pages describe it.
    Arguments are those of `robosim.envs.episode.EnvOptions` and any number of the material."""

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
        if self.TASK and task is not None:  # a registered sub-task has its own tool and terms
            kinds = [f"{', '.join(one.reward)} with the {one.tool_name}" for one in (
                task if isinstance(task, TaskConfig) else load_task(task), load_task(self.TASK))]
            if kinds[0] != kinds[1]:
                raise ConfigError(f"task: {kinds[0]}; accepted for robosim/{self.TASK}-v0: {kinds[1]}; any other with "
                                  f"gymnasium.make('robosim/Task-v0', task=...)")
        self.TASK = self.TASK or task_name(self.source)
        self.world = World(self.TASK or "task", self.TASK, given)
        self.task, self.material = self.world.task, self.world.material
        self.action_repeat, self._hardware = int(given.action_repeat), given.hardware
        self.max_episode_steps = -(-self.task.steps // self.action_repeat)
        self.solver, self.counter = self.world.solver, self.world.counter
        self.render_mode, self.camera, self.arm = render_mode, given.camera, given.arm
        rate = max(1, round(1.0 / (self.action_repeat * self.task.step_dt)))
        self.metadata = {**type(self).metadata, "render_fps": rate}
        if given.arm:
            from robosim.envs.arm_tool import ArmTool  # imports the arm's modules

            self.carrier = arm = ArmTool(self.task, self.solver, given.grasp, *self._hardware,
                                         has_sensors=self.world.observer.reads_arm)
        else:
            self.carrier, arm = Carrier(self.task, self.solver), None
        self.world.observer.build(SenseScene(self.task, self.material, self.solver, arm))
        self.member = Member(self.world, given, self.carrier, self.world.own_field)
        self.episode, self.actions = self.member.episode, self.member.actions
        self.reward: Reward = self.episode.reward
        """Reward and score of the running episode."""
        self.action_space, self.observation_space = self.actions.space, self.world.observer.space
        self.observation_slices = self.world.observer.slices
        self._picture, self._window, self._is_closed = None, None, False

    @property
    def observation(self) -> Any:
        """The last observation of `reset` or `step`."""
        return self.member.observation

    @property
    def step_count(self) -> int:
        """Steps of `step_dt` since the episode's start."""
        return self.episode.step_count

    # episodes -------------------------------------------------------------------------------------------------------
    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Start an episode; return observation and info.
        options: {"nominal": True} for the start without its random displacement; "shift", a displacement [m] (3,) of
        the tool, and "turn_deg", a turn about the vertical through it, besides; {"draw": info["draw"]} of another reset
        repeats its episode. Raises UnknownName, ConfigError for others, ConfigError once it is closed."""
        check_owner()
        check_open("reset", self._is_closed)
        super().reset(seed=seed)
        start = read_start(options)
        self._share_generator()
        info = self.member.start(start)
        if self.render_mode == "human":
            self.render()
        return copy.deepcopy(self.observation), info

    def _share_generator(self) -> None:
        """Let episodes be drawn from Gymnasium's generator, which is made here if there is none."""
        self.member.generator, self.member.seed = self.np_random, self._np_random_seed

    def step(self, action: np.ndarray) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Apply an action for `action_repeat` steps, or until the episode ends.
        Returns observation, reward, terminated, truncated and info. Where the simulation diverges, the observation is
        the last finite one and info["diverged"] has the reason. Raises ConfigError for an action that cannot be used,
        where no episode is running, and once it is closed."""
        check_owner()
        check_open("step", self._is_closed)
        episode, member = self.episode, self.member
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
        """Return the state, for a bitwise identical continuation: arrays and plain values, which `pickle` accepts."""
        check_owner()
        check_open("state", self._is_closed)
        if self._np_random is not None:
            self._share_generator()
        return self.member.state()

    def load(self, state: dict[str, Any]) -> None:
        """Continue from a state of this environment, or of one with the same task and options.
        Raises ConfigError, and changes nothing, for a state of another task or of other options, and after `close`."""
        check_owner()
        check_open("load", self._is_closed)
        self.member.load(state)
        self._np_random, self._np_random_seed = self.member.generator, self.member.seed

    _all_states, _load_all = state, load

    # gradients ------------------------------------------------------------------------------------------------------
    def rollout(self, n_steps: int | None = None, **options: Any) -> mpm.Rollout:
        """Make a differentiable rollout from the current state; n_steps: of `step_dt`, None: a whole episode.
        options: as of `mpm.Rollout`. Raises mpm.InvalidValue with an arm, as the rollout prescribes the tool's motion.
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
        carrier = self.carrier
        if self._picture is None:
            from robosim.senses.pictures import TaskPicture  # opens an OpenGL context
            from robosim.senses.task_scene import build_task_spec

            self._window = Window() if self.render_mode == "human" else None
            spec = build_task_spec(self.task, carrier.build_spec())
            self._picture = TaskPicture(spec, self.task, self.material)
        qpos = None if carrier.robot_data is None else carrier.robot_data.qpos
        frame = self._picture.draw(self.camera, self.solver.positions(), carrier.setting.place,
                                   self.solver.collider_pose(TOOL), qpos)
        return frame if self._window is None else self._window.show(frame)

    def close(self) -> None:
        """Free the renderer; give the field to the next environment of an equal task. This one is of no more use."""
        self._is_closed = True
        for opened in (self._picture, self._window):
            if opened is not None:
                opened.close()
        self._picture = self._window = None
        self.world.observer.close()
        self.solver.close()


class Window:
    """A window that shows frames; raises ConfigError where pygame, an optional dependency, is missing."""

    def __init__(self) -> None:
        try:
            import pygame  # pyright: ignore[reportMissingImports]
        except ImportError as error:
            raise ConfigError('render_mode = "human" needs pygame: pip install ".[human]" in the checkout; without a '
                              'display use "rgb_array"') from error
        self._pygame = pygame
        self._screen = None

    def show(self, frame: np.ndarray) -> None:
        """Show a frame (height, width, 3)."""
        if self._screen is None:
            self._pygame.display.init()
            self._screen = self._pygame.display.set_mode((frame.shape[1], frame.shape[0]))
        self._pygame.event.pump()
        self._screen.blit(self._pygame.surfarray.make_surface(np.swapaxes(frame, 0, 1)), (0, 0))
        self._pygame.display.flip()

    def close(self) -> None:
        """Close the window."""
        if self._screen is not None:
            self._pygame.display.quit()
