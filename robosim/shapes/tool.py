"""The shape of a tool, from its meshes: what it holds, its wall as a solid or a shell, its handle, lip and holes."""

from functools import cached_property, lru_cache
from pathlib import Path

import numpy as np
import trimesh
from numpy.typing import NDArray

import mpm
from mpm.geometry.sampled_sdf import Lattice
from robosim.base.errors import ConfigError
from robosim.config.tool import HandleConfig, ToolConfig, load_bundled
from robosim.shapes.grown_wall import grow_outward, wall_at_inside
from robosim.shapes.inside import Inside, find_inside, given_inside
from robosim.shapes.mesh_files import join, read_directions, read_parts, read_surface, turn_from_wall

Array = NDArray[np.float64]

HEAP = 0.04
"""Height [m] above the water's level up to which grains count as on the tool."""
ASIDE = 3**0.5
"""By which the counting region is wider than what holds water: cohesive heaps overhang the rim."""
NEAR_HANDLE = 1.6
"""Radii of the handle within which a part of the mesh belongs to it and not to the head."""
FOREMOST = 1e-6
"""Distance [m] along x from the foremost place of a rim up to which another one is as far in front."""


class ToolShape:
    """Shape of a tool, in its mesh's frame: z up while the tool is level; lengths in metres.
    Raises ConfigError for what is wrong with meshes, handle or inside."""

    def __init__(self, config: ToolConfig) -> None:
        path, handle = Path(config.mesh), config.handle
        self.config, self.name, self.holes = config, config.name, config.holes
        self.head = read_parts(path, None if config.is_closed else config.thickness, config.scale)
        """Its parts, closed, with the real wall; they may overlap. With the handle, unless that has its own mesh."""
        self.rod = [] if handle.mesh is None else read_parts(Path(handle.mesh), None, config.scale)
        """Parts of the handle's own mesh, if there is one."""
        bounds, lip = self.mesh.bounds, config.lip
        if lip is not None and np.linalg.norm(lip - np.clip(lip, *bounds)) > np.linalg.norm(bounds[1] - bounds[0]):
            raise ConfigError(f"{path}: lip = {lip} is far from the mesh; accepted: a place at its edge, between "
                              f"{bounds[0].round(3).tolist()} and {bounds[1].round(3).tolist()} (in metres)")
        self.growth = read_directions(path, self.head) if config.thicken == "normals" else None
        """Movement (n, 3) of the head's vertices for each metre that its wall gets thicker; None: found."""
        surface = config.inner_face or (None if config.is_closed else config.mesh)
        self.face = None if surface is None else read_surface(Path(surface), config.scale)
        """Inner face or middle of the head's wall, as a thin shell has it; None for a solid."""
        if self.face is not None and config.inner_face is not None:
            turn_from_wall(self.face, self.head, config.thickness or 0.0)
        self.handle = np.array(handle.head), np.array(handle.end)
        """Its ends (3,): at the head, and the free one."""
        self.grip = grip_pose(handle)
        """Pose (4, 4) of the grip: z along the handle towards the head, y along the hand's approach."""
        self.radius = handle.radius or measure_radius(join(self.rod or self.head), self.handle,
                                                      handle.mesh or config.mesh)
        """Of the handle."""
        if config.inside is None or self.growth is None:
            _ = self.inside  # what is wrong with it is said now
        self.interior = config.inside.region if config.inside is not None else counting_region(self.inside)
        """Region in which grains count as in the tool."""

    @cached_property
    def inside(self) -> Inside:
        """The space that it holds; raises ConfigError where there is none."""
        given = self.config.inside
        try:
            return find_inside(self.head) if given is None else given_inside(self.head, given.region)
        except ConfigError as error:
            raise ConfigError(f"{self.config.mesh}: {error} (key inside)") from None

    @property
    def mesh(self) -> trimesh.Trimesh:
        """All parts as one mesh."""
        return join(self.head + self.rod)

    def distance(self, wall: float, spacing: float) -> Lattice:
        """Return the signed distance of the tool with its wall at least `wall` [m] thick, grown outward."""
        return self._grow(self.rod, wall, spacing)

    def head_distance(self, wall: float, spacing: float) -> Lattice:
        """Return the same of the head alone, if the handle has a mesh of its own."""
        return self._grow([], wall, spacing)

    def _grow(self, rod: list[trimesh.Trimesh], wall: float, spacing: float) -> Lattice:
        if self.growth is None:
            grown = wall - wall_at_inside(self.head, self.inside)
            return grow_outward(self.head + rod, self.inside, grown, spacing)
        head = self.head[0]
        vertices = head.vertices + (wall - (self.config.thickness or 0.0)) * self.growth
        return mpm.Sdf.from_mesh([trimesh.Trimesh(vertices, head.faces, process=False), *rod], spacing=spacing)

    def real_distance(self, spacing: float) -> Lattice:
        """Return the signed distance of the tool with its real wall."""
        return mpm.Sdf.from_mesh(self.head + self.rod, spacing=spacing)

    @cached_property
    def head_shell(self) -> mpm.Shell:
        """The head alone as a thin shell of its real wall; raises ConfigError for a solid."""
        if self.face is None or self.config.thickness is None:
            raise ConfigError(f"tool {self.name!r} has no inner_face, and its mesh is closed, so that no face is known "
                              f"for a shell; accepted: a wall thickness in metres, or a tool with inner_face, or whose "
                              f"mesh is an open surface with a thickness")
        return mpm.Shell.from_mesh(self.face, self.config.thickness, behind=self.config.inner_face is not None)

    @property
    def capacity(self) -> float:
        """Volume [m^3] that it holds level with its rim: the convex hull of its inner face, or what is found."""
        if self.face is not None and self.config.inner_face is not None:
            return float(self.face.convex_hull.volume)
        return self.inside.volume

    def orifices(self, grain_diameter: float) -> list[mpm.Orifice]:
        """Return the holes of the head as orifices of its shell, for grains of a diameter [m]."""
        if self.holes is None:
            return []
        return [mpm.Orifice(np.array(self.holes.positions), np.array(self.holes.axis), diameter=self.holes.diameter,
                            grain_diameter=grain_diameter)]

    @cached_property
    def lip(self) -> Array | None:
        """Place [m] (3,) where what the tool pours leaves it; None where neither file nor rim tells."""
        if self.config.lip is not None:
            return np.array(self.config.lip)
        if self.holes is not None:
            return np.mean(self.holes.positions, axis=0)
        return None if self.face is None else find_lip(self.face)

    def head_vertices(self) -> Array:
        """Return the vertices (n, 3) that are no part of the handle."""
        vertices, (begin, end) = join(self.head).vertices, self.handle
        if self.rod:
            return vertices
        along = end - begin
        share = np.clip((vertices - begin) @ along / np.dot(along, along), 0.0, 1.0)
        away = np.linalg.norm(vertices - (begin + share[:, None] * along), axis=1)
        return vertices[away >= NEAR_HANDLE * self.radius]

    @cached_property
    def tip(self) -> Array:
        """Point (3,) of the head that is farthest from the origin; of all where a hand holds the head itself."""
        vertices = self.head_vertices()
        vertices = vertices if len(vertices) else self.mesh.vertices
        return vertices[np.linalg.norm(vertices, axis=1).argmax()]

    def inertia(self) -> tuple[float, Array, Array]:
        """Return its mass [kg], centre of mass (3,) [m], and moments of inertia (3, 3) about that [kg m^2]."""
        solids, total = [], 0.0
        for parts, weighed in ((self.head, self.config), (self.rod, self.config.handle)):
            if parts:
                solid = join(parts)
                mass = (weighed.density or 0.0) * float(solid.volume) if weighed.mass is None else weighed.mass
                solid.density = mass / solid.volume
                solids.append(solid)
                total += mass
        centre = np.sum([solid.mass * solid.center_mass for solid in solids], axis=0) / total
        moments = np.zeros((3, 3))
        for solid in solids:
            away = solid.center_mass - centre
            moments += solid.moment_inertia + solid.mass * (np.dot(away, away) * np.eye(3) - np.outer(away, away))
        return total, centre, moments


