"""Shapes of bundled tools and containers: curves to closed meshes.

Imports: errors, mpm.
"""


from robosim.errors import UnknownName
from robosim.shapes import bottle, scoop, shovel, spoon
from robosim.shapes.tool import ToolShape

TOOLS = {module.__name__.rsplit(".")[-1]: module.SHAPE for module in (spoon, scoop, bottle, shovel)}


def tool_shape(name: str) -> ToolShape:
    """A tool's shape; raises UnknownName."""
    if name not in TOOLS:
        raise UnknownName("tool", name, TOOLS)
    return TOOLS[name]
