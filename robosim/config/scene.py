"""Configuration of a scene's places and of the grains' numerics."""

from typing import Annotated, Literal

import numpy as np
from pydantic import Field
from scipy.spatial.transform import Rotation

import mpm
from robosim.base.errors import ConfigError
from robosim.config import bounds
from robosim.config.table import Placement, Table, Vector3


class RegionConfig(Table):
    """A region of the world: a box, or an upright cylinder."""

    centre: tuple[bounds.FarCoordinate, bounds.FarCoordinate, bounds.FarCoordinate]
    """Centre [m]."""
    half: tuple[bounds.HalfSize, bounds.HalfSize, bounds.HalfSize]
    """Half sizes [m]."""
    round: bool = False
    """Whether it is an upright cylinder."""

    @property
    def region(self) -> "mpm.Region":
        """The same for the field."""
        return mpm.Region(self.centre, self.half, self.round)


class ContainerConfig(Table):
    """A container: of models/containers, or from inner sizes, or from a mesh."""

    position: Vector3
    """Centre of the inner floor [m]; of a mesh, its origin."""
    yaw_deg: bounds.Angle = 0.0
    """Rotation about the vertical [deg]."""
    tilt_deg: tuple[bounds.Angle, bounds.Angle] = (0.0, 0.0)
    """Rotations about its x, then its y axis [deg], before the yaw."""
    fill_height: bounds.Height = 0.0
    """Height of the material in it at the start [m], along its own z axis."""
    model: bounds.Name | None = None
    """Name in models/containers; null: the container's own name, unless there are sizes or a mesh."""
    size: tuple[bounds.Length, bounds.Length, bounds.Length] | None = None
    """Inner length, width and height [m] of a box."""
    radius: bounds.Length | None = None
    """Inner radius [m] of a round container."""
    height: bounds.Length | None = None
    """Its inner height [m]."""
    wall: Annotated[float, Field(ge=5e-4, le=0.1)] = 0.006
    """Thickness [m] of walls and floor that are given by sizes."""
    mesh: bounds.FilePath | None = None
    """Path of a closed mesh, or of a surface with a thickness, z up; STL, OBJ, PLY or GLB."""
    scale: Annotated[float, Field(ge=1e-6, le=1e3)] = 1.0
    """Metres per unit of the mesh: 0.001 for millimetres."""
    thickness: bounds.Length | None = None
    """Thickness [m] of the wall whose middle the mesh is; null: the mesh is closed."""

    def check(self) -> None:
        if (self.radius is None) != (self.height is None):
            raise ValueError(f"radius = {self.radius}, height = {self.height}; accepted: both, or none of them")
        given = [name for name in ("model", "size", "radius", "mesh") if getattr(self, name) is not None]
        if len(given) > 1:
            raise ValueError(f"{' and '.join(given)} are given; accepted: one of model, size, radius with height, mesh")
        if self.mesh is None and (self.scale != 1.0 or self.thickness is not None):
            raise ValueError("scale or thickness without a mesh; accepted: wall, for a container from sizes")

    @property
    def pose(self) -> mpm.Pose:
        """World pose of its frame, whose origin is the centre of the inner floor, or that of its mesh."""
        rotation = Rotation.from_euler("z", self.yaw_deg, degrees=True)
        if any(self.tilt_deg):
            rotation = rotation * Rotation.from_euler("xy", self.tilt_deg, degrees=True)
        return mpm.Pose(np.asarray(self.position), rotation.as_quat(scalar_first=True))

    @property
    def is_named(self) -> bool:
        """Whether it is a container of models/containers."""
        return self.size is None and self.radius is None and self.mesh is None


class ObstacleConfig(Placement):
    """A box, or an upright cylinder, that stands in the way."""

    name: bounds.Name
    """Its name in errors and reports."""
    position: Vector3 = Field(...)
    """Centre [m]."""
    half: tuple[bounds.HalfSize, bounds.HalfSize, bounds.HalfSize]
    """Half sizes [m]; of a cylinder the first is the radius."""
    round: bool = False
    """Whether it is a cylinder along its z axis."""


class FieldConfig(Table):
    """Numerics of the grains."""

    cell: bounds.Length = 0.004
    """Edge of a grid cell [m]."""
    grains_per_cell: bounds.GrainsPerCell = 2.0
    """Number of grains in a filled cell at the start."""
    tool_friction: bounds.Friction = 0.1
    """Friction coefficient between grains and tool; the default is that of polished steel."""
    container_friction: bounds.Friction = 0.5
    """Friction coefficient between grains and containers."""
    floor_friction: bounds.Friction = 0.5
    """Friction coefficient between grains and table."""
    region_lower: Vector3 | None = None
    """Lower corner of the region that the material can reach [m]; null: around a rehearsal's places and motion."""
    region_upper: Vector3 | None = None
    """Upper corner of that region [m]."""
    dt: bounds.TimeStep | None = None
    """Substep [s]; null: from the stability bound, up to 2 % longer where a step then takes one less."""
    transfer_interval: Annotated[float, Field(ge=0.0, le=0.1)] | Literal["strides"] | None = "strides"
    """Longest stride [s]: time between two transfers of velocities to the particles; 0: a transfer in every substep;
    "strides": chosen from the bound of the time step."""

    sleep: bool | Annotated[float, Field(gt=0.0, le=100.0)] | None = None
    """Whether grains at rest fall asleep and cost nothing; a number is a factor on the thresholds; null: true in a
    rehearsal on a CPU, false in an environment and on a GPU."""

    @property
    def grid(self) -> "mpm.Grid":
        """The grid of the region; raises ConfigError where the region is left open."""
        if self.region_lower is None or self.region_upper is None:
            raise ConfigError("field.region_lower, region_upper: missing; accepted: the corners of the region")
        return mpm.Grid(self.region_lower, self.region_upper, self.cell)

    def check(self) -> None:
        if (self.region_lower is None) != (self.region_upper is None):
            raise ValueError(f"region_lower = {self.region_lower}, region_upper = {self.region_upper}; accepted: both, "
                             f"or none of them")
        if self.region_lower is None:
            return
        nodes = int(np.prod(self.grid.shape, dtype=float))
        if nodes > bounds.MAX_NODES:
            raise ValueError(f"region_lower {self.region_lower} to region_upper {self.region_upper} m with cell = "
                             f"{self.cell} m: {nodes:.3g} grid nodes; accepted: up to {bounds.MAX_NODES:.3g}; make the "
                             f"region smaller, or the cell larger")
