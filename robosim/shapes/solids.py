"""Solids that several models share, and the writing of a model's meshes."""

from pathlib import Path

import numpy as np
import trimesh
from numpy.typing import ArrayLike

from robosim.shapes.lofts import loft, superellipse


def make_stack(rows: ArrayLike, count: int = 40) -> trimesh.Trimesh:
    """Make a loft along z of centred sections given as rows (k, 4): z, half x, half y in m, exponent."""
    rings = []
    for z, a, b, exponent in np.asarray(rows, float):
        rings.append(np.column_stack([superellipse(a, b, exponent, count), np.full(count, z)]))
    return loft(rings)


def write_solids(parts: dict[str, trimesh.Trimesh], folder: Path, prefix: str = "") -> int:
    """Write each part, a closed solid, as <prefix><name>.stl; returns the bytes written.

    Raises ValueError for a part that is not closed.
    """
    folder.mkdir(parents=True, exist_ok=True)
    total = 0
    for name, mesh in parts.items():
        if not (mesh.is_watertight and mesh.volume > 0.0):
            raise ValueError(f"{name} is not a closed solid")
        data = mesh.export(file_type="stl")
        assert isinstance(data, bytes)
        (folder / f"{prefix}{name}.stl").write_bytes(data)
        total += len(data)
    return total
