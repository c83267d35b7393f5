"""Configuration of a sub-task: its scene, what the agent may do, what it is rewarded for, and the scripted path."""

from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, ClassVar

import numpy as np
import pydantic
from pydantic import Field
from scipy.spatial.transform import Rotation

import mpm
from robosim.base.errors import RobosimError
from robosim.base.resources import config_names, config_path
from robosim.config.bounds import MAX_ENTRIES, SAMPLES_PER_PERIOD, FilePath, Name, RangeEnd, TimeStep
from robosim.config.scene import ContainerConfig, RegionConfig
from robosim.config.scene_config import SceneConfig
from robosim.config.settings import Setting
from robosim.config.table import Vector3, load, read, validate
from robosim.config.tool import ToolConfig
from robosim.rewards.section import DOSE, RewardTerms
from robosim.tasks.sections import ActionConfig, DosingConfig, GrainsConfig, ScriptConfig, StartConfig, SuccessConfig

RandomRange = tuple[RangeEnd, RangeEnd]
RandomChoice = Annotated[tuple[FilePath, ...], Field(min_length=1, max_length=MAX_ENTRIES)]
MAX_EPISODE = 100_000
"""Steps of an episode: a hundred times those of arXiv 2406.09178."""
MAX_TIME = 600.0
"""Duration [s] of an episode, as of a path; robosim.config.bounds has the reason."""

COMPLETED: Any = None
"""Default of the sections that a task with a receiver leaves out, until they are completed."""
FAR = 10.0
"""Half size [m] of a region without an end."""


class ScriptedPath:
    """Tool poses over time, eased between waypoints, with R = Rz(yaw) Ry(pitch).
    times [s] (n,), rising, from 0 on. positions [m] (n, 3): of the tool's frame in the world. angles_deg (n, 2): yaw
    and pitch."""

    def __init__(self, times: np.ndarray, positions: np.ndarray, angles_deg: np.ndarray) -> None:
        self._times, self._positions, self._angles = times, positions, angles_deg

    def pose(self, time: float) -> mpm.Pose:
        """Return the tool's pose at a time [s]; after the last waypoint it stays there."""
        k = min(max(int(np.searchsorted(self._times, time)), 1), len(self._times) - 1)
        u = np.clip((time - self._times[k - 1]) / (self._times[k] - self._times[k - 1]), 0.0, 1.0)
        u = u * u * (3.0 - 2.0 * u)  # at rest in every waypoint
        position = (1 - u) * self._positions[k - 1] + u * self._positions[k]
        rotation = Rotation.from_euler("ZY", (1 - u) * self._angles[k - 1] + u * self._angles[k], degrees=True)
        return mpm.Pose(position, rotation.as_quat(scalar_first=True))


