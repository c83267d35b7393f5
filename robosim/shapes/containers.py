"""Containers: walls, what is in them, and their distances, whatever they were made from.
Frame: z up; of a box or a round one, the origin is the centre of the inner floor. Lengths are metres."""

from abc import ABC, abstractmethod
from functools import lru_cache
from pathlib import Path

import numpy as np
import trimesh
from numpy.typing import ArrayLike, NDArray
from scipy.ndimage import binary_dilation

import mpm
from mpm.geometry.sampled_sdf import Lattice
from robosim.base.errors import ConfigError
from robosim.shapes.grown_wall import grow_outward, wall_at_inside
from robosim.shapes.inside import Inside, find_inside
from robosim.shapes.mesh_files import join, read_parts

Array = NDArray[np.float64]
Found = NDArray[np.bool_]

RIM_MARGIN = 0.02
"""Height above a container's rim up to which grains count as in it."""
WALL_MARGIN, FLOOR_MARGIN = 1e-3, 5e-3
"""Distances beyond the inner walls, and below the floor, up to which grains count as in it."""
CONTAINER_CORNER = 0.008
"""Inner radius of the upright edges of a box."""
SECTORS = 64
"""Of a round one's walls."""
VOLUME_SAMPLES = 50_000
"""Points of the box around an inside by which its volume is measured."""


class ContainerShape(ABC):
    """The shape of a container, in its own frame."""

    wall: float
    """Thickness of its real wall."""
    is_round = False
    """Whether its counting region is a cylinder."""
    bounds: tuple[Array, Array]
    """Lower and upper corner (3,) of the box around the inside."""

    @abstractmethod
    def walls(self) -> trimesh.Trimesh:
        """Make the real walls, closed."""

    @abstractmethod
    def distance(self, wall: float, spacing: float) -> Lattice:
        """Return the signed distance of walls that are `wall` thick, grown outward."""

    @abstractmethod
    def shell(self) -> mpm.Shell:
        """Return the walls as a thin shell of their real thickness; raises ConfigError where there can be none."""

    @abstractmethod
    def holds(self, points: Array) -> Found:
        """Return which points (n, 3) count as in it, up to RIM_MARGIN above its rim."""

    @abstractmethod
    def between_walls(self, points: Array) -> Found:
        """Return which points (n, 3) of the box around the inside are in it."""

    @property
    def height(self) -> float:
        """Of the inside."""
        low, high = self.bounds
        return float(high[2] - low[2])

    @property
    def region(self) -> mpm.Region:
        """The box, or cylinder, around what counts as in it."""
        low, high = self.bounds
        low, high = low - [WALL_MARGIN, WALL_MARGIN, FLOOR_MARGIN], high + [WALL_MARGIN, WALL_MARGIN, RIM_MARGIN]
        x, y, z = map(float, 0.5 * (low + high))
        a, b, c = map(float, 0.5 * (high - low))
        return mpm.Region((x, y, z), (a, b, c), self.is_round)

    def filled_volume(self, height: float) -> float:
        """Return the volume [m^3] up to a height above the floor."""
        low, high = self.bounds
        box = float(np.prod(high - low))
        points, volume = self.fill(height, (box / VOLUME_SAMPLES) ** (1.0 / 3.0), np.random.default_rng(0))
        return len(points) * volume

    def fill(self, height: float, spacing: float, rng: np.random.Generator) -> tuple[Array, float]:
        """Sample positions (n, 3) up to a height above the floor, `spacing` apart; and the volume of one grain."""
        low, high = self.bounds
        upper = np.array([high[0], high[1], low[2] + height])
        points = mpm.sample_box(low, upper, spacing, rng)
        return points[self.between_walls(points)], float(np.prod(upper - low)) / len(points)


