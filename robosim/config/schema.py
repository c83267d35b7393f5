"""Configurations: frozen, typed, checked once, before any work."""

from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

import pydantic
import yaml
from pydantic import BaseModel, ConfigDict, Field, NonNegativeFloat, PositiveFloat

import mpm
from robosim.config.resources import config_path, container_names
from robosim.errors import ConfigError

Vector3 = tuple[float, float, float]
Grip = Literal["weld", "friction"]
Vector7 = Annotated[tuple[PositiveFloat, ...], Field(min_length=7, max_length=7)]


class Table(BaseModel):
    """Base of all configuration tables."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, use_attribute_docstrings=True)


class Quantity(Table):
    """A number with its unit and where it is from."""

    value: float
    unit: str
    """As the law has it: kg/m^3, Pa, Pa s, deg, 1."""
    source: str
    """Literature, or "assumed: ..." with the reason."""


Kind = TypeVar("Kind", bound=Table)


class RegionConfig(Table):
    """A region of the world: a box, or an upright cylinder."""

    centre: Vector3
    """[m]"""
    half: Vector3
    """Half sizes [m]."""
    round: bool = False
    """Whether it is an upright cylinder."""

    @property
    def region(self) -> mpm.Region:
        return mpm.Region(self.centre, self.half, self.round)


class ContainerConfig(Table):
    """A container of models/containers."""

    position: Vector3
    """Centre of the inner floor [m]."""
    yaw_deg: float = 0.0
    """About the vertical."""
    fill_height: float = Field(0.0, ge=0.0)
    """Height of the material in it at the start [m]."""


class FieldConfig(Table):
    """The grains' numerics."""

    cell: PositiveFloat
    """[m]"""
    grains_per_cell: PositiveFloat
    """Where they are packed as at the start."""
    tool_friction: float = Field(ge=0.0)
    """Coefficient between grains and tool."""
    container_friction: float = Field(ge=0.0)
    """Between grains and containers."""
    floor_friction: float = Field(ge=0.0)
    """Between grains and table."""
    region_lower: Vector3
    """Corner of the region that the material can reach [m]."""
    region_upper: Vector3
    """The corner opposite [m]."""
    dt: PositiveFloat | None = None
    """Substep [s]; null: from the stability bound."""
    transfer_interval: NonNegativeFloat | Literal["strides"] | None = "strides"
    """Longest time [s] that velocities stay on the grid, 0: a substep. "strides": the solver's own, also where
    contact moves the tool, because the step of 2 ms is known: a spoon lifts a fifth too little without."""


class LimitsConfig(Table):
    """Joint limits of the smoothed motion; speeds are the data sheet's, scaled."""

    velocity_fraction: float = Field(gt=0.0, le=1.0)
    """Share of the data sheet's speeds."""
    acceleration: Vector7
    """[rad/s^2]"""
    jerk: Vector7
    """[rad/s^3]"""


class ServoConfig(Table):
    """Impedance servo of the joints."""

    stiffness: Vector7
    """[N m/rad]"""
    damping: Vector7
    """[N m s/rad]"""


class PathConfig(Table):
    """How the tool rounds the corners between waypoints."""

    acceleration: PositiveFloat
    """[m/s^2]"""
    angular_acceleration: PositiveFloat
    """[rad/s^2]"""
    corner_tolerance: PositiveFloat = 1.5e-3
    """Largest distance [m] between the smoothed path and the commanded screws inside a container."""


class RobotConfig(Table):
    """How the arm carries a tool that is commanded step by step."""

    description: str
    """What it is."""
    limits: LimitsConfig
    servo: ServoConfig
    grasp_time: PositiveFloat
    """Time [s] for the fingers to close before an episode."""


class WaypointConfig(Table):
    """A pose of the tool, reached along a screw from the one before."""

    name: str
    """What reports and errors call it."""
    frame: str
    """"world" or a container: where position and rotation are given."""
    position: Vector3
    """Of the tool's frame [m]."""
    rotation_deg: Vector3 = (0.0, 0.0, 0.0)
    """Rotations about the frame's x, then y, then z axis [deg]."""
    speed: PositiveFloat
    """[m/s] on the way to this waypoint."""
    angular_speed: PositiveFloat = 1.5
    """[rad/s] on the way to this waypoint; the slower of the two decides."""
    stop: bool = False
    """Whether the tool comes to rest there."""
    dwell: float = Field(0.0, ge=0.0)
    """Time at rest [s] after a stop."""
    acceleration: PositiveFloat | None = None
    """[m/s^2] with which its corner is taken, or the stop left and reached; null: path.acceleration."""


