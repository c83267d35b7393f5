"""The Gymnasium environment that all eight sub-tasks share."""

import copy
from typing import Any, get_args

import gymnasium
import numpy as np

import mpm
from robosim.config.robot import Grip
from robosim.envs import task_name
from robosim.envs.carrier import Carrier, KinematicTool
from robosim.envs.episode import Episode, Horizon, checked_horizon
from robosim.envs.handover import Load
from robosim.envs.world import World, checked_options
from robosim.errors import ConfigError, RobotDiverged, UnknownName
from robosim.tasks.actions import Actions, checked_repeat
from robosim.tasks.counting import TOOL
from robosim.tasks.objective import objective
from robosim.tasks.observation import Layout
from robosim.tasks.reward import Reward
from robosim.tasks.task import TaskConfig, load_task

CAMERAS = ("task", "side", "overview", "close")


class GrainEnv(gymnasium.Env):
    """A tool and grains; see the classes of the sub-tasks."""

    metadata: dict[str, Any] = {"render_modes": ["rgb_array", "human"], "render_fps": 50}  # noqa: RUF012
    TASK: str = ""
    """Name of the configuration below configs/tasks, or of the task's file without folder and ending."""

    def __init__(
        self, render_mode: str | None = None, *, arm: bool = False, material: str | None = None,
        action_repeat: int = 10, obs: Layout = "flat", horizon: Horizon = "terminate", clip_actions: bool = False,
        randomize: dict[str, tuple[float, float]] | None = None, task: TaskConfig | str | None = None,
        camera: str = "task", grasp: Grip = "weld", load: Load | None = None, **numbers: float,
    ) -> None:
        for what, given, valid in (("render_mode", render_mode, (None, *self.metadata["render_modes"])),
                                   ("grasp", grasp, get_args(Grip))):
            if given not in valid:
                raise UnknownName(what, given, [name for name in valid if name])
        if render_mode is not None and camera not in CAMERAS:
            raise UnknownName("camera", camera, CAMERAS)
        self.action_repeat = checked_repeat(action_repeat)
        checked_horizon(horizon)
        if not (task or self.TASK):
            raise ConfigError(f"task {task!r}; accepted: a task's .yaml file, or a TaskConfig")
        self.source = task if isinstance(task, str) else self.TASK
        """What commands call this task: a sub-task's name or a file; empty for a TaskConfig."""
        self.TASK = self.TASK or task_name(self.source)
        self.world = World(self.TASK or "task", task or self.TASK, material=material, obs=obs, numbers=numbers,
                           randomize=randomize, mobile=arm, load=load)
        self.task, self.material = self.world.task, self.world.material
        if type(self).TASK and task is not None:
            self._check_kind()
        self.solver, self.counter = self.world.solver, self.world.counter
        self.render_mode, self.camera, self.arm = render_mode, camera, arm
        rate = max(1, round(1.0 / (action_repeat * self.task.step_dt)))
        self.metadata = {**type(self).metadata, "render_fps": rate}
        self.episode = Episode(self.task, horizon)
        self.carrier = self._carrier(grasp)
        self.actions = Actions(self.task, clip=clip_actions)
        self.action_space, self.observation_space = self.actions.space, self.world.observer.space
        self.observation_slices = self.world.observer.slices
        self.observation: Any = None
        """What `reset` or `step` returned last."""
        self._renderer = None

    def _check_kind(self) -> None:
        """A registered sub-task stays what its name says, whatever numbers it is given."""
        own = load_task(self.TASK)
        given, wanted = (f"{task.kind} with the {task.tool}" for task in (self.task, own))
        if given != wanted:
            raise ConfigError(f"task: {given}; accepted for robosim/{self.TASK}-v0: {wanted}; any other as "
                              f"robosim.envs.GrainEnv(task=...)")

    @property
    def reward(self) -> Reward:
        """Of the running episode."""
        return self.episode.reward

    @property
    def step_count(self) -> int:
        """Steps of `step_dt` since the episode's start."""
        return self.episode.step_count

    def _carrier(self, grasp: Grip) -> Carrier:
        """What moves the tool."""
        if not self.arm:
            return KinematicTool(self.task, self.solver)
        from robosim.envs.arm_tool import ArmTool  # without an arm nothing of it is loaded

        return ArmTool(self.task, self.solver, grasp)

    # an episode -----------------------------------------------------------------------------------------------------
    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Start an episode. options: {"nominal": True} for the start without its random displacement."""
        super().reset(seed=seed)
        nominal, world = checked_options(options), self.world
        law = world.drawn_law(self.np_random)
        if law is not None:
            self.solver.set_material(0, law)
        tool, pile = world.drawn_start(self.np_random, nominal=nominal)
        self.solver.load(world.placed(self.carrier.restart(tool), pile))
        self.counter.restart()
        now, pose = self.counter.read(), self.solver.collider_pose(TOOL)
        info = self.episode.restart(pose, now)
        self.observation = world.observer.read(world.grains(), pose, now, 0.0)
        if self.render_mode == "human":
            self.render()
        return copy.deepcopy(self.observation), info

    def step(self, action: np.ndarray) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Hold an action for `action_repeat` steps of the simulation, or until the episode ends."""
        episode, world = self.episode, self.world
        steps = episode.steps(self.action_repeat)
        try:
            for reading, pose in self.carrier.hold(*self.actions.velocities(action), steps):
                episode.take(self.counter.translate(reading), pose)
        except (mpm.SimulationDiverged, RobotDiverged) as error:
            episode.give_up(error)
        else:  # after an error the last good observation is the last there is; a NaN is never traded for a reward
            grains = world.sample.values if world.sample is not None else world.grains()
            self.observation = world.observer.read(grains, episode.pose, episode.now, episode.progress)
        reward, ended, cut, info = episode.outcome()
        if self.carrier.strain:
            info["arm"] = dict(self.carrier.strain)
        if self.render_mode == "human":
            self.render()
        return copy.deepcopy(self.observation), reward, ended, cut, info

    # differentiating -------------------------------------------------------------------------------------------------
    def rollout(self, n_steps: int | None = None, **options: Any) -> mpm.Rollout:
        """Differentiable future from the present state over `n_steps` of `step_dt`, None: a whole episode; options as
        `mpm.Rollout` takes them. The tool is moved, not carried: raises mpm.InvalidValue with an arm."""
        steps = self.task.steps if n_steps is None else n_steps
        return mpm.Rollout(self.solver, steps, step_dt=self.task.step_dt, **options)

    def objective(self) -> Any:
        """The sub-task's reward as a loss for that."""
        return objective(self.task)

    def reach(self) -> Any:
        """What the arm would have to do to carry this task's tool: see `robosim.envs.reach.Reach`."""
        from robosim.envs.reach import Reach  # as above

        return Reach(self.task)

    # keeping and drawing --------------------------------------------------------------------------------------------
    def render(self) -> np.ndarray | None:  # pyright: ignore[reportIncompatibleMethodOverride]
        """The picture (height, width, 3), or None with "human", which shows it."""
        if self.render_mode is None:
            gymnasium.logger.warn("render: the environment was made without a render_mode")
            return None
        if self._renderer is None:
            from robosim.envs.picture import Picture  # nothing of it is loaded until somebody draws

            self._renderer = Picture(self.task, self.material, self.camera, arm=self.carrier.spec(),
                                     window=self.render_mode == "human")
        return self._renderer.draw(self.solver, self.carrier.robot)

    def close(self) -> None:
        """Free the renderer."""
        if self._renderer is not None:
            self._renderer.close()
            self._renderer = None
