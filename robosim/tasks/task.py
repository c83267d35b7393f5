"""Configuration of a sub-task: the scene, what the agent may do, and what it is rewarded for."""

from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import pydantic
from pydantic import Field, PositiveFloat, PositiveInt
from scipy.spatial.transform import Rotation

import mpm
from robosim.config.loader import load, read
from robosim.config.resources import config_names, config_path
from robosim.config.scene import ContainerConfig, FieldConfig, RegionConfig
from robosim.config.settings import Setting
from robosim.config.table import Table, Vector3
from robosim.shapes import tool_shape

Kind = Literal["scoop", "translate", "pour", "move"]


class GrainsConfig(Table):
    """How many grains there are, and which are looked at."""

    count: PositiveInt
    """N_p"""
    observe_every: PositiveInt = 1
    """delta_d: the observation holds every so-manieth grain."""
    elites: PositiveInt | None = None
    """Grains closest to the goal that the scooping reward looks at; null: the observed ones count."""

    @property
    def counted(self) -> int:
        """N*: grains that the reward counts."""
        return self.elites or self.count // self.observe_every


class StartConfig(Table):
    """The tool's pose at the start: R = Rz(yaw) Ry(pitch)."""

    position: Vector3
    """Of the tool's frame [m]."""
    yaw_deg: float
    pitch_deg: float = 0.0
    spread: Vector3 = (0.0, 0.0, 0.0)
    """Largest random displacement [m] along each axis; grains in the tool go with it."""
    pile: RegionConfig | None = None
    """Where the grains lie if neither the tool nor a container holds them."""
    pile_spread: Vector3 = (0.0, 0.0, 0.0)
    """Largest random displacement [m] of that pile."""

    @property
    def pose(self) -> mpm.Pose:
        turn = Rotation.from_euler("ZY", (self.yaw_deg, self.pitch_deg), degrees=True)
        return mpm.Pose(np.array(self.position), turn.as_quat(scalar_first=True))


class ActionConfig(Table):
    """What an action of 1 means."""

    dimensions: Literal[3, 6]
    """3: translation; 6: translation and rotation; in world axes."""
    speed: PositiveFloat
    """[m/s]"""
    angular_speed: PositiveFloat = 1.0
    """[rad/s]"""
    lower: Vector3
    """Of the box that the tool's origin stays in [m]."""
    upper: Vector3
    """Its corner opposite [m]."""


class DistanceConfig(Table):
    """R_dist = beta (gamma - sum of weighted Manhattan distances) in every step, with gamma = N* reference and
    beta = total / (steps gamma): an episode in which nothing moves earns total (1 - start's distance / reference)."""

    weights: Vector3
    """Of the distances along x, y and z."""
    total: PositiveFloat
    """What an episode on the goal earns."""
    reference: PositiveFloat
    """Weighted distance [m] at which nothing is earned."""


class TurnConfig(Table):
    """J = scale (margin - |turned - angle|), angles in rad, about the tool's lateral axis."""

    scale: PositiveFloat
    """Score per rad."""
    margin: PositiveFloat
    """Error [rad] at which nothing is earned."""
    angle_deg: float
    """What is asked."""


class RewardConfig(Table):
    """Weights of the paper's rewards, per grain and per step of `step_dt`."""

    distance: DistanceConfig
    target: PositiveFloat
    """beta^t: per grain, + on the target, - off it."""
    poured: float = Field(0.0, ge=0.0)
    """beta^p: per grain at the end, + poured out, - not."""
    lost: float = Field(0.0, le=0.0)
    """beta^n: per grain that leaves the bounds."""
    contact: float = Field(0.0, ge=0.0)
    """beta^c: per grain that touches the tool, every step."""
    collision: float = Field(0.0, le=0.0)
    """beta^i: every step in which the tool collides with the container."""
    turn: TurnConfig | None = None
    """Of the tool, at the end."""


class SuccessConfig(Table):
    """What counts as success at the end."""

    delivered: float = Field(gt=0.0, le=1.0)
    """Least share of N* on the target."""
    turn_error_deg: PositiveFloat | None = None


class ScriptConfig(Table):
    """A pose of the tool on the way of the scripted policy, reached at a time."""

    time: float = Field(ge=0.0)
    """[s]"""
    position: Vector3
    """Of the tool's frame [m]."""
    pitch_deg: float = 0.0


