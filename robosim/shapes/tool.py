"""The shape of a tool: a head that contacts grains and, for most tools, a handle."""

from collections.abc import Callable
from dataclasses import dataclass

import trimesh

import mpm
from robosim.shapes.handle import make_handle

WALL = 0.0015
"""Real wall thickness [m] of every tool."""


@dataclass(frozen=True)
class ToolShape:
    """Shape of one tool, in its own frame; lengths in metres."""

    name: str
    head: Callable[[float], trimesh.Trimesh]
    """Wall thickness [m], grown outward -> the part that holds or pushes grains, as a closed mesh."""
    interior: mpm.Region
    """Region in which grains count as in the tool."""
    handle_start: tuple[float, float, float] | None = None
    """Start of the handle [m]; None: no handle."""

    def solid(self, wall: float = WALL) -> list[trimesh.Trimesh]:
        """Make all parts as closed meshes, the head with a wall thickness [m]."""
        return [self.head(wall)] + ([make_handle(self.handle_start)] if self.handle_start else [])

    def visuals(self) -> dict[str, trimesh.Trimesh]:
        """Make the parts with their real wall, by the names of their files."""
        return dict(zip((self.name, "handle"), self.solid()))
