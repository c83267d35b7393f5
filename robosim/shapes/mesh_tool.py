"""A tool of one's own: a mesh with a handle and an inside, in place of a bundled shape."""

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import trimesh
from numpy.typing import NDArray

import mpm
from mpm.geometry.sampled_sdf import Lattice
from robosim.base.errors import ConfigError
from robosim.shapes.grown_wall import grow_outward, wall_at_inside
from robosim.shapes.inside import Inside, find_inside, given_inside
from robosim.shapes.mesh_files import join, read_parts

Array = NDArray[np.float64]

HEAP = 0.04
"""Height [m] above the water's level up to which grains count as on the tool."""
ASIDE = 3**0.5
"""By which the counting region is wider than what holds water: cohesive heaps overhang the rim."""
NEAR_HANDLE = 1.6
"""Radii of the handle within which a part of the mesh belongs to it and not to the head."""
UP = np.array([0.0, 0.0, 1.0])


class MeshFile(Protocol):
    """What is read of the configuration of something of one's own."""

    @property
    def mesh(self) -> str:
        """Path of the file."""
        ...

    @property
    def scale(self) -> float:
        """Metres per unit of the file."""
        ...

    @property
    def thickness(self) -> float | None:
        """Of the wall of open parts [m]; None: all are closed."""
        ...


class HandleLine(Protocol):
    """The line of a handle, by which a hand holds a tool."""

    @property
    def head(self) -> tuple[float, float, float]:
        """End at the tool's head [m]."""
        ...

    @property
    def end(self) -> tuple[float, float, float]:
        """Free end [m]."""
        ...

    @property
    def hold(self) -> float:
        """Where it is held: 0 at the head, 1 at the free end."""
        ...

    @property
    def radius(self) -> float | None:
        """[m]; None: measured."""
        ...

    @property
    def approach(self) -> tuple[float, float, float]:
        """Direction from which the hand comes."""
        ...

    @property
    def mesh(self) -> str | None:
        """Path of its own file; None: it is part of the tool's."""
        ...

    @property
    def mass(self) -> float | None:
        """[kg]; None: from the density."""
        ...

    @property
    def density(self) -> float | None:
        """[kg/m^3]"""
        ...


class OwnTool(MeshFile, Protocol):
    """Configuration of a tool of one's own, see `robosim.config.tool.ToolConfig`."""

    @property
    def name(self) -> str:
        """Of the body."""
        ...

    @property
    def mass(self) -> float | None:
        """[kg]; None: from the density."""
        ...

    @property
    def density(self) -> float | None:
        """[kg/m^3]"""
        ...

    @property
    def handle(self) -> HandleLine:
        """The line of its handle."""
        ...

    @property
    def colour(self) -> tuple[float, float, float]:
        """Red, green, blue."""
        ...

    @property
    def inside(self) -> Any:
        """With the region in which grains count; None: where it holds water."""
        ...


@dataclass(frozen=True, eq=False)
class MeshTool:
    """A tool from a mesh, in the mesh's frame: z up while the tool is level; lengths in metres."""

    name: str
    head: list[trimesh.Trimesh]
    """Its parts, closed, with the real wall; they may overlap. With the handle, unless that has a mesh of its own."""
    rod: list[trimesh.Trimesh]
    """Parts of the handle's own mesh, if there is one."""
    inside: Inside
    interior: mpm.Region
    """Region in which grains count as in the tool."""
    handle: tuple[Array, Array]
    """Its ends (3,): at the head, and the free one."""
    radius: float
    """Of the handle."""
    grip: Array
    """Pose (4, 4) of the grip: z along the handle towards the head, y along the hand's approach."""
    masses: tuple[float, float]
    """Of head and rod [kg]; 0 for a rod that is part of the head."""
    colour: tuple[float, float, float]

    @property
    def mesh(self) -> trimesh.Trimesh:
        """All parts as one mesh."""
        return join(self.head + self.rod)

    def distance(self, wall: float, spacing: float) -> Lattice:
        """Return the signed distance of the tool with its wall at least `wall` [m] thick, grown outward."""
        grown = wall - wall_at_inside(self.head, self.inside)
        return grow_outward(self.head + self.rod, self.inside, grown, spacing)

    def head_distance(self, wall: float, spacing: float) -> Lattice:
        """Return the same of the head alone, if the handle has a mesh of its own."""
        return grow_outward(self.head, self.inside, wall - wall_at_inside(self.head, self.inside), spacing)

    def head_shell(self) -> mpm.Shell:
        """Raise ConfigError: the walls of a mesh are closed, and a shell needs their inner face."""
        raise ConfigError(f"tool {self.name!r} is from a mesh, of whose faces none is known to be the inner one, which "
                          f"a shell needs; accepted: a wall thickness in metres, or a bundled tool")

    @property
    def capacity(self) -> float:
        """Volume [m^3] that it holds level with its rim."""
        return self.inside.volume

    @property
    def holes(self) -> None:
        """None: the holes of a mesh are as it has them."""
        return None

    def lip(self) -> None:
        """None: which edge of a mesh it pours over is not known."""
        return None

    def orifices(self, grain_diameter: float) -> list[mpm.Orifice]:
        """Return no orifices."""
        return []

    def real_distance(self, spacing: float) -> Lattice:
        """Return the signed distance of the tool with its real wall."""
        return mpm.Sdf.from_mesh(self.head + self.rod, spacing=spacing)

    def head_vertices(self) -> Array:
        """Return the vertices (n, 3) that are no part of the handle."""
        vertices = join(self.head).vertices
        if self.rod:
            return vertices
        return vertices[~is_near_line(vertices, self.handle, NEAR_HANDLE * self.radius)]

    def inertia(self) -> tuple[float, Array, Array]:
        """Return its mass [kg], centre of mass (3,) [m], and moments of inertia (3, 3) about that [kg m^2]."""
        solids = []
        for parts, mass in zip((self.head, self.rod), self.masses):
            if parts:
                solid = join(parts)
                solid.density = mass / solid.volume
                solids.append(solid)
        total = sum(self.masses)
        centre = np.sum([solid.mass * solid.center_mass for solid in solids], axis=0) / total
        moments = np.zeros((3, 3))
        for solid in solids:
            away = solid.center_mass - centre
            moments += solid.moment_inertia + solid.mass * (np.dot(away, away) * np.eye(3) - np.outer(away, away))
        return total, centre, moments