def tool_shape(tool: str | ToolConfig) -> ToolShape:
    """Return the shape of a bundled tool or of one's own, read once; raises UnknownName, ConfigError."""
    if isinstance(tool, str):
        return _read_tool(tool, ())
    paths = [Path(name) for name in (tool.mesh, tool.handle.mesh, tool.inner_face) if name is not None]
    changed = tuple(path.stat().st_mtime_ns if path.is_file() else 0 for path in paths)
    return _read_tool(tool, changed)  # pyright: ignore[reportArgumentType]  (frozen tables have a hash)


@lru_cache(maxsize=32)
def _read_tool(tool: str | ToolConfig, changed: tuple[int, ...]) -> ToolShape:
    return ToolShape(load_bundled(tool) if isinstance(tool, str) else tool)


def counting_region(inside: Inside) -> mpm.Region:
    """Return the region of the grains in and on a vessel: an upright cylinder, wider than what it holds."""
    low, high = inside.bounds
    middle, half = 0.5 * (low + high), 0.5 * (high - low)
    top = inside.level + HEAP
    return mpm.Region((float(middle[0]), float(middle[1]), float(0.5 * (low[2] + top))),
                      (ASIDE * float(half[0]), ASIDE * float(half[1]), float(0.5 * (top - low[2]))), round=True)


def grip_pose(handle: HandleConfig) -> Array:
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


def measure_radius(mesh: trimesh.Trimesh, line: tuple[Array, Array], name: str) -> float:
    """Return the mean distance [m] of a handle's surface from its line; raises ConfigError where there is none."""
    begin, end = line
    length = float(np.linalg.norm(end - begin))
    points = trimesh.sample.sample_surface(mesh, 20_000, seed=0)[0]
    share = (points - begin) @ (end - begin) / length**2
    away = np.linalg.norm(points - (begin + share[:, None] * (end - begin)), axis=1)
    beside = away[(share > 0.25) & (share < 0.75) & (away < 0.25 * length)]
    if len(beside) < 20:
        raise ConfigError(f"{name}: no part of the mesh lies along handle, {begin.tolist()} to {end.tolist()} m; "
                          f"accepted: the line in the middle of the handle, or handle.radius")
    return float(beside.mean())


def find_lip(surface: trimesh.Trimesh) -> Array | None:
    """Return the place [m] (3,) over which a tool with an inner face pours; None for a face without a rim.
    It is the foremost of the rim, along x, in the middle of such places along y, and the lowest of them."""
    edges, counts = np.unique(surface.edges_sorted, axis=0, return_counts=True)
    rim = surface.vertices[np.unique(edges[counts == 1])]
    if not len(rim):
        return None
    foremost = rim[rim[:, 0] > rim[:, 0].max() - FOREMOST]
    return np.array([foremost[0, 0], 0.5 * (foremost[:, 1].min() + foremost[:, 1].max()), foremost[:, 2].min()])