class TaskConfig(SceneConfig):
    """A sub-task: a scene, a start, regions, and the terms of its reward. Paths in the file are relative to it.

    It has at most one container: filled, the tool scoops from it; empty, it is the receiver on a balance into which a
    dosing task pours, upright, of sizes or of models/containers."""

    COMES_TO_REST: ClassVar[bool] = True
    HAS_HANDLE: ClassVar[bool] = False

    grains: GrainsConfig
    """Number of grains, and which are observed and counted."""
    steps: int = Field(ge=1, le=MAX_EPISODE)
    """Steps of an episode; T_s in arXiv 2406.09178."""
    step_dt: TimeStep
    """Duration of a step [s]."""
    stand: RegionConfig | None = None
    """Block under the tool at the start; only for rendering, grains do not collide with it."""
    start: StartConfig
    """Pose of the tool at the start of an episode."""
    action: ActionConfig
    """Action space."""
    goal: Vector3
    """Point [m] to which the reward measures the distances of the grains."""
    target: RegionConfig = Field(COMPLETED)
    """Region in which grains count as delivered; null with a receiver: the inside of that, up to its rim."""
    bounds: RegionConfig = Field(COMPLETED)
    """A grain outside this region and not in the tool is lost; where the reward has the term poured, poured out. null
    with a receiver: all above its rim."""
    reward: RewardTerms = Field(COMPLETED)
    """Terms of the reward; null in a dosing task: error, time and spill with their usual weights."""
    success: SuccessConfig | None = None
    """Criterion of success; null in a dosing task, whose tolerances are in the section dose."""
    dose: DosingConfig | None = None
    """A mass to dose, of a dosing task; null: none."""
    randomize: dict[Name, RandomRange | RandomChoice] = Field({}, max_length=MAX_ENTRIES)
    """What every episode draws: number -> [lowest, highest]; material -> names of materials."""
    script: Annotated[tuple[ScriptConfig, ...], Field(min_length=1, max_length=MAX_ENTRIES)]
    """Waypoints of the scripted policy; the first segment begins at the start pose, and speeds are smooth."""

    @pydantic.model_serializer(mode="wrap")
    def _serialize(self, standard: pydantic.SerializerFunctionWrapHandler) -> dict[str, Any]:
        """Leave out that nothing is drawn or dosed: what has been learned on a task stays of use."""
        left_out = {name for name in ("randomize", "dose") if not getattr(self, name)}
        left_out |= set() if self.dose is None else {"success"}
        left_out |= set() if self.receiver is None else {"target", "bounds"}
        return {name: value for name, value in standard(self).items() if name not in left_out}

    @property
    def advance_dt(self) -> float:
        return self.step_dt

    @property
    def grain_count(self) -> int | None:
        return self.grains.count

    @property
    def container(self) -> str | None:
        """Name of the filled container, if there is one."""
        return next(iter(self.sources), None)

    @property
    def receiver(self) -> str | None:
        """Name of the empty container, if there is one."""
        return next(iter(self.sinks), None)

    @property
    def shells(self) -> tuple[str, ...]:
        """The containers that are thin shells in the simulation of the grains: the receiver."""
        return self.sinks

    @property
    def solid_wall(self) -> float:
        """Wall thickness [m] of the tool in the simulation of the grains.
        A shell has that of a grain's spacing as grains are placed on it: places above it are found by half such steps.
        """
        spacing = self.field.cell / self.field.grains_per_cell ** (1.0 / 3.0)
        return spacing if self.tool_wall == "shell" else super().solid_wall

    @property
    def carried(self) -> bool:
        """Whether the grains are in the tool at the start."""
        return self.container is None and self.pile is None

    def with_tool(self, tool: str | ToolConfig) -> "TaskConfig":
        """Return the same with another tool, by name, file or configuration; raises ConfigError."""
        return validate(self.model_dump() | {"tool": tool}, Path("options"), TaskConfig)

    def scripted_path(self, start: np.ndarray | None = None, place: mpm.Pose | None = None) -> ScriptedPath:
        """Return the scripted policy's path from a position [m] (3,); None: from the task's own start.
        place: displacement of the target, which the waypoints follow. Around a container all of them do, and turn with
        it; else each follows by its share of the way from the start to the last, and keeps its heading, as the grains
        begin where the task has them."""
        first = np.array(self.start.position) if start is None else start
        points = np.array([np.array(s.position) for s in self.script])
        angles = np.array([(self.start.yaw_deg, s.pitch_deg) for s in self.script])
        if place is not None and self.containers:
            points = place.apply(points)
            angles[:, 0] += np.degrees(np.arctan2(place.matrix[1, 0], place.matrix[0, 0]))
        elif place is not None:
            come, left = (np.linalg.norm(points - end, axis=1) for end in (self.start.position, points[-1]))
            centre = np.array(self.target.centre)
            points = points + np.outer(come / np.maximum(come + left, 1e-9), place.apply(centre[None])[0] - centre)
        return ScriptedPath(np.array([0.0] + [s.time for s in self.script]), np.vstack([first, points]),
                            np.vstack([(self.start.yaw_deg, self.start.pitch_deg), angles]))

    @pydantic.model_validator(mode="before")
    @classmethod
    def _complete(cls, data: Any) -> Any:
        """Add the sections that a dosing task leaves out; refuse those that it must, and null for the others."""
        if not isinstance(data, dict):
            return data
        given = {name: value for name, value in data.items() if value is not None or name not in ("target", "bounds")}
        regions = {} if data.get("dose") is None else receiver_regions(data.get("containers"))
        both = [name for name in regions if name in given]
        if both:
            raise ValueError(f"receiver with {', '.join(both)}; accepted: neither target nor bounds")
        if data.get("dose") is not None and data.get("reward") is None:
            given["reward"] = DOSE
        return dict.fromkeys(("target", "bounds", "reward")) | given | regions

    def _check_reward(self) -> None:
        """Refuse terms that do not fit the task, or each other, and a criterion of success that does not."""
        reward, success = self.reward, self.success
        lacks = [name for name in ("distance", "target") if self.dose is None and name not in reward]
        if lacks:
            raise ValueError(f"reward without {' and '.join(lacks)}; accepted: with both, or a section dose")
        of_dose = [name for name, term in reward.items() if term.of_dose and self.dose is None]
        if of_dose:
            raise ValueError(f"reward.{of_dose[0]} without a section dose; accepted: with one")
        if success is not None and self.dose is not None:
            raise ValueError("dose with success; accepted: dose.tolerance_percent and dose.tolerance_g")
        if success is None and self.dose is None:
            raise ValueError("success: missing; accepted: success.delivered, or a section dose")
        if self.container is None and "collision" in reward:
            raise ValueError(f"reward.collision = {reward['collision'].model_dump()} without a container; accepted: 0")
        if {"poured", "lost"} <= reward.keys():
            raise ValueError(f"reward.poured = {reward['poured'].model_dump()}, reward.lost = "
                             f"{reward['lost'].model_dump()}; accepted: one of them, for grains that leave the bounds")
        if success is not None and success.turn_error_deg is not None and "turn" not in reward:
            raise ValueError(f"success.turn_error_deg = {success.turn_error_deg} without reward.turn; accepted: null")

    def _check_dosing(self) -> None:
        """Refuse what does not fit a dose, a receiver or a vibration."""
        vibration, dose = self.action.vibration, self.dose
        if vibration is not None and vibration.frequency[1] * self.step_dt * SAMPLES_PER_PERIOD > 1.0 + 1e-9:
            raise ValueError(f"action.vibration.frequency = {vibration.frequency} Hz with step_dt = {self.step_dt} s; "
                             f"accepted: up to {1.0 / (SAMPLES_PER_PERIOD * self.step_dt):g} Hz, {SAMPLES_PER_PERIOD} "
                             f"steps in a period")
        if len(self.containers) > 1:
            raise ValueError(f"containers: {', '.join(self.containers)}; accepted: one")
        for name in self.sinks:
            receiver = self.containers[name]
            if dose is None:
                raise ValueError(f"containers.{name}: empty; accepted: with a fill_height, or with a section dose")
            if receiver.mesh is not None or any(receiver.tilt_deg) or \
                    (receiver.radius is None and receiver.yaw_deg % 180.0):
                raise ValueError(f"containers.{name}: empty; accepted: an upright container of size, radius with "
                                 f"height, or model, its sides along x and y")
        if dose is None:
            return
        if not self.containers:
            raise ValueError("dose without containers; accepted: an empty one to pour into, or a filled one to scoop "
                             "from")
        if self.grains.observe_every != 1 or self.grains.elites is not None or self.action.dimensions != 6:
            raise ValueError(f"dose with grains.observe_every = {self.grains.observe_every}, grains.elites = "
                             f"{self.grains.elites}, action.dimensions = {self.action.dimensions}; accepted: 1, null "
                             f"and 6, as every grain has a mass and the tool turns")

    def check(self) -> None:
        super().check()
        self._check_reward()
        self._check_dosing()
        if self.tool_fill_height is not None:
            raise ValueError("tool_fill_height: accepted in a rehearsal; here grains.count says how full the tool is")
        if self.steps * self.step_dt > MAX_TIME:
            raise ValueError(f"steps = {self.steps} of step_dt = {self.step_dt} s are {self.steps * self.step_dt:.3g} "
                             f"s; accepted: up to {MAX_TIME} s")
        times = [s.time for s in self.script]
        if times[0] <= 0 or any(b <= a for a, b in pairwise(times)):
            raise ValueError(f"script: times {times} s; accepted: positive and rising")
        if self.container is not None and self.pile is not None:
            raise ValueError("a filled container and pile; accepted: one of them, or a tool that is full at the start")
        if self.field.region_lower is None:
            raise ValueError("field.region_lower, region_upper: missing; accepted: the corners of the grains' region")
        if self.field.dt is not None and abs(self.step_dt / self.field.dt - round(self.step_dt / self.field.dt)) > 1e-6:
            raise ValueError(f"field.dt = {self.field.dt} s divides step_dt = {self.step_dt} s "
                             f"{self.step_dt / self.field.dt:.4f} times; accepted: a whole number")
        low, high = np.array(self.action.lower), np.array(self.action.upper)
        if np.any(np.array(self.start.position) < low) or np.any(np.array(self.start.position) > high):
            raise ValueError(f"start.position {self.start.position} lies outside action.lower .. action.upper")


