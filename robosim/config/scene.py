"""Configuration of a scene's places and of the grains' numerics."""

from typing import Annotated, Literal

import numpy as np
import pydantic
from pydantic import Field

import mpm
from robosim.config.bounds import MAX_NODES, Angle, Friction, GrainsPerCell, HalfSize, Height, Length, TimeStep
from robosim.config.table import Table, Vector3


class RegionConfig(Table):
    """A region of the world: a box, or an upright cylinder."""

    centre: Vector3
    """Centre [m]."""
    half: tuple[HalfSize, HalfSize, HalfSize]
    """Half sizes [m]."""
    round: bool = False
    """Whether it is an upright cylinder."""

    @property
    def region(self) -> "mpm.Region":
        """The same for the field."""
        return mpm.Region(self.centre, self.half, self.round)


class ContainerConfig(Table):
    """A container of models/containers."""

    position: Vector3
    """Centre of the inner floor [m]."""
    yaw_deg: Angle = 0.0
    """Rotation about the vertical [deg]."""
    fill_height: Height = 0.0
    """Height of the material in it at the start [m]."""


class FieldConfig(Table):
    """Numerics of the grains."""

    cell: Length
    """Edge of a grid cell [m]."""
    grains_per_cell: GrainsPerCell
    """Number of grains in a filled cell at the start."""
    tool_friction: Friction
    """Friction coefficient between grains and tool."""
    container_friction: Friction
    """Friction coefficient between grains and containers."""
    floor_friction: Friction
    """Friction coefficient between grains and table."""
    region_lower: Vector3
    """Lower corner of the region that the material can reach [m]."""
    region_upper: Vector3
    """Upper corner of that region [m]."""
    dt: TimeStep | None = None
    """Substep [s]; null: from the stability bound."""
    transfer_interval: Annotated[float, Field(ge=0.0, le=0.1)] | Literal["strides"] | None = "strides"
    """Longest stride [s]: time between two transfers of velocities to the particles; 0: a transfer in every substep;
    "strides": chosen from the bound of the time step."""

    sleep: bool | Annotated[float, Field(gt=0.0, le=100.0)] | None = None
    """Whether grains at rest fall asleep and cost nothing; a number is a factor on the thresholds; null: true in a
    rehearsal on a CPU, false in an environment and on a GPU."""

    @pydantic.model_validator(mode="after")
    def _check_size(self) -> "FieldConfig":
        nodes = int(np.prod(mpm.Grid(self.region_lower, self.region_upper, self.cell).shape, dtype=float))
        if nodes > MAX_NODES:
            raise ValueError(f"region_lower {self.region_lower} to region_upper {self.region_upper} m with cell = "
                             f"{self.cell} m: {nodes:.3g} grid nodes; accepted: up to {MAX_NODES:.3g}; make the region "
                             f"smaller, or the cell larger")
        return self
