"""Configuration of a tool, bundled or of one's own: meshes and what they do not say."""

from functools import lru_cache
from typing import Annotated, Any, Literal

import pydantic
from pydantic import Field

from mpm.errors import say_unknown
from robosim.base.resources import part_names, part_path
from robosim.config.bounds import MAX_ENTRIES, FilePath, Intensity, Length
from robosim.config.scene import RegionConfig
from robosim.config.table import Table, Vector3, load

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
HEAD = 2
"""Bit of `contype` of tools' heads; `conaffinity` has it in all that they meet."""


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
    mesh: FilePath | None = None
    """Path of the handle's own mesh, closed, in the frame and unit of the tool's; null: it is part of the tool's."""
    mass: ToolMass | None = None
    """Of that mesh [kg]; the tool's mass is then that of its head."""
    density: Density | None = None
    """Instead of mass [kg/m^3]."""

    def check(self) -> None:
        given = [name for name in ("mass", "density") if getattr(self, name) is not None]
        if len(given) != (self.mesh is not None):
            raise ValueError(f"handle: mesh = {self.mesh}, mass = {self.mass}, density = {self.density}; accepted: a "
                             f"mesh with one of the two, or none of the three")


class HolesConfig(Table):
    """Equal holes of a tool's head, smaller than the cells of its field: grains leave by Beverloo's law."""

    positions: Annotated[tuple[Vector3, ...], Field(min_length=1, max_length=MAX_ENTRIES)]
    """Their centres [m], on the surface of the shell, which is closed there."""
    axis: Vector3
    """Direction in which they let grains out."""
    diameter: Length
    """[m]"""

    def check(self) -> None:
        if not any(self.axis):
            raise ValueError(f"axis = {self.axis}; accepted: the direction in which the holes let grains out")


class ToolConfig(Table):
    """A tool from meshes, STL, OBJ, PLY or GLB, z up while it is level."""

    name: BodyName = "tool"
    mesh: FilePath
    """Path of a closed mesh, or of a surface with a thickness."""
    scale: Scale = 1.0
    """Metres per unit of the mesh: 0.001 for millimetres."""
    thickness: Length | None = None
    """Thickness [m] of the head's wall. The mesh is the middle of that wall, unless it is closed and `inner_face` or
    `thicken: normals` is given; null: it is a solid."""
    inner_face: FilePath | None = None
    """Path of the inner face of a closed mesh, an open surface. As a thin shell the head is the wall behind it, and its
    rim has the lip."""
    thicken: Literal["outward", "normals"] = "outward"
    """How the wall gets as thick as the grains' cells need it: outward from what the head holds, which is found; or
    along the vertex normals of the mesh's file, in proportion to their length, which is zero where a vertex stays."""
    lip: Vector3 | None = None
    """Place of the pouring edge [m], in the mesh's frame; null: the middle of the holes, or the foremost place along x
    of the rim of an open mesh or of the inner face."""
    holes: HolesConfig | None = None
    """Small holes of the head, which only a thin shell has."""
    model: FilePath | None = None
    """Path of an MJCF file with the tool's body, called as the tool, and a site <name>_grip; null: the body is made
    from mesh, mass and handle."""
    mass: ToolMass | None = None
    """[kg]"""
    density: Density | None = None
    """Instead of mass [kg/m^3]."""
    handle: HandleConfig
    """Line in the middle of the straight part that a hand holds; of a loop, of its straight grip."""
    inside: RegionConfig | None = None
    """Where grains count as in the tool, in the mesh's frame; null: where it holds water while it is level, and a heap
    above it."""
    colour: Colour = STEEL
    """Red, green and blue."""

    def check(self) -> None:
        if (self.mass is None) == (self.density is None):
            raise ValueError(f"mass = {self.mass}, density = {self.density}; accepted: one of the two")
        given = [key for key, value in (("inner_face", self.inner_face), ("holes", self.holes),
                                        ("thicken: normals", self.thicken == "normals")) if value]
        if given and self.thickness is None:
            raise ValueError(f"{' and '.join(given)} without thickness; accepted: the thickness of the wall in metres")

    @property
    def is_closed(self) -> bool:
        """Whether the mesh has to be closed: it is no mid-surface."""
        return self.thickness is None or self.inner_face is not None or self.thicken == "normals"


def read_tool_file(given: Any) -> Any:
    """Return the table of a tool's .yaml file, anything else as it is; raises ConfigError, ValueError."""
    if not isinstance(given, str) or not given.endswith((".yaml", ".yml")):
        return given
    return load(part_path("tools", given, "tool"), ToolConfig)


def check_tool(tool: str | ToolConfig) -> str | ToolConfig:
    """Return a tool; raises ValueError for a name that models/tools does not have."""
    if isinstance(tool, str) and tool not in (names := part_names("tools")):
        raise ValueError(say_unknown("tool", tool, names, "or the path of a .yaml file of your own"))
    return tool


def name_tool(tool: str | ToolConfig) -> str:
    """Return the name of a tool's body."""
    return tool if isinstance(tool, str) else tool.name


@lru_cache
def load_bundled(name: str) -> ToolConfig:
    """Load the configuration of a tool of models/tools; raises UnknownName."""
    return load(part_path("tools", name, "tool"), ToolConfig)


Tool = Annotated[FilePath | ToolConfig, pydantic.BeforeValidator(read_tool_file), pydantic.AfterValidator(check_tool)]
"""A tool by name, file or table."""
