"""Configuration of a whole-arm rehearsal."""

from collections.abc import Sequence
from typing import Annotated, Literal

import pydantic
from pydantic import Field, PositiveFloat

from robosim.config.resources import config_path, container_names
from robosim.config.robot import Grip, LimitsConfig, ServoConfig
from robosim.config.scene import ContainerConfig, FieldConfig, RegionConfig
from robosim.config.settings import Setting
from robosim.config.table import Table, Vector3, load


class PathConfig(Table):
    """How the tool rounds the corners between waypoints."""

    acceleration: PositiveFloat
    """Acceleration of the tool along the path [m/s^2]."""
    angular_acceleration: PositiveFloat
    """Angular acceleration of the tool along the path [rad/s^2]."""
    corner_tolerance: PositiveFloat = 1.5e-3
    """Largest distance [m] between the smoothed path and the commanded screws inside a container."""


class WaypointConfig(Table):
    """A pose of the tool, reached along a screw from the waypoint before."""

    name: str
    """What reports and errors call it."""
    frame: str
    """"world" or a container: where position and rotation are given."""
    position: Vector3
    """Position of the tool's frame [m]."""
    rotation_deg: Vector3 = (0.0, 0.0, 0.0)
    """Rotations about the frame's x, then y, then z axis [deg]."""
    speed: PositiveFloat
    """Speed of the tool on the way to this waypoint [m/s]."""
    angular_speed: PositiveFloat = 1.5
    """Angular speed on the way to this waypoint [rad/s]; the slower of the two decides."""
    stop: bool = False
    """Whether the tool comes to rest there."""
    dwell: float = Field(0.0, ge=0.0)
    """Time at rest [s] after a stop."""
    acceleration: PositiveFloat | None = None
    """Acceleration [m/s^2] in its corner, or to and from its stop; null: path.acceleration."""


class RehearsalConfig(Table):
    """A whole-arm rehearsal."""

    description: str
    """What it is, for reports."""
    tool: Literal["spoon", "scoop", "bottle", "shovel"]
    """Name of a tool of models/tools."""
    material: str
    """Name of a material of configs/materials, or the path of a .yaml file."""
    grasp: Grip
    """weld: fixed in the hand; friction: held by the fingers alone."""
    tool_container: list[Literal["contact", "sdf"]] = ["contact", "sdf"]  # noqa: RUF012
    """How tool and containers interact; contact: by MuJoCo's contacts, with force; sdf: by counting container points
    inside the tool's signed distance."""
    host_dt: float = Field(gt=0.0, le=1e-3)
    """MuJoCo step [s]."""
    coupling: Literal["one_way", "lagged", "mobility"] = "mobility"
    """one_way: grains exert no force on the arm; lagged: that of the step before; mobility: solved together with the
    arm's motion within the step."""
    collision_thickness: PositiveFloat
    """Thickness [m] of the tool's wall in the field, grown outward so that the bowl's volume stays."""
    grasp_time: PositiveFloat
    """Time [s] for the fingers to close before the arm moves."""
    containers: dict[str, ContainerConfig] = {}  # noqa: RUF012
    """By their names in models/containers: a filled one gives the material, an empty one takes it."""
    pile: RegionConfig | None = None
    """Material on the table instead of in a container, before it settles."""
    tool_fill_height: PositiveFloat | None = None
    """Material in the tool instead: filled up to this height [m] above the bottom of its inside."""
    area: RegionConfig | None = None
    """Where the material is to be delivered, if not into a container."""
    field: FieldConfig
    limits: LimitsConfig
    servo: ServoConfig
    path: PathConfig
    waypoints: Annotated[tuple[WaypointConfig, ...], Field(min_length=2)]
    """Poses of the tool, in order."""
    weigh_at: str | None = None
    """Waypoint with a dwell at which the load is weighed with the wrist sensor and counts as scooped; null: the tool
    holds nothing, all the material counts."""
    least_load: float = Field(0.0, ge=0.0)
    """Mass [kg] that counts as a full tool."""
    trajectory: Literal["script", "learned"] = "script"
    """script: the waypoints; learned: the learned motions of the sub-tasks in `learned`."""
    learned: tuple[str, ...] = ()
    """Sub-tasks whose learned motions follow each other."""
    motions: str | None = None
    """Folder with a motion of each of these as TASK.npz; null: the bundled motions."""

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
