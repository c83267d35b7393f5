"""Shape of a tool: a head that contacts grains and, for most tools, a handle with a thick grip.

The handle is a bend, then a straight part up and back. Tool frame: x towards the tip, y lateral, z up; metres.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import trimesh
from numpy.typing import ArrayLike, NDArray

import mpm
from mpm.geometry.sampled_sdf import Lattice
from robosim.base.errors import ConfigError
from robosim.shapes.faces import find_lip, shell_behind
from robosim.shapes.lofts import compute_end_scale, smoothstep, space_stations, sweep

Array = NDArray[np.float64]

HANDLE_LENGTH = 0.200
"""Arc length of the axis of a handle."""
RISE = np.pi / 4
"""Slope [rad] of the straight part."""
BEND = 0.060
"""Radius of the curve between tool and straight part."""
GRIP_START = 0.095
"""Arc length at which the full grip radius is reached."""
GRIP_RADIUS = 0.011
GRIP_TO_END = 0.055
"""Distance of the grip from the rounded end, which the finger pads must not touch: they extend 49 mm to either side."""
DIRECTION: Array = np.array([-np.cos(RISE), 0.0, np.sin(RISE)])
"""Of the straight part, towards the end."""
WALL = 0.0015
"""Real wall thickness [m] of every tool."""


def sample_axis(s: ArrayLike, start: ArrayLike) -> Array:
    """Sample points (k, 3) [m] of the axis at arc lengths s (k,) [m].

    start (3,): where the axis begins [m].
    """
    s = np.atleast_1d(np.asarray(s, float))
    angle = np.minimum(s / BEND, RISE)
    straight = np.maximum(s - BEND * RISE, 0.0)
    x = -BEND * np.sin(angle) - straight * np.cos(RISE)
    z = BEND * (1.0 - np.cos(angle)) + straight * np.sin(RISE)
    return np.stack([x, np.zeros_like(s), z], axis=1) + np.asarray(start)


def compute_half_axes(s: ArrayLike) -> Array:
    """Compute the half axes (k, 2) [m] of the sections at arc lengths s (k,) [m].

    Lateral, upright.
    """
    s = np.asarray(s, float)
    root = np.array([0.0065, 0.0035])  # flatter at the weld, so that it does not rise above the rim
    thin = np.array([0.0050, 0.0050])
    near = root + (thin - root) * smoothstep(s / 0.030)[:, None]
    return near + (GRIP_RADIUS - near) * smoothstep((s - 0.045) / (GRIP_START - 0.045))[:, None]


def make_handle(start: ArrayLike, segments: int = 28) -> trimesh.Trimesh:
    """Make the handle from a weld at `start` (3,) [m] to its rounded end."""
    end = 0.007
    s = space_stations(HANDLE_LENGTH, 0.001, end, inner=30, cap=4)
    scale = compute_end_scale(s, 0.0, end)[:, None]
    scale[s < 0.001] *= 0.9  # a small chamfer at the weld
    return sweep(sample_axis(s, start), compute_half_axes(s) * scale, segments=segments)


def compute_grip_pose(start: ArrayLike) -> Array:
    """Compute the pose (4, 4) of the grip frame in the tool frame.

    z runs along the handle towards the tool, y along the hand's approach (tool -y), and x = y x z points up
    and forward, to the side of the thumb.
    """
    z = -DIRECTION
    y = np.array([0.0, -1.0, 0.0])
    pose = np.eye(4)
    pose[:3, :3] = np.stack([np.cross(y, z), y, z], axis=1)
    pose[:3, 3] = sample_axis(HANDLE_LENGTH - GRIP_TO_END, start)[0]
    return pose


class Holes(NamedTuple):
    """Equal holes in the inner face of a tool's head, smaller than the cells of its field."""

    positions: tuple[tuple[float, float, float], ...]
    """Their centres [m]."""
    axis: tuple[float, float, float]
    """Direction in which they let grains out."""
    diameter: float
    """[m]"""


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
    face: Callable[[], trimesh.Trimesh] | None = None
    """The head's inner face, with its normals into what it holds; None: the head holds nothing."""
    holes: Holes | None = None
    """Holes of that face; only a head in the field as a shell has them."""

    def solid(self, wall: float = WALL) -> list[trimesh.Trimesh]:
        """Make all parts as closed meshes, the head with a wall thickness [m]."""
        return [self.head(wall)] + ([make_handle(self.handle_start)] if self.handle_start else [])

    def distance(self, wall: float, spacing: float) -> Lattice:
        """Return the signed distance of all parts, the head with a wall of `wall` [m] that is grown outward."""
        return mpm.Sdf.from_mesh(self.solid(wall), spacing=spacing)

    def head_distance(self, wall: float, spacing: float) -> Lattice:
        """Return the signed distance of the head alone, with a wall of `wall` [m] that is grown outward."""
        return mpm.Sdf.from_mesh(self.head(wall), spacing=spacing)

    def head_shell(self) -> mpm.Shell:
        """Return the head alone as a thin shell of its real wall; raises ConfigError for a head without a hollow."""
        if self.face is None:
            raise ConfigError(f"tool {self.name!r} holds nothing, so that it has no inner face for a shell; accepted: "
                              f"a wall thickness in metres")
        return shell_behind(self.face(), WALL)

    @property
    def capacity(self) -> float:
        """Volume [m^3] that it holds level with its rim: the convex hull of its inner face.

        Without an inner face: the region in which grains count.
        """
        if self.face is not None:
            return float(self.face().convex_hull.volume)
        return float(8.0 * np.prod(self.interior.half)) * (0.25 * np.pi if self.interior.round else 1.0)

    def lip(self) -> Array | None:
        """Return the place [m] (3,) where what the tool pours leaves it; None where that is not known.

        It is on the rim of its inner face, or in the middle of its holes.
        """
        if self.holes is not None:
            return np.mean(self.holes.positions, axis=0)
        place = None if self.face is None else find_lip(self.face)
        return None if place is None else np.array(place)

    def orifices(self, grain_diameter: float) -> list[mpm.Orifice]:
        """Return the holes of the head as orifices of its shell, for grains of a diameter [m]."""
        if self.holes is None:
            return []
        return [mpm.Orifice(np.array(self.holes.positions), np.array(self.holes.axis), diameter=self.holes.diameter,
                            grain_diameter=grain_diameter)]

    def real_distance(self, spacing: float) -> Lattice:
        """Return the signed distance of all parts with their real wall."""
        return self.distance(WALL, spacing)

    def head_vertices(self) -> Array:
        """Return the vertices (n, 3) of the head with its real wall."""
        return self.head(WALL).vertices

    def visuals(self) -> dict[str, trimesh.Trimesh]:
        """Make the parts with their real wall, by the names of their files."""
        return dict(zip((self.name, "handle"), self.solid()))