class UprightShape(ContainerShape):
    """A container of given sizes with a flat floor at z = 0 and vertical walls."""

    @abstractmethod
    def _solid(self, wall: float) -> trimesh.Trimesh:
        """Make walls that are `wall` thick, grown outward, closed."""

    @abstractmethod
    def _face(self) -> trimesh.Trimesh:
        """Make their inner face."""

    @abstractmethod
    def _is_across(self, points: Array) -> Found:
        """Return which points (n, 3) are within the walls' outline, or WALL_MARGIN beyond it."""

    def walls(self) -> trimesh.Trimesh:
        return self._solid(self.wall)

    def distance(self, wall: float, spacing: float) -> Lattice:
        return mpm.Sdf.from_mesh(self._solid(wall), spacing=spacing)

    def shell(self) -> mpm.Shell:
        return mpm.Shell.from_mesh(self._face(), self.wall, behind=True)

    def holds(self, points: Array) -> Found:
        z = points[:, 2]
        return self._is_across(points) & (z < self.bounds[1][2] + RIM_MARGIN) & (z > -FLOOR_MARGIN)


class BoxShape(UprightShape):
    """A box with rounded upright edges; size (3,): of the inside."""

    def __init__(self, size: tuple[float, float, float], wall: float = 0.006) -> None:
        self.size, self.wall = np.array(size), wall
        self.corner = min(CONTAINER_CORNER, 0.45 * float(self.size[:2].min()))
        half = self.size / 2.0
        self.bounds = np.array([-half[0], -half[1], 0.0]), np.array([half[0], half[1], self.size[2]])

    def filled_volume(self, height: float) -> float:
        """Return the volume [m^3] up to a height above the floor, as without rounded edges."""
        return float(self.size[0] * self.size[1] * height)

    def _solid(self, wall: float) -> trimesh.Trimesh:
        return make_container_shell(self.size, wall, self.corner)

    def _face(self) -> trimesh.Trimesh:
        return make_box_face(self.size, self.corner)

    def _is_across(self, points: Array) -> Found:
        return np.all(np.abs(points[:, :2]) < self.size[:2] / 2.0 + WALL_MARGIN, axis=1)

    def between_walls(self, points: Array) -> Found:
        beyond = np.maximum(np.abs(points[:, :2]) - (self.size[:2] / 2.0 - self.corner), 0.0)
        return np.hypot(*beyond.T) <= self.corner


class RoundShape(UprightShape):
    """An upright cylinder."""

    is_round = True

    def __init__(self, radius: float, height: float, wall: float = 0.006) -> None:
        self.radius, self.wall, self._height = radius, wall, height
        self.bounds = np.array([-radius, -radius, 0.0]), np.array([radius, radius, height])

    def _solid(self, wall: float) -> trimesh.Trimesh:
        outer, high = self.radius + wall, self._height
        return trimesh.creation.revolve([(0.0, -wall), (outer, -wall), (outer, high), (self.radius, high),
                                         (self.radius, 0.0), (0.0, 0.0)], sections=SECTORS)

    def _face(self) -> trimesh.Trimesh:
        face = trimesh.creation.revolve([(0.0, 0.0), (self.radius, 0.0), (self.radius, self._height)], sections=SECTORS)
        face.invert()
        return face

    def _is_across(self, points: Array) -> Found:
        return np.hypot(points[:, 0], points[:, 1]) < self.radius + WALL_MARGIN

    def between_walls(self, points: Array) -> Found:
        return np.hypot(points[:, 0], points[:, 1]) <= self.radius


class MeshShape(ContainerShape):
    """A container from closed meshes."""

    is_round = True

    def __init__(self, parts: list[trimesh.Trimesh], inside: Inside) -> None:
        self.parts, self.inside, self.bounds = parts, inside, inside.bounds
        self.wall = wall_at_inside(parts, inside)
        self._near = inside._replace(held=binary_dilation(inside.held))
        """The inside and a lattice spacing around it: grains sink a little into walls."""

    @property
    def region(self) -> mpm.Region:
        """The cylinder around what counts as in it."""
        upright, cells = super().region, np.argwhere(self._near.held.any(2))
        away = self._near.lower[:2] + self._near.spacing * cells - upright.centre[:2]
        radius = float(np.hypot(*away.T).max() + self._near.spacing)  # to the corners of the outermost cells
        return upright._replace(half=(radius, radius, upright.half[2]))

    def walls(self) -> trimesh.Trimesh:
        return join(self.parts)

    def distance(self, wall: float, spacing: float) -> Lattice:
        return grow_outward(self.parts, self.inside, wall - self.wall, spacing)

    def shell(self) -> mpm.Shell:
        """Raise ConfigError: the walls of a mesh are closed, and a shell needs their inner face."""
        raise ConfigError("tool_wall: shell, with an empty container from a mesh, which has no shell; accepted: size, "
                          "radius with height, or model for the container, or a tool_wall in metres")

    def holds(self, points: Array) -> Found:
        return self._near.holds(points, RIM_MARGIN)

    def between_walls(self, points: Array) -> Found:
        return self.inside.holds(points)


