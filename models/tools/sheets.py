"""Closed walls between two curved sheets of points."""

import numpy as np
import trimesh
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


def compute_normals(grid: Array) -> Array:
    """Compute unit normals (k, n, 3) of a grid of points (k, n, 3).

    Their direction is across rows x along rows.
    """
    rows, columns = np.gradient(grid, axis=0), np.gradient(grid, axis=1)
    normals = np.cross(rows, columns)
    return normals / np.maximum(np.linalg.norm(normals, axis=2, keepdims=True), 1e-12)


def make_wall(near: ArrayLike, far: ArrayLike) -> trimesh.Trimesh:
    """Make the closed solid between two grids of points (k, n, 3) [m].

    Its normals point outward.
    """
    near, far = np.asarray(near, float), np.asarray(far, float)
    k, n, _ = near.shape
    index = np.arange(k * n).reshape(k, n)
    a, b, c, d = index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]
    front = np.concatenate([np.stack([a, b, c], -1).reshape(-1, 3), np.stack([a, c, d], -1).reshape(-1, 3)])
    border = np.concatenate([index[0, :-1], index[:-1, -1], index[-1, :0:-1], index[:0:-1, 0]])
    after = np.roll(border, -1)
    rim = np.concatenate([np.stack([border, after, after + k * n], -1), np.stack([border, after + k * n,
                                                                                border + k * n], -1)])
    faces = np.concatenate([front, front[:, ::-1] + k * n, rim])
    mesh = trimesh.Trimesh(np.concatenate([near.reshape(-1, 3), far.reshape(-1, 3)]), faces, process=False)
    if mesh.volume < 0.0:
        mesh.invert()
    return mesh
