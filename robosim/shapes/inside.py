"""The inside of a vessel, found from its mesh: the space that holds water while the vessel is level.
A place holds water if no way out of it leads over places that are no higher. Closed hollows, into which nothing can be
poured, are no part of it."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import trimesh
from scipy.ndimage import binary_dilation, generate_binary_structure, label

import mpm
from mpm.geometry import mesh_distance
from robosim.base.errors import ConfigError

CELLS = 120
"""Cells along the longest edge of a mesh; twice as many where they are too large for its inside."""
BORDER = 2
"""Cells around it, through which what is not held flows off."""
LEAST_CELLS = 30
"""Cells of the smallest space that counts as an inside."""
FINER = 0.8
"""Share of a cell below which it is worth finding the inside again with smaller ones."""
SKIN_STEP = 0.4
"""Distance of the points, in cells, that mark a surface: the gaps between them are narrower than a cell."""
WATER_SHARE = 0.05
"""Least share of a given region that is water in a vessel: a tenth in a spoon, whose region holds the heap, too. An
open scoop holds a drop at most."""
FACES = generate_binary_structure(3, 1)
"""Cells are neighbours over their faces."""


class Inside(NamedTuple):
    """The space that a vessel holds, on a lattice in the vessel's frame."""

    lower: np.ndarray
    """Centre of the first cell (3,) [m]."""
    spacing: float
    """[m]"""
    held: np.ndarray
    """Which cells hold water (nx, ny, nz)."""
    eye: np.ndarray | None = None
    """Place (3,) [m] that the inner faces look at, for a tool that holds no water."""

    @property
    def volume(self) -> float:
        """[m^3]"""
        return float(self.held.sum() * self.spacing**3)

    @property
    def centre(self) -> np.ndarray:
        """Middle of the space (3,) [m]."""
        return self.lower + self.spacing * np.argwhere(self.held).mean(0)

    @property
    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Lower and upper corner (3,) [m] of the box around the space."""
        cells = np.argwhere(self.held)
        return self.lower + self.spacing * (cells.min(0) - 0.5), self.lower + self.spacing * (cells.max(0) + 0.5)

    @property
    def level(self) -> float:
        """Height [m] of the highest water."""
        return float(self.lower[2] + self.spacing * (np.flatnonzero(self.held.any((0, 1)))[-1] + 0.5))

    def holds(self, points: np.ndarray, heap: float = 0.0) -> np.ndarray:
        """Return which points (n, 3) [m] of the vessel's frame are in it, or up to `heap` [m] above its water."""
        cells = np.rint((np.asarray(points, float) - self.lower) / self.spacing).astype(int)
        shape = np.array(self.held.shape)
        low = np.minimum(cells, shape - 1)
        steps = int(np.ceil(heap / self.spacing))
        found = np.zeros(len(cells), bool)
        for down in range(steps + 1):
            below = low - [0, 0, down]
            is_known = np.all((below >= 0) & (cells - [0, 0, steps] < shape), axis=1) & np.all(
                cells[:, :2] == low[:, :2], axis=1)
            found[is_known] |= self.held[tuple(below[is_known].T)]
        return found


def find_inside(solid: trimesh.Trimesh | list[trimesh.Trimesh], cells: int = CELLS) -> Inside:
    """Return what closed meshes, z up, hold together; raises ConfigError where they hold nothing.
    It is found among `cells` cells along their longest edge, twice as many where these are too large, and then again
    among as many around what was found: a small bowl on a long handle is measured as well as a bowl alone."""
    parts = solid if isinstance(solid, list) else [solid]
    low, extents = span(parts)
    spacing = float(extents.max()) / cells
    inside = hold_water(parts, low, extents, spacing)
    if inside.held.sum() < LEAST_CELLS:
        spacing /= 2.0
        inside = hold_water(parts, low, extents, spacing)
    if inside.held.sum() >= LEAST_CELLS:
        low, high = inside.bounds
        low, high = low - spacing, high + spacing
        finer = float((high - low).max()) / cells
        if finer < FINER * spacing:
            inside = hold_water(parts, low, high - low, finer)
    if inside.held.sum() < LEAST_CELLS:
        raise ConfigError("no inside found: level, it holds no water; accepted: a vessel whose opening is up along z, "
                          "or a given inside")
    return inside


def hold_water(parts: list[trimesh.Trimesh], low: np.ndarray, extents: np.ndarray, spacing: float) -> Inside:
    """Return the cells of a box, low (3,) and extents (3,) [m], that hold water; it flows off at the box's border.
    No water passes the surface of a mesh, however thin the wall is."""
    lower = low - BORDER * spacing
    shape = tuple(int(n) for n in np.ceil(extents / spacing).astype(int) + 2 * BORDER + 1)
    free, skin = find_free(parts, lower, spacing, shape), find_skin(parts, lower, spacing, shape)
    labels, _ = label_parts(free & ~skin)
    outside = np.isin(labels, np.setdiff1d(border_values(labels), [0])).reshape(shape)
    held = np.zeros(shape, bool)
    for k in range(shape[2] - BORDER):
        levels, count = label_parts(outside[:, :, : k + 1])
        stays = np.setdiff1d(np.arange(1, count + 1), border_values(levels, 5))
        held[:, :, k] = np.isin(levels[:, :, k], stays)
    parts_held, count = label_parts(held)
    if count > 1:  # dents of a handle hold a little, too
        held = parts_held == 1 + int(np.argmax(np.bincount(parts_held.ravel())[1:]))
    near, near_outside = (np.asarray(binary_dilation(cells, FACES), bool) for cells in (held, outside & ~held))
    return Inside(lower, spacing, held | free & skin & near & ~near_outside)


