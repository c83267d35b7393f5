"""A tool's shape: a head that meets grains and, where it has one, a handle."""

from collections.abc import Callable
from dataclasses import dataclass

import trimesh

import mpm
from robosim.shapes.handle import handle

WALL = 0.0015
"""Real wall [m] of every tool."""


@dataclass(frozen=True)
class ToolShape:
    """Shape of one tool, in its frame."""

    name: str
    head: Callable[[float], trimesh.Trimesh]
    """The part that holds or pushes grains, as a closed mesh with a wall thickness [m], grown outward."""
    interior: mpm.Region
    """Where grains count as held."""
    handle_start: tuple[float, float, float] | None = None
    """Where the handle is welded on [m]; None: no handle."""

    def solid(self, wall: float = WALL) -> list[trimesh.Trimesh]:
        """All parts."""
        return [self.head(wall)] + ([handle(self.handle_start)] if self.handle_start else [])

    def visuals(self) -> dict[str, trimesh.Trimesh]:
        """Parts by the names of their files."""
        return dict(zip((self.name, "handle"), self.solid()))
