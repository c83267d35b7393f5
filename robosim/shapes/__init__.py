"""Shapes of tools and containers: one source for the pictures, the signed distances and the counting of grains.

A tool's module has `solid(wall)`, its parts as closed meshes with a wall thickness [m]; `head(wall)`, the part that
holds or pushes grains; `visuals()`, its meshes by file name; `WALL`, its real wall [m]; and `INTERIOR`, where grains
count as held.
"""

from importlib import import_module
from types import ModuleType

from robosim.errors import UnknownName

TOOLS = ("spoon", "scoop", "bottle", "shovel")


def tool_shape(name: str) -> ModuleType:
    """The module of a tool's shape; raises UnknownName."""
    if name not in TOOLS:
        raise UnknownName("tool", name, TOOLS)
    return import_module(f"robosim.shapes.{name}")