def given_inside(parts: list[trimesh.Trimesh], region: mpm.Region) -> Inside:
    """Return what closed meshes hold; where that is little of a region, as of a scoop, the free space of the region."""
    spacing = float(span(parts)[1].max()) / CELLS
    lower = np.array(region.centre) - region.half
    shape = tuple(int(n) for n in np.maximum(np.ceil(2.0 * np.array(region.half) / spacing).astype(int), 1) + 1)
    points = np.stack(np.meshgrid(*(np.arange(n) for n in shape), indexing="ij"), -1).reshape(-1, 3) * spacing + lower
    free = find_free(parts, lower, spacing, shape) & region.holds(points).reshape(shape)
    if free.sum() < LEAST_CELLS:
        raise ConfigError(f"inside {region.centre}, half {region.half} m holds {int(free.sum())} places "
                          f"of {1e3 * spacing:.2g} mm beside the mesh; accepted: the space in front of its wall")
    given = Inside(lower, spacing, free, np.array(region.centre))
    try:
        water = find_inside(parts)
    except ConfigError:
        return given
    return water if water.volume > WATER_SHARE * given.volume else given


def span(parts: list[trimesh.Trimesh]) -> tuple[np.ndarray, np.ndarray]:
    """Return the lower corner and the size (3,) [m] of the box around meshes."""
    bounds = np.array([part.bounds for part in parts])
    low = bounds[:, 0].min(0)
    return low, bounds[:, 1].max(0) - low


def border_values(cells: np.ndarray, faces: int = 6) -> np.ndarray:
    """Return the values of a lattice (nx, ny, nz) on its border: on the sides, the bottom (5 faces), and the top."""
    sides = [cells.take(end, axis).ravel() for axis in range(3) for end in (0, -1)]
    return np.unique(np.concatenate(sides[:faces]))


def find_skin(parts: list[trimesh.Trimesh], lower: np.ndarray, spacing: float, shape: tuple[int, ...]) -> np.ndarray:
    """Return the cells of a lattice (nx, ny, nz) that a surface passes: they separate its two sides."""
    skin, upper = np.zeros(shape, bool), lower + spacing * np.array(shape)
    for part in parts:
        corners = part.triangles
        near = np.all((corners.max(1) > lower - spacing) & (corners.min(1) < upper), axis=1)
        for points in sample_triangles(corners[near], SKIN_STEP * spacing):
            cells = np.rint((points - lower) / spacing).astype(int)
            cells = cells[np.all((cells >= 0) & (cells < shape), axis=1)]
            skin[tuple(cells.T)] = True
    return skin


def sample_triangles(corners: np.ndarray, step: float) -> Iterator[np.ndarray]:
    """Yield points (k, 3) of triangles (n, 3, 3), at most `step` [m] apart along two edges and on the third."""
    edges = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2)  # from corner k to corner k + 1
    first = edges.argmin(1)  # the shortest edge is one of the two
    order = (first[:, None] + np.arange(3)) % 3
    a, b, c = np.moveaxis(np.take_along_axis(corners, order[..., None], axis=1), 1, 0)
    lengths = np.stack([np.linalg.norm(b - a, axis=1), np.linalg.norm(c - a, axis=1)], axis=1)
    counts = 2 ** np.ceil(np.log2(np.maximum(lengths / step, 1.0))).astype(int)  # powers of two: few different grids
    for along, across in np.unique(counts, axis=0):
        chosen = np.all(counts == (along, across), axis=1)
        u, v = np.meshgrid(np.linspace(0.0, 1.0, along + 1), np.linspace(0.0, 1.0, across + 1), indexing="ij")
        inside = u + v < 1.0 + 1.0 / along + 1.0 / across
        weights = np.stack([u[inside], v[inside]], axis=1)
        weights /= np.maximum(weights.sum(1), 1.0)[:, None]  # those beyond the third edge move onto it
        shifts = np.stack([b - a, c - a], axis=1)[chosen]
        yield (a[chosen, None] + np.einsum("kc,ncx->nkx", weights, shifts)).reshape(-1, 3)


def find_free(parts: list[trimesh.Trimesh], lower: np.ndarray, spacing: float, shape: tuple[int, ...]) -> np.ndarray:
    """Return which points of a lattice lie in no mesh (nx, ny, nz)."""
    return ~np.any([mesh_distance.find_inside(part, lower, spacing, shape) for part in parts], axis=0)


def label_parts(cells: np.ndarray) -> tuple[np.ndarray, int]:
    """Return the number of each cell's connected part, 0 for cells that are not set, and how many parts there are."""
    labels = np.zeros(cells.shape, np.int32)
    return labels, int(label(cells, FACES, output=labels))  # pyright: ignore[reportArgumentType]
