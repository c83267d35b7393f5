"""Configuration of a scene's places and of the grains' numerics."""

from typing import Literal

from pydantic import Field, NonNegativeFloat, PositiveFloat

import mpm
from robosim.config.table import Table, Vector3


class RegionConfig(Table):
    """A region of the world: a box, or an upright cylinder."""

    centre: Vector3
    """Centre [m]."""
    half: Vector3
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
    yaw_deg: float = 0.0
    """Rotation about the vertical [deg]."""
    fill_height: float = Field(0.0, ge=0.0)
    """Height of the material in it at the start [m]."""


class FieldConfig(Table):
    """Numerics of the grains."""

    cell: PositiveFloat
    """Edge of a grid cell [m]."""
    grains_per_cell: PositiveFloat
    """Number of grains in a filled cell at the start."""
    tool_friction: float = Field(ge=0.0)
    """Friction coefficient between grains and tool."""
    container_friction: float = Field(ge=0.0)
    """Friction coefficient between grains and containers."""
    floor_friction: float = Field(ge=0.0)
    """Friction coefficient between grains and table."""
    region_lower: Vector3
    """Lower corner of the region that the material can reach [m]."""
    region_upper: Vector3
    """Upper corner of that region [m]."""
    dt: PositiveFloat | None = None
    """Substep [s]; null: from the stability bound."""
    transfer_interval: NonNegativeFloat | Literal["strides"] | None = "strides"
    """Longest stride [s]: time between two transfers of velocities to the particles; 0: a transfer in every substep;
    "strides": chosen from the bound of the time step."""