def read_container(mesh: str, thickness: float | None, scale: float) -> MeshShape:
    """Read a container from a mesh; raises ConfigError. A file that has not changed is read once."""
    path = Path(mesh)
    return _read_container(path, thickness, scale, path.stat().st_mtime_ns if path.is_file() else 0)


@lru_cache(maxsize=16)
def _read_container(path: Path, thickness: float | None, scale: float, stamp: int) -> MeshShape:
    parts = read_parts(path, thickness, scale)
    try:
        return MeshShape(parts, find_inside(parts))
    except ConfigError as error:
        raise ConfigError(f"{path}: {error}") from None


def join_rings(rings: ArrayLike, *, has_lid: bool = True) -> trimesh.Trimesh:
    """Join k rings of points (k, n, 3) [m] by faces, and close the first one, and with a lid the last, by flat fans."""
    corners = np.asarray(rings, float)
    k, n, _ = corners.shape
    here = np.arange(n)
    after = np.roll(here, -1)
    row = n * np.arange(k - 1)[:, None]
    a, b, c, d = (row + here, row + after, row + n + after, row + n + here)
    faces = [np.stack([a, b, c], -1).reshape(-1, 3), np.stack([a, c, d], -1).reshape(-1, 3),
             np.stack([np.full(n, k * n), after, here], axis=1)]
    if has_lid:
        faces.append(np.stack([np.full(n, k * n + 1), (k - 1) * n + here, (k - 1) * n + after], axis=1))
    vertices = np.concatenate([corners.reshape(-1, 3), corners[[0, -1] if has_lid else [0]].mean(1)])
    return trimesh.Trimesh(vertices, np.concatenate(faces), process=False)


def box_outline(size: Array, corner: float, grow: float, z: float) -> Array:
    """Make the rounded rectangle (n, 3) of a box, grown outward by `grow` [m], at height z [m]."""
    arc = np.linspace(0.0, np.pi / 2.0, 7)
    half = size[:2] / 2.0 - corner
    parts = []
    for i, sign in enumerate(((1, 1), (-1, 1), (-1, -1), (1, -1))):
        angle = arc + i * np.pi / 2.0
        direction = np.stack([np.cos(angle), np.sin(angle)], axis=1)
        parts.append(half * np.array(sign) + (corner + grow) * direction)
    flat = np.concatenate(parts)
    return np.column_stack([flat, np.full(len(flat), z)])


def make_box_face(inner_size: ArrayLike, corner: float) -> trimesh.Trimesh:
    """Make the inner face of an open-topped box with rounded upright edges; arguments as of `make_container_shell`."""
    size = np.asarray(inner_size, float)
    face = join_rings([box_outline(size, corner, 0.0, z) for z in (0.0, float(size[2]))], has_lid=False)
    face.invert()
    return face


def make_container_shell(inner_size: ArrayLike, wall: float = 0.006,
                         corner: float = CONTAINER_CORNER) -> trimesh.Trimesh:
    """Make an open-topped box with rounded upright edges; its origin is the centre of the inner floor, z up.
    inner_size (3,): cavity [m]. wall: thickness [m] of walls and floor. corner: inner radius [m] of the upright edges.
    """
    size = np.asarray(inner_size, float)
    lip, top = wall / 3.0, float(size[2])  # bevels of the upper rim catch the light
    return join_rings([box_outline(size, corner, grow, z) for grow, z in (
        (wall - lip, -wall), (wall, lip - wall), (wall, top - lip), (wall - lip, top), (lip, top), (0.0, top - lip),
        (0.0, 0.0))])
