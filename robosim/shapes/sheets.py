"""Closed walls about curved sheets: a grid of points and another beside it, joined all round."""

import numpy as np
import trimesh
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


def sheet_normals(grid: Array) -> Array:
    """Return unit normals (k, n, 3) of a grid of points (k, n, 3): across rows x along rows."""
    rows, columns = np.gradient(grid, axis=0), np.gradient(grid, axis=1)
    normals = np.cross(rows, columns)
    return normals / np.maximum(np.linalg.norm(normals, axis=2, keepdims=True), 1e-12)


def wall_between(near: ArrayLike, far: ArrayLike) -> trimesh.Trimesh:
    """Join two grids of points (k, n, 3) in m, one behind the other, into a closed solid with outward normals."""
    near, far = np.asarray(near, float), np.asarray(far, float)
    k, n, _ = near.shape
    place = np.arange(k * n).reshape(k, n)
    a, b, c, d = place[:-1, :-1], place[1:, :-1], place[1:, 1:], place[:-1, 1:]
    front = np.concatenate([np.stack([a, b, c], -1).reshape(-1, 3), np.stack([a, c, d], -1).reshape(-1, 3)])
    border = np.concatenate([place[0, :-1], place[:-1, -1], place[-1, :0:-1], place[:0:-1, 0]])
    after = np.roll(border, -1)
    rim = np.concatenate([np.stack([border, after, after + k * n], -1), np.stack([border, after + k * n,
                                                                                border + k * n], -1)])
    faces = np.concatenate([front, front[:, ::-1] + k * n, rim])
    mesh = trimesh.Trimesh(np.concatenate([near.reshape(-1, 3), far.reshape(-1, 3)]), faces, process=False)
    if mesh.volume < 0.0:
        mesh.invert()
    return mesh
