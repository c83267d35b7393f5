"""Shapes of the bundled tools and containers as closed meshes, made from curves.

Imports: errors, mpm.
"""

from robosim.errors import UnknownName
from robosim.shapes.sheet_tools import SCOOP, SHOVEL
from robosim.shapes.tool import ToolShape
from robosim.shapes.vessels import BOTTLE, SPOON

TOOLS = {shape.name: shape for shape in (SPOON, SCOOP, BOTTLE, SHOVEL)}
"""Name -> shape of each bundled tool."""


def tool_shape(name: str) -> ToolShape:
    """Return the shape of a bundled tool; raises UnknownName."""
    if name not in TOOLS:
        raise UnknownName("tool", name, TOOLS)
    return TOOLS[name]
