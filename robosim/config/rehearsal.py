"""Configuration of a whole-arm rehearsal."""

from collections.abc import Sequence
from typing import Annotated, Literal

import pydantic
from pydantic import Field

from robosim.config.bounds import (
    MAX_ENTRIES,
    Acceleration,
    Angle,
    AngularAcceleration,
    AngularSpeed,
    Duration,
    FilePath,
    GraspTime,
    Length,
    Mass,
    Name,
    Speed,
    Text,
    Tolerance,
)
from robosim.config.resources import config_path, container_names
from robosim.config.robot import Grip, JointTrajectoryConfig, LimitsConfig, ServoConfig
from robosim.config.scene import ContainerConfig, FieldConfig, RegionConfig
from robosim.config.settings import Setting
from robosim.config.table import Table, Vector3, load


class PathConfig(Table):
    """How the tool rounds the corners between waypoints."""

    acceleration: Acceleration
    """Acceleration of the tool along the path [m/s^2]."""
    angular_acceleration: AngularAcceleration
    """Angular acceleration of the tool along the path [rad/s^2]."""
    corner_tolerance: Tolerance = 1.5e-3
    """Largest distance [m] between the rounded path and the screw motions inside a container."""


class WaypointConfig(Table):
    """A pose of the tool, reached by a screw motion from the waypoint before."""

    name: Name
    """Its name in reports and errors."""
    frame: Name
    """Frame of position and rotation: "world", or the name of a container."""
    position: Vector3
    """Position of the tool's frame [m]."""
    rotation_deg: tuple[Angle, Angle, Angle] = (0.0, 0.0, 0.0)
    """Rotations about the frame's x, then y, then z axis [deg]."""
    speed: Speed
    """Speed of the tool on the way to this waypoint [m/s]."""
    angular_speed: AngularSpeed = 1.5
    """Angular speed on the way to this waypoint [rad/s]; the slower of the two decides."""
    stop: bool = False
    """Whether the tool stops there."""
    dwell: Duration = 0.0
    """Duration [s] of the stop."""
    acceleration: Acceleration | None = None
    """Acceleration [m/s^2] in the rounded corner, or before and after the stop; null: path.acceleration."""


