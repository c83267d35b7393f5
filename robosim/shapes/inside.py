"""The inside of a vessel, found from its mesh: the space that holds water while the vessel is level.

A place holds water if no way out of it leads over places that are no higher. Closed hollows, into which nothing can be
poured, are no part of it.
"""

from typing import NamedTuple

import numpy as np
import trimesh
from scipy.ndimage import generate_binary_structure, label

from mpm.geometry.mesh_distance import signed_distances
from robosim.errors import ConfigError

CELLS = 90
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


def find_inside(mesh: trimesh.Trimesh, cells: int = CELLS) -> Inside:
    """Return what a closed mesh, z up, holds; cells: along its longest edge.

    Raises ConfigError where it holds nothing.
    """
    spacing = float(mesh.extents.max()) / cells
    lower = mesh.bounds[0] - BORDER * spacing
    shape = tuple(int(n) for n in np.ceil(mesh.extents / spacing).astype(int) + 2 * BORDER + 1)
    free = signed_distances(mesh, lower, spacing, shape) > 0.0
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
