"""The Gymnasium environment that all eight sub-tasks share."""

import copy
import itertools
import math
from typing import Any, ClassVar, Literal, get_args

import gymnasium
import numpy as np

import mpm
from mpm.timestep import material_bound
from robosim.config import Grip
from robosim.envs.carrier import Carrier, KinematicTool
from robosim.envs.objective import objective
from robosim.envs.observation import Layout, Observer
from robosim.envs.reward import Reward
from robosim.envs.start import settled
from robosim.envs.task import TaskConfig, load_task
from robosim.envs.task_field import TOOL, build_solver, build_tally
from robosim.errors import ConfigError, RobotDiverged, UnknownName
from robosim.materials import law_of, load_material, overridden

Horizon = Literal["terminate", "truncate"]
CAMERAS = ("task", "side", "overview", "close")
AXES = ("x", "y", "z", "turn about x", "turn about y", "turn about z")


class GrainEnv(gymnasium.Env):
    """A tool and grains; see the classes of the sub-tasks."""

    metadata: dict[str, Any] = {"render_modes": ["rgb_array", "human"], "render_fps": 50}  # noqa: RUF012
    TASK: ClassVar[str] = ""
    """Name of the configuration below configs/tasks."""

    def __init__(
        self, render_mode: str | None = None, *, arm: bool = False, material: str | None = None,
        action_repeat: int = 10, obs: Layout = "flat", horizon: Horizon = "terminate", clip_actions: bool = False,
        randomize: dict[str, tuple[float, float]] | None = None, task: TaskConfig | str | None = None,
        camera: str = "task", grasp: Grip = "weld", **numbers: float,
    ) -> None:
        for what, given, valid in (("render_mode", render_mode, (None, *self.metadata["render_modes"])),
                                   ("horizon", horizon, get_args(Horizon)), ("obs", obs, get_args(Layout)),
                                   ("grasp", grasp, get_args(Grip))):
            if given not in valid:
                raise UnknownName(what, given, [name for name in valid if name])
        if render_mode is not None and camera not in CAMERAS:
            raise UnknownName("camera", camera, CAMERAS)
        if not isinstance(action_repeat, int | np.integer) or action_repeat < 1:
            raise ConfigError(f"action_repeat = {action_repeat!r}; accepted: a whole number from 1 on")
        self.task = load_task(task or self.TASK) if not isinstance(task, TaskConfig) else task
        self.render_mode, self.horizon, self.clip_actions = render_mode, horizon, clip_actions
        self.action_repeat, self.camera, self.arm = action_repeat, camera, arm
        rate = max(1, round(1.0 / (action_repeat * self.task.step_dt)))
        self.metadata = {**type(self).metadata, "render_fps": rate}
        self.material = overridden(load_material(material or self.task.material), numbers,
                                   "option, or number of this material,")
        self.randomize = self._ranges(randomize or {})
        mpm.init()
        self.solver = build_solver(self.task, law_of(self.material), mobile=arm)
        self.tally = build_tally(self.task, self.solver)
        if not self.tally.ranks and not arm:
            self.solver.attach(self.tally)
        self._state = settled(self.TASK or "task", self.task, self.material, self.solver)
        self.reward, self._observer = Reward(self.task), Observer(self.task, self.solver, obs)
        self.carrier = self._carrier(grasp)
        self.observation_space, self.observation_slices = self._observer.space, self._observer.slices
        n = self.task.action.dimensions
        self.action_space = gymnasium.spaces.Box(-1.0, 1.0, (n,), np.float32)
        self._scale = np.array([self.task.action.speed] * 3 + [self.task.action.angular_speed] * (n - 3))
        self._running, self.step_count = False, 0
        self.observation: Any = None
        """What `reset` or `step` returned last."""
        self._start, self._now = self.task.start.pose, self.tally.read()
        self._renderer = None

    def _ranges(self, randomize: dict[str, tuple[float, float]]) -> dict[str, tuple[float, float]]:
        """The ranges, checked: known numbers, and no pair that the time step cannot follow."""
        for name, given in randomize.items():
            low, high = given if np.ndim(given) == 1 and len(given) == 2 else (math.nan, math.nan)
            if not low <= high:
                raise ConfigError(f"randomize: {name} = {given!r}; accepted: (lowest, highest)")
        dt = self.task.field.dt
        for corner in itertools.product(*randomize.values()):
            numbers = dict(zip(randomize, corner))
            bound = material_bound(self.task.field.cell, law_of(overridden(self.material, numbers)))
            if dt is not None and dt > bound:
                raise ConfigError(f"randomize: {numbers} needs a time step of {bound:.3g} s; field.dt is {dt} s: take "
                                  f"a softer or a heavier material")
        return dict(randomize)

    def _carrier(self, grasp: Grip) -> Carrier:
        """What moves the tool."""
        if not self.arm:
            return KinematicTool(self.task, self.solver, self.tally)
        from robosim.envs.arm_tool import ArmTool  # without an arm nothing of it is loaded

        return ArmTool(self.task, self.solver, self.tally, grasp)

    # an episode -----------------------------------------------------------------------------------------------------
    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Start an episode. options: {"nominal": True} for the start without its random displacement."""
        super().reset(seed=seed)
        unknown = set(options or {}) - {"nominal"}
        if unknown:
            raise UnknownName("option of reset", sorted(unknown)[0], ["nominal"])
        nominal = bool((options or {}).get("nominal", False))
        if self.randomize:
            numbers = {name: float(self.np_random.uniform(*pair)) for name, pair in self.randomize.items()}
            self.solver.set_material(0, law_of(overridden(self.material, numbers)))
        self.solver.load(self._displaced(nominal))
        self._start = self.solver.collider_pose(TOOL)
        self.tally.restart()
        self.reward.restart()
        self._observer.restart()
        self._running, self.step_count = True, 0
        self._now = self.tally.read()
        self.observation = self._observer.read(self._now, 0.0)
        if self.render_mode == "human":
            self.render()
        return copy.deepcopy(self.observation), self._info({})

    def _displaced(self, nominal: bool) -> dict[str, np.ndarray]:
        """The settled state, with tool and grains moved within the ranges of the start."""
        start, action = self.task.start, self.task.action
        if nominal:
            return self._placed(start.pose, np.zeros(3))
        tool = self.np_random.uniform(-1.0, 1.0, 3) * start.spread
        pile = self.np_random.uniform(-1.0, 1.0, 3) * start.pile_spread
        place = np.clip(start.position + tool, action.lower, action.upper)
        return self._placed(mpm.Pose(place, start.pose.quaternion), pile)

    def _placed(self, tool: mpm.Pose, pile: np.ndarray) -> dict[str, np.ndarray]:
        """The settled state with the tool where the carrier holds it, asked for at a pose; grains in it go with it."""
        state, real = dict(self._state), self.carrier.restart(tool)
        if self.task.carried:
            local = self.task.start.pose.inverse().apply(state["x"] + self.solver.grid.origin)
            state["x"] = real.apply(local) - self.solver.grid.origin
        else:
            state["x"] = state["x"] + pile
        state["poses"] = state["poses"].copy()
        state["poses"][TOOL] = np.concatenate(real)
        return state

    def step(self, action: np.ndarray) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Hold an action for `action_repeat` steps of the simulation, or until the episode ends."""
        if not self._running:
            raise ConfigError("step: no episode is running; call reset first")
        velocity = self._checked(action) * self._scale
        linear, angular = velocity[:3], velocity[3:] if len(velocity) == 6 else np.zeros(3)
        sums = dict.fromkeys(self.reward.terms, 0.0)
        diverged = None
        steps = min(self.action_repeat, self.task.steps - self.step_count)
        try:
            for now in self.carrier.hold(linear, angular, steps):
                self._now = now
                self.step_count += 1
                last = self.step_count == self.task.steps
                for name, value in self.reward.step(self.tally, now, self.turned(), last).items():
                    sums[name] += value
        except (mpm.SimulationDiverged, RobotDiverged) as error:
            diverged = error
        over = self.step_count == self.task.steps
        self._running = not over and diverged is None
        if diverged is not None:
            for name, value in self.reward.give_up(self.task.steps - self.step_count).items():
                sums[name] += value
        info = self._info(sums)
        if diverged is not None:  # the last good observation is the last there is; a NaN is never traded for a reward
            info |= {"diverged": str(diverged), "is_success": False}
        else:
            self.observation = self._observer.read(self._now, self.step_count / self.task.steps)
        if self.render_mode == "human":
            self.render()
        ended = (over and self.horizon == "terminate") or diverged is not None
        return copy.deepcopy(self.observation), float(sum(sums.values())), ended, over and not ended, info

    def turned(self) -> float:
        """Angle [rad] by which the tool has turned about its lateral axis since the start of the episode."""
        R = self._start.matrix.T @ self.solver.collider_pose(TOOL).matrix
        return math.atan2(R[0, 2], R[0, 0])

    def _checked(self, action: np.ndarray) -> np.ndarray:
        """The action as numbers, or an error that names the component."""
        given = np.asarray(action)
        if given.shape != self.action_space.shape:
            raise ConfigError(f"action has shape {given.shape}; accepted: {self.action_space.shape}")
        if not np.issubdtype(given.dtype, np.floating):
            raise ConfigError(f"action has dtype {given.dtype}; accepted: floating-point numbers")
        bad = np.flatnonzero(~(np.abs(given) <= 1.0))
        if len(bad) and (not self.clip_actions or not np.all(np.isfinite(given))):
            raise ConfigError(f"action[{bad[0]}] ({AXES[bad[0]]}) = {given[bad[0]]}; accepted: -1 to 1 "
                              f"(clip_actions=True clips what is finite)")
        return np.clip(given.astype(float), -1.0, 1.0)

    def _info(self, terms: dict[str, float]) -> dict[str, Any]:
        """Terms of this step's reward, score so far, physical readings."""
        return {
            "reward_terms": dict(terms), "tcs": self.reward.tcs, "tcs_terms": dict(self.reward.score),
            "readings": self.reward.readings(self._now), "is_success": self.reward.succeeded(self._now),
            "time": self.step_count * self.task.step_dt,
        }

    # differentiating -------------------------------------------------------------------------------------------------
    def rollout(self, n_steps: int | None = None, **options: Any) -> mpm.Rollout:
        """Differentiable future from the present state over `n_steps` of `step_dt`, None: a whole episode; options as
        `mpm.Rollout` takes them. The tool is moved, not carried: raises mpm.InvalidValue with an arm."""
        steps = self.task.steps if n_steps is None else n_steps
        return mpm.Rollout(self.solver, steps, step_dt=self.task.step_dt, **options)

    def objective(self) -> Any:
        """The sub-task's reward as a loss for that."""
        return objective(self.task)

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