def read_tool(own: OwnTool) -> MeshTool:
    """Read a tool of one's own; raises ConfigError for what is wrong with its mesh, handle or inside.

    A file that has not changed is read once.
    """
    paths = [Path(name) for name in (own.mesh, own.handle.mesh) if name is not None]
    return _read_tool(own, tuple(path.stat().st_mtime_ns if path.is_file() else 0 for path in paths))


@lru_cache(maxsize=16)
def _read_tool(own: OwnTool, stamps: tuple[int, ...]) -> MeshTool:
    head = read_parts(Path(own.mesh), own.thickness, own.scale)
    rod = [] if own.handle.mesh is None else read_parts(Path(own.handle.mesh), None, own.scale)
    try:
        inside = find_inside(head) if own.inside is None else given_inside(head, own.inside.region)
    except ConfigError as error:
        raise ConfigError(f"{own.mesh}: {error} (key inside)") from None
    masses = weigh(head, own), weigh(rod, own.handle) if rod else 0.0
    ends = np.array(own.handle.head), np.array(own.handle.end)
    radius = own.handle.radius or measure_radius(join(rod or head), ends, own.handle.mesh or own.mesh)
    region = own.inside.region if own.inside is not None else counting_region(inside)
    return MeshTool(own.name, head, rod, inside, region, ends, radius, grip_pose(own.handle), masses, own.colour)


def weigh(parts: list[trimesh.Trimesh], own: OwnTool | HandleLine) -> float:
    """Return the mass [kg] of parts that a configuration gives, or gives by its density."""
    return own.mass if own.mass is not None else (own.density or 0.0) * float(join(parts).volume)


def counting_region(inside: Inside) -> mpm.Region:
    """Return the region of the grains in and on a vessel: an upright cylinder, wider than what it holds."""
    low, high = inside.bounds
    middle, half = 0.5 * (low + high), 0.5 * (high - low)
    top = inside.level + HEAP
    return mpm.Region((float(middle[0]), float(middle[1]), float(0.5 * (low[2] + top))),
                      (ASIDE * float(half[0]), ASIDE * float(half[1]), float(0.5 * (top - low[2]))), round=True)


def grip_pose(handle: HandleLine) -> Array:
    """Return the pose (4, 4) of a handle's grip; raises ConfigError for a line without a direction."""
    head, end = np.array(handle.head), np.array(handle.end)
    length = float(np.linalg.norm(head - end))
    if length < 1e-3:
        raise ConfigError(f"handle: from head {handle.head} to end {handle.end} m; accepted: a line of 1 mm or more")
    z = (head - end) / length
    y = np.array(handle.approach, float) - z * np.dot(z, handle.approach)
    if np.linalg.norm(y) < 0.1 * np.linalg.norm(handle.approach) or not np.any(handle.approach):
        raise ConfigError(f"handle.approach = {handle.approach} is along the handle; accepted: a direction across it")
    y /= np.linalg.norm(y)
    pose = np.eye(4)
    pose[:3, :3] = np.stack([np.cross(y, z), y, z], axis=1)
    pose[:3, 3] = head + handle.hold * (end - head)
    return pose


def is_near_line(points: Array, line: tuple[Array, Array], reach: float) -> NDArray[np.bool_]:
    """Test which points (n, 3) lie within `reach` [m] of a line between two points."""
    begin, end = line
    along = end - begin
    share = np.clip((points - begin) @ along / np.dot(along, along), 0.0, 1.0)
    return np.linalg.norm(points - (begin + share[:, None] * along), axis=1) < reach


def measure_radius(mesh: trimesh.Trimesh, line: tuple[Array, Array], name: str) -> float:
    """Return the mean distance [m] of a handle's surface from its line; raises ConfigError where there is none."""
    begin, end = line
    length = float(np.linalg.norm(end - begin))
    points = trimesh.sample.sample_surface(mesh, 20_000, seed=0)[0]
    share = (points - begin) @ (end - begin) / length**2
    away = np.linalg.norm(points - (begin + share[:, None] * (end - begin)), axis=1)
    beside = away[(share > 0.25) & (share < 0.75) & (away < 0.25 * length)]
    if len(beside) < 20:
        raise ConfigError(f"{name}: no part of the mesh lies along handle, {tuple(begin)} to {tuple(end)} m; accepted: "
                          f"the line in the middle of the handle, or handle.radius")
    return float(beside.mean())