class RehearsalConfig(Table):
    """A whole-arm rehearsal."""

    description: Text
    """Title of its reports."""
    tool: Literal["spoon", "scoop", "bottle", "shovel"]
    """Name of a tool of models/tools."""
    material: FilePath
    """Name of a material of configs/materials, or the path of a .yaml file."""
    grasp: Grip
    """weld: fixed in the hand; friction: held by the fingers alone."""
    tool_container: Annotated[list[Literal["contact", "sdf"]], Field(max_length=2)] = ["contact", "sdf"]  # noqa: RUF012
    """How collisions of tool and containers are detected. contact: MuJoCo contacts, which exert forces; sdf: points of
    the container with a negative signed distance to the tool."""
    host_dt: float = Field(ge=1e-5, le=1e-3)
    """MuJoCo step [s]."""
    coupling: Literal["one_way", "lagged", "mobility"] = "mobility"
    """one_way: grains exert no force on the arm; lagged: their force acts one step later; mobility: contact and motion
    of the arm are solved together."""
    collision_thickness: Length
    """Wall thickness [m] of the tool in the simulation of the grains; thickened outward, the inner volume is kept."""
    grasp_time: GraspTime
    """Time [s] for the fingers to close before the arm moves."""
    containers: dict[Name, ContainerConfig] = {}  # noqa: RUF012
    """Containers by their names in models/containers. A filled one is the source of the material, an empty one the
    target."""
    pile: RegionConfig | None = None
    """Region of material on the table at the start, before it settles; instead of a filled container."""
    tool_fill_height: Length | None = None
    """Height [m] of material in the tool at the start, above its inner bottom; instead of a filled container."""
    area: RegionConfig | None = None
    """Target region of the material, if the target is not a container."""
    field: FieldConfig
    limits: LimitsConfig
    servo: ServoConfig
    path: PathConfig
    joint_trajectory: JointTrajectoryConfig = JointTrajectoryConfig()
    waypoints: Annotated[tuple[WaypointConfig, ...], Field(min_length=2, max_length=MAX_ENTRIES)]
    """Poses of the tool, in order."""
    weigh_at: Name | None = None
    """Waypoint with a dwell, where the wrist sensor weighs the load; the grains in the tool count as scooped. null: no
    weighing, all grains count."""
    least_load: Mass = 0.0
    """Smallest accepted mass [kg] of the load."""
    trajectory: Literal["script", "learned"] = "script"
    """script: follow the waypoints; learned: follow the learned motions of the sub-tasks in `learned`."""
    learned: Annotated[tuple[Name, ...], Field(max_length=MAX_ENTRIES)] = ()
    """Sub-tasks whose learned motions are joined, in order."""
    motions: FilePath | None = None
    """Folder with a motion of each sub-task as TASK.npz; null: the bundled motions."""

    @property
    def source(self) -> str | None:
        """The container that is filled at the start, if one is."""
        return next((name for name, c in self.containers.items() if c.fill_height > 0), None)

    @property
    def sink(self) -> str | None:
        """The container that takes the material, if one does."""
        return next((name for name, c in self.containers.items() if c.fill_height == 0), None)

    @pydantic.model_validator(mode="after")
    def _check_material(self) -> "RehearsalConfig":
        names = container_names()
        for name in self.containers:
            if name not in names:
                raise ValueError(f"containers: unknown {name!r}; valid: {', '.join(names)}")
        filled = [c.fill_height > 0 for c in self.containers.values()]
        givers = filled.count(True) + (self.pile is not None) + (self.tool_fill_height is not None)
        if givers != 1:
            raise ValueError(f"{givers} places hold material at the start; accepted: one of a container with a "
                             f"fill_height, pile, tool_fill_height")
        if filled.count(False) + (self.area is not None) != 1:
            raise ValueError(f"{filled.count(False) + (self.area is not None)} places take material; accepted: one of "
                             f"a container without fill_height, area")
        if self.pile is not None and (self.pile.round or min(self.pile.half) <= 0):
            raise ValueError(f"pile: half {self.pile.half}, round: {self.pile.round}; accepted: above 0, a block")
        if self.source is not None and self.weigh_at is None:
            raise ValueError("weigh_at: missing; a tool that is filled is weighed at a waypoint with a dwell")
        if self.trajectory == "learned" and not self.learned:
            raise ValueError("trajectory: learned needs `learned`, a list of sub-tasks")
        return self

    @pydantic.model_validator(mode="after")
    def _check_names(self) -> "RehearsalConfig":
        names = [w.name for w in self.waypoints]
        if len(set(names)) != len(names):
            raise ValueError(f"waypoints: names repeat: {sorted({n for n in names if names.count(n) > 1})}")
        if self.trajectory == "script" and self.weigh_at is not None:
            if self.weigh_at not in names:
                raise ValueError(f"weigh_at: unknown waypoint {self.weigh_at!r}; valid: {', '.join(names)}")
            if next(w for w in self.waypoints if w.name == self.weigh_at).dwell < 0.2:
                raise ValueError(f"weigh_at: waypoint {self.weigh_at!r} needs a dwell of 0.2 s or more")
        for w in self.waypoints:
            if w.frame not in ("world", *self.containers):
                raise ValueError(f"waypoint {w.name!r}: unknown frame {w.frame!r}; "
                                 f"valid: {', '.join(('world', *self.containers))}")
            if w.dwell and not w.stop:
                raise ValueError(f"waypoint {w.name!r}: dwell = {w.dwell} s needs stop: true")
        walls = self.collision_thickness / self.field.cell
        if not 0.5 - 1e-9 <= walls <= 1.0 + 1e-9:
            raise ValueError(f"collision_thickness = {self.collision_thickness} m is {walls:.2f} cells of "
                             f"{self.field.cell} m; accepted: 0.5 to 1 (a thinner wall leaks, "
                             f"a thicker one distorts the {self.tool})")
        if self.field.dt is not None and abs(self.host_dt / self.field.dt - round(self.host_dt / self.field.dt)) > 1e-6:
            raise ValueError(f"field.dt = {self.field.dt} s divides host_dt = {self.host_dt} s "
                             f"{self.host_dt / self.field.dt:.4f} times; accepted: a whole number")
        if not self.waypoints[0].stop or not self.waypoints[-1].stop:
            raise ValueError("waypoints: the first and the last need stop: true")
        return self


def load_rehearsal(name: str, overrides: dict | None = None, settings: Sequence[Setting] = ()) -> RehearsalConfig:
    """Load a rehearsal by name (configs/rehearsals) or path; overrides and settings as of `load`."""
    return load(config_path("rehearsals", name, "rehearsal"), RehearsalConfig, overrides, settings)
