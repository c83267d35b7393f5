"""Open-topped containers."""

import numpy as np
import trimesh
from numpy.typing import ArrayLike, NDArray

from robosim.shapes.lofts import loft

Array = NDArray[np.float64]


def make_container_shell(inner_size: ArrayLike, wall: float = 0.006, corner: float = 0.008) -> trimesh.Trimesh:
    """Make an open-topped box with rounded upright edges.

    Its origin is the centre of the inner floor, z up. inner_size (3,): cavity [m]. wall: thickness [m] of walls and
    floor, by default the real one. corner: inner radius [m] of the upright edges.
    """
    size = np.asarray(inner_size, float)

    def make_outline(grow: float, z: float) -> Array:
        """Make the rounded rectangle (n, 3), grown outward by `grow`, at height z."""
        arc = np.linspace(0.0, np.pi / 2.0, 7)
        half = size[:2] / 2.0 - corner
        parts = []
        for i, sign in enumerate(((1, 1), (-1, 1), (-1, -1), (1, -1))):
            angle = arc + i * np.pi / 2.0
            direction = np.stack([np.cos(angle), np.sin(angle)], axis=1)
            parts.append(half * np.array(sign) + (corner + grow) * direction)
        flat = np.concatenate(parts)
        return np.column_stack([flat, np.full(len(flat), z)])

    lip = wall / 3.0  # bevels of the upper rim catch the light
    top = float(size[2])
    rings = [
        make_outline(wall - lip, -wall), make_outline(wall, lip - wall), make_outline(wall, top - lip),
        make_outline(wall - lip, top), make_outline(lip, top), make_outline(0.0, top - lip), make_outline(0.0, 0.0),
    ]
    return loft(rings)
