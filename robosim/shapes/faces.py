"""Inner faces of tools and containers: open surfaces from which thin shells are made.

Their normals point into what they hold. All lengths are metres.
"""

from collections.abc import Callable
from functools import cache

import numpy as np
import trimesh
from numpy.typing import ArrayLike, NDArray

import mpm
from robosim.shapes.lofts import superellipse

Array = NDArray[np.float64]


def make_face(rows: ArrayLike, pole: ArrayLike, *, closed: bool = True) -> trimesh.Trimesh:
    """Make an open surface through rows of points (k, n, 3), whose first row a fan about the pole (3,) closes.

    closed: whether each row is a ring; otherwise it is a curve, and so are the surface's long sides.
    """
    grid = np.asarray(rows, float)
    k, n, _ = grid.shape
    here = np.arange(n if closed else n - 1)
    after = (here + 1) % n
    row = n * np.arange(k - 1)[:, None]
    a, b, c, d = (row + here, row + after, row + n + after, row + n + here)
    side = np.concatenate([np.stack([a, b, c], -1).reshape(-1, 3), np.stack([a, c, d], -1).reshape(-1, 3)])
    fan = np.stack([np.full(len(here), k * n), after, here], axis=1)
    vertices = np.concatenate([grid.reshape(-1, 3), np.reshape(np.asarray(pole, float), (1, 3))])
    faces = np.concatenate([side, fan])
    corners = vertices[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    if np.sum(normals * (vertices.mean(0) - corners.mean(1))) < 0.0:
        faces = faces[:, ::-1]
    return trimesh.Trimesh(vertices, faces, process=False)


def revolve_face(profile: ArrayLike, segments: int = 48) -> trimesh.Trimesh:
    """Revolve a profile (n, 2) of (radius, height) [m] about the z axis, from the middle of a floor to a rim."""
    curve = np.asarray(profile, float)
    rings = np.empty((len(curve) - 1, segments, 3))
    rings[:, :, :2] = curve[1:, None, :1] * superellipse(1.0, 1.0, count=segments)
    rings[:, :, 2] = curve[1:, 1:]
    return make_face(rings, [0.0, 0.0, curve[0, 1]])


def shell_behind(face: trimesh.Trimesh, wall: float) -> mpm.Shell:
    """Make the shell of a wall of `wall` [m] behind an inner face."""
    return mpm.Shell.from_mesh(face, wall, behind=True)


@cache
def find_lip(make: Callable[[], trimesh.Trimesh]) -> tuple[float, float, float] | None:
    """Return the place [m] of the face that `make` makes over which its tool pours; None for a face without a rim.

    It is the foremost of the rim, along x, in the middle of the tool, and the lowest of such places.
    """
    face = make()
    edges, counts = np.unique(face.edges_sorted, axis=0, return_counts=True)
    rim = face.vertices[np.unique(edges[counts == 1])]
    if not len(rim):
        return None
    foremost = rim[rim[:, 0] > rim[:, 0].max() - 1e-6]
    return float(foremost[0, 0]), 0.0, float(foremost[:, 2].min())
