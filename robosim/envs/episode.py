"""A running episode: its reward, its clock, its tool's pose, and the info of a step; the options of environments."""

import copy
import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, Literal, get_args

import numpy as np

import mpm
from robosim.base.errors import ConfigError, UnknownName
from robosim.config.arm import Grip
from robosim.config.tool import ToolConfig
from robosim.randomization.ranges import HARD, HARD_DELAY, Ranges
from robosim.senses.perception import Terms
from robosim.senses.senses import TermOptions
from robosim.tasks.actions import check_action_repeat
from robosim.tasks.draw import STANDARD, Setting
from robosim.tasks.handover import Load
from robosim.tasks.outcome import build_outcome, build_reward
from robosim.tasks.task import TaskConfig

Horizon = Literal["terminate", "truncate"]
RENDER_MODES = ("rgb_array", "human")
CAMERAS = ("task", "side", "overview", "close")
NOTHING_COUNTED = mpm.Counts(0.0, 0, 0, 0, 0, 0, 0, 0, 0.0)


def read_pose(numbers: np.ndarray) -> mpm.Pose:
    """Return the pose of a position [m] and a quaternion in one array (7,)."""
    position, quaternion = np.split(np.array(numbers, float), [3])
    if quaternion.shape != (4,):
        raise ValueError(f"a pose has shape {np.shape(numbers)}; accepted: (7,)")
    return mpm.Pose(position, quaternion)


@dataclass(frozen=True, kw_only=True)
class EnvOptions:
    """Options of an environment of a sub-task, whose page describes them; raises UnknownName, ConfigError."""

    render_mode: str | None = None
    arm: bool = False
    material: str | None = None
    action_repeat: int = 10
    obs: Terms | None = None
    flatten: bool = False
    latency: float = 0.0
    noise: float = 0.0
    dropout: float = 0.0
    privileged: Sequence[TermOptions] = ()
    action_delay: float = 0.0
    horizon: Horizon = "terminate"
    clip_actions: bool = False
    randomize: str | Ranges | None = None
    task: TaskConfig | str | None = None
    camera: str = "task"
    grasp: Grip = "weld"
    load: Load | None = None
    tool: str | ToolConfig | None = None
    robot: str | None = None
    gripper: str | None = None
    numbers: dict[str, float] = dataclasses.field(default_factory=dict)
    """Of the material, in place of its own."""

    @classmethod
    def read(cls, given: dict[str, Any]) -> "EnvOptions":
        """Return the options of keyword arguments; those of another name are numbers of the material."""
        known = {field.name for field in dataclasses.fields(cls)} - {"numbers"}
        return cls(**{name: value for name, value in given.items() if name in known},
                   numbers={name: value for name, value in given.items() if name not in known})

    def __post_init__(self) -> None:
        for name, accepted in (("render_mode", (None, *RENDER_MODES)), ("grasp", get_args(Grip)),
                               ("horizon", get_args(Horizon))):
            if getattr(self, name) not in accepted:
                raise UnknownName(name, getattr(self, name), [one for one in accepted if one])
        if self.render_mode is not None and self.camera not in CAMERAS:
            raise UnknownName("camera", self.camera, CAMERAS)
        if not self.arm and (self.robot or self.gripper):
            raise ConfigError(f"robot = {self.robot!r}, gripper = {self.gripper!r} with arm = False; accepted: "
                              f"arm = True")
        if self.randomize in HARD and not self.action_delay:
            object.__setattr__(self, "action_delay", HARD_DELAY)
        object.__setattr__(self, "action_repeat", check_action_repeat(self.action_repeat))

    @property
    def hardware(self) -> tuple[str, str | None]:
        """Arm and hand, by name or file; a hand of None is the arm's usual one."""
        return self.robot or "iiwa14", self.gripper


def check_open(method: str, is_closed: bool) -> None:
    """Raise ConfigError for a call of a method of an environment that is closed."""
    if is_closed:
        raise ConfigError(f"{method}: the environment is closed; make a new one, or call close after the last {method}")


class Copied:
    """An environment that `copy.deepcopy` and `pickle` make again from its arguments and then set to its state.
    Fields, kernels and renderers stay behind. Its `spec` has the largest number of actions of an episode: Gymnasium
    leaves it out where no TimeLimit counts, and a registered number would hold for one action_repeat only."""

    max_episode_steps: int
    """Actions of an episode, if the simulation does not diverge."""
    action_space: Any
    observation_space: Any
    _spec: Any = None
    _arguments: tuple[tuple[Any, ...], dict[str, Any]]
    """Of the constructor."""

    def __new__(cls, *arguments: Any, **options: Any) -> Any:
        env = super().__new__(cls)
        env._arguments = arguments, options
        return env

    def __reduce__(self) -> tuple[Any, ...]:
        travelling = self._all_states(), self._spec, self.action_space, self.observation_space
        return partial(type(self), *self._arguments[0], **self._arguments[1]), (), travelling

    def __setstate__(self, state: Any) -> None:
        own, self._spec, self.action_space, self.observation_space = state
        self._load_all(own)

    def _all_states(self) -> Any:
        """Return what `_load_all` takes over in a copy."""
        raise NotImplementedError

    def _load_all(self, state: Any) -> None:
        raise NotImplementedError

    @property
    def spec(self) -> Any:
        """The specification that `gymnasium.make` or `make_vec` has made this with; None without it."""
        return self._spec

    @spec.setter
    def spec(self, spec: Any) -> None:
        """Set the specification, with the number of actions of an episode."""
        self._spec = None if spec is None else dataclasses.replace(spec, max_episode_steps=self.max_episode_steps)


