"""What an observation term is, and what it reads."""

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, ClassVar, NamedTuple

import gymnasium
import numpy as np

import mpm
from robosim.base.errors import ConfigError
from robosim.config.materials import MaterialConfig
from robosim.tasks.draw import STANDARD, Setting
from robosim.tasks.task import TaskConfig

NOTHING: Mapping[str, float] = {}


class Sight(NamedTuple):
    """The state at the end of an action."""

    time: float
    """Since the start of the episode [s]."""
    progress: float
    """Share of the episode that is over."""
    pose: mpm.Pose
    """Of the tool; its quaternion is without jumps of sign."""
    counts: mpm.Counts
    """Of the task's grains."""
    grains: np.ndarray
    """Positions [m] and velocities [m/s] (n, 6), float32, of the grains that `Term.grains` asks for."""
    received: np.ndarray
    """Impulse [N s], [N m s] (6,) of the grains on the tool in the action, in world axes, about the world's origin;
    zero at the start of an episode, and with an arm, which has a sensor for it."""
    duration: float
    """Time [s] that it took."""
    setting: Setting = STANDARD
    """How the scene differs from the task's."""
    sensors: Any = None
    """An `ArmSampler`; None without an arm, and where no term reads it."""
    qpos: np.ndarray | None = None
    """State of all joints of the scene with the arm; None without an arm."""
    waiting: Sequence[tuple[Any, ...]] = ()
    """Velocities that were commanded and are not yet carried out, as `robosim.tasks.actions.DelayLine` has them."""

    @property
    def believed(self) -> mpm.Pose:
        """Where the robot takes the tool to be."""
        return self.setting.believed(self.pose)


class SenseScene(NamedTuple):
    """What the terms of an environment are built for."""

    task: TaskConfig
    material: MaterialConfig
    solver: mpm.Solver
    arm: Any = None
    """The `ArmTool`; None without an arm."""


class Term(ABC):
    """One part of an observation: name, unit, space, and how it is measured; float32, or uint8 for pictures.

    A term keeps nothing from step to step; what it has to remember of an episode, `begin` returns for `measure`."""

    name: ClassVar[str]
    unit: ClassVar[str]
    """Of the values; several separated by commas."""
    privileged: ClassVar[bool] = False
    """Whether no sensor of a real robot measures it."""
    all_grains: ClassVar[bool] = False
    """Whether it reads all grains."""
    reads_sensors: ClassVar[bool] = False
    """Whether it reads the `ArmSampler` of an arm, where there is one."""
    space: gymnasium.spaces.Box
    parts: Mapping[str, int] = {}  # noqa: RUF012  (never changed)
    """Names of parts of a value, with their lengths, in place of the term's own name in a flat observation."""

    DRAWN: ClassVar[dict[str, tuple[float, float]]] = {}
    """Options that episodes may draw, with their lowest and highest values."""

    def begin(self, sight: Sight, drawn: Mapping[str, float] = NOTHING) -> Any:
        """Return what `measure` is to remember of an episode that starts now; drawn: its values of options in DRAWN."""
        return None

    @abstractmethod
    def measure(self, sight: Sight, memory: Any, rng: np.random.Generator) -> np.ndarray:
        """Return the present value in the shape and type of `space`; rng: for noise of its own kind."""

    def close(self) -> None:
        """Free what the term holds."""
        return

    @classmethod
    def missing(cls, scene: SenseScene) -> str:
        """Return what the term needs that a scene does not have; empty where it can be built."""
        return ""


def box(low: Iterable[float] | np.ndarray, high: Iterable[float] | np.ndarray) -> gymnasium.spaces.Box:
    """Return a space of single-precision numbers between bounds."""
    return gymnasium.spaces.Box(np.asarray(low, np.float32), np.asarray(high, np.float32), dtype=np.float32)


def check_option(term: str, option: str, value: Any, least: float, most: float) -> float:
    """Return a number that an option of a term is; raise ConfigError for one outside its bounds."""
    try:
        number = float(value)
    except (TypeError, ValueError):
        number = float("nan")
    if not least <= number <= most:
        raise ConfigError(f"obs: {term}: {option} = {value!r}; accepted: {least:g} to {most:g}")
    return number


def check_count(term: str, option: str, value: Any, most: int) -> int:
    """Return a whole number from 1 on that an option of a term is; raise ConfigError for anything else."""
    if isinstance(value, bool) or not isinstance(value, int | np.integer) or not 1 <= value <= most:
        raise ConfigError(f"obs: {term}: {option} = {value!r}; accepted: a whole number from 1 to {most}")
    return int(value)