class TaskConfig(Table):
    """A sub-task."""

    description: str
    """What it is, for its page."""
    kind: Kind
    """What is rewarded."""
    tool: Literal["spoon", "scoop", "bottle", "shovel"]
    material: str
    """Of configs/materials, or a .yaml file."""
    grains: GrainsConfig
    steps: PositiveInt
    """T_s: of an episode."""
    step_dt: PositiveFloat
    """Of one of them [s]."""
    field: FieldConfig
    tool_wall: PositiveFloat
    """Wall [m] of the tool as the grains see it, grown outward."""
    container: str | None = None
    """That the tool scoops from: a model below models/containers."""
    container_place: ContainerConfig | None = None
    """Where it stands."""
    stand: RegionConfig | None = None
    """A block under the tool at the start: seen, not met by grains."""
    start: StartConfig
    action: ActionConfig
    goal: Vector3
    """That distances are measured from [m]."""
    target: RegionConfig
    """Where grains count as delivered."""
    bounds: RegionConfig
    """A grain outside, and not in the tool, is lost (poured out, where pouring is the task)."""
    reward: RewardConfig
    success: SuccessConfig
    script: Annotated[tuple[ScriptConfig, ...], Field(min_length=1)]
    """Way of the scripted policy, smooth from pose to pose; it begins at the start."""

    @property
    def containers(self) -> dict[str, ContainerConfig]:
        """The container, if there is one, by the name of its model."""
        return {self.container: self.container_place} if self.container and self.container_place else {}

    def way(self, begin: np.ndarray | None = None) -> "Way":
        """The script's poses, from a place [m] (3,) on; None: the start's."""
        return Way(self, np.array(self.start.position) if begin is None else begin)

    @property
    def carried(self) -> bool:
        """Whether the grains are in the tool at the start."""
        return self.container is None and self.start.pile is None

    @pydantic.model_validator(mode="after")
    def _check(self) -> "TaskConfig":
        tool_shape(self.tool)
        scoops = self.kind == "scoop"
        times = [s.time for s in self.script]
        if times[0] <= 0 or any(b <= a for a, b in pairwise(times)):
            raise ValueError(f"script: times {times} s; accepted: positive and rising")
        if {scoops} != {self.container is not None, self.container_place is not None, self.grains.elites is not None}:
            raise ValueError("container, container_place and grains.elites belong to kind: scoop, and to no other")
        if scoops != (self.reward.turn is not None):
            raise ValueError("reward.turn belongs to kind: scoop, and to no other")
        if (self.kind == "move") != (self.start.pile is not None):
            raise ValueError("start.pile belongs to kind: move, and to no other")
        if self.field.dt is not None and abs(self.step_dt / self.field.dt - round(self.step_dt / self.field.dt)) > 1e-6:
            raise ValueError(f"field.dt = {self.field.dt} s divides step_dt = {self.step_dt} s "
                             f"{self.step_dt / self.field.dt:.4f} times; accepted: a whole number")
        low, high = np.array(self.action.lower), np.array(self.action.upper)
        if np.any(np.array(self.start.position) < low) or np.any(np.array(self.start.position) > high):
            raise ValueError(f"start.position {self.start.position} lies outside action.lower .. action.upper")
        return self


class Way:
    """The poses of a task's script over time, from a place on."""

    def __init__(self, task: TaskConfig, begin: np.ndarray) -> None:
        self._yaw = task.start.yaw_deg
        self._times = np.array([0.0] + [s.time for s in task.script])
        self._places = np.array([begin] + [np.array(s.position) for s in task.script])
        self._pitches = np.array([task.start.pitch_deg] + [s.pitch_deg for s in task.script])

    def pose(self, time: float) -> mpm.Pose:
        """Pose at a time [s], smooth between the script's."""
        k = min(max(int(np.searchsorted(self._times, time)), 1), len(self._times) - 1)
        u = np.clip((time - self._times[k - 1]) / (self._times[k] - self._times[k - 1]), 0.0, 1.0)
        u = u * u * (3.0 - 2.0 * u)
        place = (1 - u) * self._places[k - 1] + u * self._places[k]
        pitch = (1 - u) * self._pitches[k - 1] + u * self._pitches[k]
        turn = Rotation.from_euler("ZY", (self._yaw, pitch), degrees=True)
        return mpm.Pose(place, turn.as_quat(scalar_first=True))


def task_names() -> list[str]:
    """Names of the sub-tasks: SpoonScoop and so on."""
    return config_names("tasks")


def is_task(scene: str) -> bool:
    """Whether a scene is a sub-task or the file of one, told from a rehearsal's by its `kind`."""
    if scene in task_names() or not Path(scene).is_file():
        return scene in task_names()
    data = read(Path(scene))
    return isinstance(data, dict) and "kind" in data


def load_task(name: str, settings: Sequence[Setting] = ()) -> TaskConfig:
    """Load a sub-task by name (configs/tasks) or path; settings as of `load`."""
    return load(config_path("tasks", name, "task"), TaskConfig, settings=settings)