class Episode:
    """Sums rewards over an action's steps; horizon: whether an episode of full length is terminated or truncated."""

    def __init__(self, task: TaskConfig, horizon: Horizon) -> None:
        self.task, self.horizon = task, horizon
        self.reward, self.outcome = build_reward(task), build_outcome(task)
        self.running, self.step_count, self.counts = False, 0, NOTHING_COUNTED
        self.diverged: str | None = None
        """Why the simulation diverged; None while it has not."""
        self.pose: mpm.Pose = task.start.pose
        """Pose of the tool in the world; the quaternion is continuous, without jumps of sign."""
        self._start = self.pose

    def restart(self, pose: mpm.Pose, counts: mpm.Counts, setting: Setting = STANDARD) -> dict[str, Any]:
        """Begin with the tool at a pose, the counts there, and what is drawn of the scene; return the info."""
        self.reward.restart()
        self.outcome.restart(setting.target_mass, setting.grain_mass)
        self._start = self.pose = pose
        self.counts, self.step_count, self.running, self.diverged = counts, 0, True, None
        return self._info({})

    def state(self) -> dict[str, Any]:
        """Return the episode's state: arrays and plain values."""
        return {"running": self.running, "step_count": self.step_count, "diverged": self.diverged,
                "start": np.concatenate(self._start), "pose": np.concatenate(self.pose),
                "counts": copy.deepcopy(self.counts._asdict()), "reward": self.reward.state(),
                "outcome": self.outcome.state()}

    def load(self, state: dict[str, Any]) -> None:
        """Take over what `state` returned."""
        self.running, self.step_count, self.diverged = state["running"], state["step_count"], state["diverged"]
        self._start, self.pose = read_pose(state["start"]), read_pose(state["pose"])
        self.counts = mpm.Counts(**copy.deepcopy(state["counts"]))
        self.reward.load(state["reward"])
        self.outcome.load(state["outcome"])

    @property
    def time(self) -> float:
        """Since the start of the episode [s]."""
        return self.step_count * self.task.step_dt

    def begin_action(self, action_repeat: int) -> int:
        """Reset the sums of rewards; return an action's steps, fewer at the end. Raises ConfigError after it."""
        if not self.running:
            raise ConfigError("step: no episode is running; call reset first")
        self._sums = dict.fromkeys(self.reward.terms, 0.0)
        return min(action_repeat, self.task.steps - self.step_count)

    def add_step(self, counts: mpm.Counts, pose: mpm.Pose) -> None:
        """Add the reward of one step, from its counts and the tool's pose at its end."""
        sign = -1.0 if self.pose.quaternion @ pose.quaternion < 0 else 1.0
        self.counts, self.pose = counts, mpm.Pose(pose.position, sign * pose.quaternion)
        self.step_count += 1
        last = self.step_count == self.task.steps
        step = self.outcome.step(counts, self.pose, self.tool_rotation(), last)
        for name, value in self.reward.step(step).items():
            self._sums[name] += value

    def diverge(self, error: Exception) -> None:
        """End the episode because the simulation diverged."""
        self.diverged = str(error)
        for name, value in self.reward.diverge(self.task.steps - self.step_count).items():
            self._sums[name] += value

    def end_action(self) -> tuple[float, bool, bool, dict[str, Any]]:
        """Return the action's reward, terminated, truncated and info."""
        over, early = self.step_count == self.task.steps, self.outcome.is_over
        self.running = not (over or early) and self.diverged is None
        info = self._info(self._sums)
        if self.diverged is not None:
            info |= {"diverged": self.diverged, "is_success": False}
        terminated = (over and self.horizon == "terminate") or early or self.diverged is not None
        return float(sum(self._sums.values())), terminated, over and not terminated, info

    def tool_rotation(self) -> float:
        """Return the tool's rotation [rad] about its lateral axis since the start."""
        R = self._start.matrix.T @ self.pose.matrix
        return math.atan2(R[0, 2], R[0, 0])

    def _info(self, terms: dict[str, float]) -> dict[str, Any]:
        readings = self.outcome.readings(self.counts) | self.reward.readings()
        return {"reward_terms": dict(terms), "tcs": self.reward.tcs, "tcs_terms": dict(self.reward.score),
                "readings": readings, "is_success": self.outcome.is_success(self.counts, readings), "time": self.time}