def is_task(scene: str) -> bool:
    """Return whether a scene is a sub-task's name or file, which has the key `step_dt`, as rehearsals do not."""
    if scene in config_names("tasks") or not Path(scene).is_file():
        return scene in config_names("tasks")
    data = read(Path(scene))
    return isinstance(data, dict) and "step_dt" in data


def load_task(name: str, settings: Sequence[Setting] = ()) -> TaskConfig:
    """Load a sub-task by name (configs/tasks) or path; settings as of `load`. Raises ConfigError, UnknownName."""
    return load(config_path("tasks", name, "task"), TaskConfig, settings=settings)


def receiver_regions(containers: Any) -> dict[str, RegionConfig]:
    """Return target and bounds of a task with a receiver: its inside up to the rim, and all above; empty without one.
    containers: as a file gives them, or their configurations; of what is refused elsewhere both are arbitrary."""
    from robosim.scene.models import container_shape  # MuJoCo, which most files of tasks do not need

    for name, given in containers.items() if isinstance(containers, dict) else ():
        try:
            receiver = given if isinstance(given, ContainerConfig) else ContainerConfig.model_validate(given)
            if receiver.fill_height:
                continue
            shape = container_shape(name, receiver)
        except (pydantic.ValidationError, RobosimError):
            nowhere = RegionConfig(centre=(0.0, 0.0, 0.0), half=(0.0, 0.0, 0.0))
            return {"target": nowhere, "bounds": nowhere}
        (x, y, z), region, height = receiver.position, shape.region, shape.height
        bottom = region.centre[2] - region.half[2]
        half = (region.half[0], region.half[1], 0.5 * (height - bottom))
        return {"target": RegionConfig(centre=(x, y, z + 0.5 * (height + bottom)), half=half, round=shape.is_round),
                "bounds": RegionConfig(centre=(x, y, z + height + FAR), half=(FAR, FAR, FAR))}
    return {}
