"""A scene of tool, containers and grains, as files of sub-tasks and of rehearsals describe it."""

from typing import Annotated, ClassVar, Literal

from pydantic import Field

from mpm.errors import say_unknown
from robosim.base.resources import folder
from robosim.config.bounds import MAX_ENTRIES, FilePath, Length, Name, Text
from robosim.config.scene import ContainerConfig, FieldConfig, RegionConfig
from robosim.config.table import Table
from robosim.config.tool import Tool, name_tool


class SceneConfig(Table):
    """What a scene consists of. Paths in the file are relative to it."""

    COMES_TO_REST: ClassVar[bool] = False
    """Whether its grains settle before they are used; otherwise they begin at rest, under their own weight."""
    HAS_HANDLE: ClassVar[bool] = True
    """Whether the grains touch the tool's handle, too, unless the tool is a shell."""

    description: Text
    """First line of its reports and pages."""
    tool: Tool
    """Name of a tool of models/tools, the path of a .yaml file of one's own, or a table with its keys."""
    material: FilePath = "salt"
    """Name of a material of configs/materials, or the path of a .yaml file."""
    containers: Annotated[dict[Name, ContainerConfig], Field(max_length=MAX_ENTRIES)] = {}  # noqa: RUF012
    """Containers by name: of models/containers, from sizes or from meshes. Filled ones are the sources of the material,
    empty ones take it."""
    pile: RegionConfig | None = None
    """Region of material on the table at the start, before it settles; instead of a filled container."""
    tool_fill_height: Length | None = None
    """Height [m] of material in the tool at the start, above its inner bottom; instead of a filled container. Where
    the number of grains is given, they lie in the tool unless a container or pile has them."""
    tool_wall: Length | Literal["shell"] | None = None
    """Wall thickness [m] of the tool in the simulation of the grains; thickened outward, the inner volume is kept.
    null: half a cell; shell: tool and empty containers are thin shells of their real walls, into which no heap sinks
    and which may stand free; the tool without its handle."""
    coupling: Literal["one_way", "lagged", "mobility"] = "mobility"
    """one_way: grains exert no force on the arm; lagged: their force acts one step later; mobility: contact and motion
    of the arm are solved together."""
    field: FieldConfig = FieldConfig()
    """Numerics of the grains."""

    @property
    def advance_dt(self) -> float:
        """Time [s] by which the grains advance at once."""
        raise NotImplementedError

    @property
    def grain_count(self) -> int | None:
        """Number of grains; None where it follows from `field.grains_per_cell`."""
        return None

    @property
    def sources(self) -> tuple[str, ...]:
        """The containers that are filled at the start."""
        return tuple(name for name, container in self.containers.items() if container.fill_height > 0)

    @property
    def sinks(self) -> tuple[str, ...]:
        """The containers that take the material."""
        return tuple(name for name, container in self.containers.items() if container.fill_height == 0)

    @property
    def shells(self) -> tuple[str, ...]:
        """The containers that are thin shells in the simulation of the grains."""
        return self.sinks if self.tool_wall == "shell" else ()

    @property
    def solid_wall(self) -> float:
        """Wall thickness [m] of the tool in the simulation of the grains; of a shell, by which it is filled."""
        return 0.5 * self.field.cell if self.tool_wall is None or self.tool_wall == "shell" else self.tool_wall

    @property
    def tool_name(self) -> str:
        """Name of the tool's body."""
        return name_tool(self.tool)

    def check(self) -> None:
        """Refuse a container that is not known, and one with the tool's name."""
        names = sorted(path.stem for path in (folder("models") / "containers").glob("*.xml"))
        for name, container in self.containers.items():
            if container.is_named and (container.model or name) not in names:
                also = "or a container with size, radius and height, or mesh"
                raise ValueError(f"containers: {say_unknown('model', container.model or name, names, also)}")
        if self.tool_name in self.containers:
            raise ValueError(f"containers: {self.tool_name!r} is the tool's name; accepted: another")