class RehearsalConfig(Table):
    """A whole-arm rehearsal."""

    description: str
    """What it is, for reports."""
    tool: Literal["spoon", "scoop", "bottle", "shovel"]
    material: str
    """Of configs/materials, or a .yaml file."""
    grasp: Grip
    """Fixed in the hand, or held by the fingers alone."""
    tool_container: list[Literal["contact", "sdf"]] = ["contact", "sdf"]
    """How tool and containers meet: as MuJoCo's contacts, with force; as container particles in the tool's signed
    distance, counted."""
    host_dt: float = Field(gt=0.0, le=1e-3)
    """MuJoCo step [s]."""
    coupling: Literal["one_way", "lagged", "mobility"] = "mobility"
    """Grains push nothing back; with the forces of the step before; with the arm's answer within the step."""
    collision_thickness: PositiveFloat
    """Thickness [m] of the tool's wall as the grains see it, grown outward with the bowl's volume kept."""
    grasp_time: PositiveFloat
    """Time [s] for the fingers to close before the arm moves."""
    containers: dict[str, ContainerConfig] = {}  # noqa: RUF012
    """By the names of models/containers: one that is empty takes the material, one that is filled gives it."""
    pile: RegionConfig | None = None
    """Material on the table instead, before it settles."""
    tool_fill_height: PositiveFloat | None = None
    """Material in the tool instead: up to this height [m] above the bottom of its inside."""
    area: RegionConfig | None = None
    """Where the material shall go, if not into a container."""
    field: FieldConfig
    limits: LimitsConfig
    servo: ServoConfig
    path: PathConfig
    waypoints: Annotated[tuple[WaypointConfig, ...], Field(min_length=2)]
    """The tool's way, from the first on."""
    weigh_at: str | None = None
    """Waypoint with a dwell at which the load is weighed with the wrist sensor: it counts as scooped there. None: no
    tool that holds, all the material counts."""
    least_load: float = Field(0.0, ge=0.0)
    """Mass [kg] that counts as a full tool."""
    trajectory: Literal["script", "learned"] = "script"
    """The waypoints, or the motions that were learnt for `learned`."""
    learned: tuple[str, ...] = ()
    """Sub-tasks whose learnt motions follow on each other."""
    motions: str | None = None
    """Folder with a motion of each of these as TASK.npz; null: those that ship."""

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
        known = container_names()
        for name in self.containers:
            if name not in known:
                raise ValueError(f"containers: unknown {name!r}; valid: {', '.join(known)}")
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
                             f"{self.field.cell} m; accepted: 0.5 to 1 (thinner leaks, thicker is no {self.tool})")
        if self.field.dt is not None and abs(self.host_dt / self.field.dt - round(self.host_dt / self.field.dt)) > 1e-6:
            raise ValueError(f"field.dt = {self.field.dt} s divides host_dt = {self.host_dt} s "
                             f"{self.host_dt / self.field.dt:.4f} times; accepted: a whole number")
        if not self.waypoints[0].stop or not self.waypoints[-1].stop:
            raise ValueError("waypoints: the first and the last need stop: true")
        return self


def read(path: Path) -> object:
    """What a YAML file holds; raises ConfigError for one that cannot be read."""
    try:
        return yaml.safe_load(path.read_text())
    except (OSError, ValueError, yaml.YAMLError) as error:
        raise ConfigError(f"{path}: cannot be read as YAML: {error}") from error


def load(path: Path, kind: type[Kind], overrides: dict | None = None) -> Kind:
    """Read a YAML file into a configuration; raises ConfigError with file, key, value and what is accepted."""
    data = read(path)
    if not isinstance(data, dict):
        raise ConfigError(f"{path}: holds {type(data).__name__}; accepted: a table of {', '.join(kind.model_fields)}")
    try:
        return kind.model_validate(data | (overrides or {}))
    except pydantic.ValidationError as error:
        raise ConfigError(f"{path}: " + "; ".join(_describe(e, kind) for e in error.errors())) from None


def _describe(error: Any, kind: type[Table]) -> str:
    """One pydantic error in a line: key, value, reason, and the keys that the table knows."""
    place = ".".join(str(part) for part in error["loc"])
    if error["type"] == "extra_forbidden":
        table: object = kind
        for part in error["loc"][:-1]:
            table = _child(table, part)
        known = ", ".join(table.model_fields) if isinstance(table, type) and issubclass(table, Table) else "none"
        return f"unknown key {place!r}; valid: {known}"
    given = "" if error["type"] in ("missing", "value_error") else f" (given: {error['input']!r})"
    return f"{place or 'file'}: {error['msg']}{given}"


def _child(table: object, part: int | str) -> object:
    """Table class of a key, looking through containers of tables."""
    if isinstance(part, int) or not (isinstance(table, type) and issubclass(table, Table)):
        return table
    field = table.model_fields.get(part)
    pending = [field.annotation] if field else []
    while pending:
        candidate = pending.pop()
        if isinstance(candidate, type) and issubclass(candidate, Table):
            return candidate
        pending.extend(getattr(candidate, "__args__", ()))
    return table


def load_robot(name: str) -> RobotConfig:
    """Robot by name (configs/robots) or by path."""
    return load(config_path("robots", name, "robot"), RobotConfig)


def load_rehearsal(name: str, overrides: dict | None = None) -> RehearsalConfig:
    """Rehearsal by name (configs/rehearsals) or by path."""
    return load(config_path("rehearsals", name, "rehearsal"), RehearsalConfig, overrides)
