"""Shapes of tools and containers: the bundled ones as closed meshes made from curves, and those of one's own files.

Imports: base, mpm.
"""

from robosim.base.errors import UnknownName
from robosim.shapes.mesh_tool import MeshTool, OwnTool, read_tool
from robosim.shapes.sheet_tools import SCOOP, SHOVEL
from robosim.shapes.tool import ToolShape
from robosim.shapes.vessels import BOTTLE, SHAKER, SPOON

TOOLS = {shape.name: shape for shape in (SPOON, SCOOP, BOTTLE, SHAKER, SHOVEL)}
"""Name -> shape of each bundled tool."""


def tool_shape(tool: str | OwnTool) -> ToolShape | MeshTool:
    """Return the shape of a bundled tool, or of one of one's own; raises UnknownName, ConfigError."""
    if not isinstance(tool, str):
        return read_tool(tool)
    if tool not in TOOLS:
        raise UnknownName("tool", tool, TOOLS, "or the path of a .yaml file of your own")
    return TOOLS[tool]
