"""Shapes of tools and containers, from meshes or sizes.

Imports: base, config, mpm."""

from robosim.shapes.tool import ToolShape, tool_shape

__all__ = ["ToolShape", "tool_shape"]
