"""The inside of a vessel, found from its mesh: the space that holds water while the vessel is level.

A place holds water if no way out of it leads over places that are no higher. Closed hollows, into which nothing can be
poured, are no part of it.
"""

from typing import NamedTuple

import numpy as np
import trimesh
from scipy.ndimage import generate_binary_structure, label

import mpm
from mpm.geometry import mesh_distance
from robosim.errors import ConfigError

CELLS = 180
"""Cells along the longest edge of a mesh."""
BORDER = 2
"""Cells around it, through which what is not held flows off."""
LEAST_CELLS = 30
"""Cells of the smallest space that counts as an inside."""
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
    """Return what closed meshes, z up, hold together; cells: along their longest edge.

    Raises ConfigError where they hold nothing.
    """
    parts = solid if isinstance(solid, list) else [solid]
    low, extents = span(parts)
    spacing = float(extents.max()) / cells
    lower = low - BORDER * spacing
    shape = tuple(int(n) for n in np.ceil(extents / spacing).astype(int) + 2 * BORDER + 1)
    free = find_free(parts, lower, spacing, shape)
    labels, _ = label_parts(free)
    outside = labels == labels[0, 0, 0]
    held = np.zeros(shape, bool)
    for k in range(shape[2] - BORDER):
        levels, count = label_parts(outside[:, :, : k + 1])
        sides = np.concatenate([levels[0].ravel(), levels[-1].ravel(), levels[:, 0].ravel(), levels[:, -1].ravel(),
                                levels[:, :, 0].ravel()])
        stays = np.setdiff1d(np.arange(1, count + 1), sides)
        held[:, :, k] = np.isin(levels[:, :, k], stays)
    held = largest_part(held)
    if held.sum() < LEAST_CELLS:
        raise ConfigError("no inside found: level, it holds no water; accepted: a vessel whose opening is up along z, "
                          "or a given inside")
    return Inside(lower, spacing, held)


def given_inside(parts: list[trimesh.Trimesh], region: mpm.Region, cells: int = CELLS) -> Inside:
    """Return the free space of closed meshes within a region, for a tool that holds no water; as `find_inside`."""
    spacing = float(span(parts)[1].max()) / cells
    lower = np.array(region.centre) - region.half
    shape = tuple(int(n) for n in np.maximum(np.ceil(2.0 * np.array(region.half) / spacing).astype(int), 1) + 1)
    points = np.stack(np.meshgrid(*(np.arange(n) for n in shape), indexing="ij"), -1).reshape(-1, 3) * spacing + lower
    held = find_free(parts, lower, spacing, shape) & region.holds(points).reshape(shape)
    if held.sum() < LEAST_CELLS:
        raise ConfigError(f"inside {tuple(region.centre)}, half {tuple(region.half)} m holds {int(held.sum())} places "
                          f"of {1e3 * spacing:.2g} mm beside the mesh; accepted: the space in front of its wall")
    return Inside(lower, spacing, held)


def span(parts: list[trimesh.Trimesh]) -> tuple[np.ndarray, np.ndarray]:
    """Return the lower corner and the size (3,) [m] of the box around meshes."""
    bounds = np.array([part.bounds for part in parts])
    low = bounds[:, 0].min(0)
    return low, bounds[:, 1].max(0) - low


def find_free(parts: list[trimesh.Trimesh], lower: np.ndarray, spacing: float, shape: tuple[int, ...]) -> np.ndarray:
    """Return which points of a lattice lie in no mesh (nx, ny, nz)."""
    return ~np.any([mesh_distance.find_inside(part, lower, spacing, shape) for part in parts], axis=0)


def largest_part(held: np.ndarray) -> np.ndarray:
    """Return the largest connected part: dents of a handle hold a little, too."""
    labels, count = label_parts(held)
    if count < 2:
        return held
    return labels == 1 + int(np.argmax(np.bincount(labels.ravel())[1:]))


def label_parts(cells: np.ndarray) -> tuple[np.ndarray, int]:
    """Return the number of each cell's connected part, 0 for cells that are not set, and how many parts there are."""
    labels = np.zeros(cells.shape, np.int32)
    return labels, int(label(cells, FACES, output=labels))  # pyright: ignore[reportArgumentType]
