"""Shapes of tools and containers: one source for the pictures, the signed distances and the counting of grains."""

from importlib import import_module

from robosim.errors import UnknownName
from robosim.shapes.tool import ToolShape

TOOLS = ("spoon", "scoop", "bottle", "shovel")


def tool_shape(name: str) -> ToolShape:
    """A tool's shape, from the module of its name; raises UnknownName."""
    if name not in TOOLS:
        raise UnknownName("tool", name, TOOLS)
    return import_module(f"robosim.shapes.{name}").SHAPE
