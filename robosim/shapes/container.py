"""Open-topped containers."""

import numpy as np
import trimesh
from numpy.typing import ArrayLike, NDArray

from robosim.shapes.lofts import loft

Array = NDArray[np.float64]


def make_container_shell(inner_size: ArrayLike, wall: float = 0.006, corner: float = 0.008) -> trimesh.Trimesh:
    """Return an open-topped box with rounded upright edges; origin at the centre of the inner floor, z up.

    inner_size (3,) is the cavity in m, wall the thickness of walls and floor (the default: the real one), corner the
    inner edge radius.
    """
    size = np.asarray(inner_size, float)

    def outline(grow: float, z: float) -> Array:
        """Return the rounded rectangle (n, 3), grown outward by `grow`, at height z."""
        arc = np.linspace(0.0, np.pi / 2.0, 7)
        half = size[:2] / 2.0 - corner
        parts = []
        for i, sign in enumerate(((1, 1), (-1, 1), (-1, -1), (1, -1))):
            angle = arc + i * np.pi / 2.0
            turn = np.stack([np.cos(angle), np.sin(angle)], axis=1)
            parts.append(half * np.array(sign) + (corner + grow) * turn)
        flat = np.concatenate(parts)
        return np.column_stack([flat, np.full(len(flat), z)])

    lip = wall / 3.0  # bevels of the upper rim catch the light
    top = float(size[2])
    rings = [
        outline(wall - lip, -wall), outline(wall, lip - wall), outline(wall, top - lip),
        outline(wall - lip, top), outline(lip, top), outline(0.0, top - lip), outline(0.0, 0.0),
    ]
    return loft(rings)
