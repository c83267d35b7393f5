"""Configuration of a tool of one's own, from a mesh."""

from typing import Annotated

import pydantic
from pydantic import Field

from robosim.config.bounds import FilePath, Intensity, Length
from robosim.config.scene import RegionConfig
from robosim.config.table import Table, Vector3

Scale = Annotated[float, Field(ge=1e-6, le=1e3)]
"""Of a mesh's unit in metres."""
ToolMass = Annotated[float, Field(ge=1e-3, le=100.0)]
"""[kg]"""
Density = Annotated[float, Field(ge=10.0, le=25_000.0)]
"""[kg/m^3], from foam to platinum."""
BodyName = Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_]*$", max_length=40)]
"""Of a body in the scene, and of files."""
Colour = tuple[Intensity, Intensity, Intensity]
STEEL: Colour = (0.72, 0.74, 0.77)


class HandleConfig(Table):
    """The straight part of a tool that a hand holds, in the mesh's frame."""

    head: Vector3
    """End at the tool's head [m]."""
    end: Vector3
    """Free end [m]."""
    hold: Annotated[float, Field(ge=0.0, le=1.0)] = 0.5
    """Where the hand holds it: 0 at the head, 1 at the free end."""
    radius: Length | None = None
    """[m]; null: measured in the mesh."""
    approach: Vector3 = (0.0, -1.0, 0.0)
    """Direction from which the hand comes."""


class ToolConfig(Table):
    """A tool from a mesh, STL or OBJ, z up while it is level."""

    name: BodyName = "tool"
    mesh: FilePath
    """Path of a closed mesh, or of a surface with a thickness."""
    scale: Scale = 1.0
    """Metres per unit of the mesh: 0.001 for millimetres."""
    thickness: Length | None = None
    """Thickness [m] of the wall whose middle the mesh is; null: the mesh is closed, and a solid."""
    mass: ToolMass | None = None
    """[kg]"""
    density: Density | None = None
    """Instead of mass [kg/m^3]."""
    handle: HandleConfig
    inside: RegionConfig | None = None
    """Where grains count as in the tool, in the mesh's frame; null: where it holds water while it is level, and a heap
    above it."""
    colour: Colour = STEEL
    """Red, green and blue."""

    @pydantic.model_validator(mode="after")
    def _check_mass(self) -> "ToolConfig":
        if (self.mass is None) == (self.density is None):
            raise ValueError(f"mass = {self.mass}, density = {self.density}; accepted: one of the two")
        return self
