"""Shapes of the bundled tools and containers as closed meshes, made from curves.

Imports: errors, mpm.
"""

from robosim.errors import UnknownName
from robosim.shapes import bottle, scoop, shovel, spoon
from robosim.shapes.tool import ToolShape

TOOLS = {module.__name__.rsplit(".")[-1]: module.SHAPE for module in (spoon, scoop, bottle, shovel)}
"""Name -> shape of each bundled tool."""


def tool_shape(name: str) -> ToolShape:
    """Return the shape of a bundled tool; raises UnknownName."""
    if name not in TOOLS:
        raise UnknownName("tool", name, TOOLS)
    return TOOLS[name]
