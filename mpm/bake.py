"""Signed distance of a closed mesh on a lattice: exact near the surface, signs by ray parity."""

import numpy as np
import trimesh
from scipy.spatial import cKDTree

BAND = 3.0
"""Half width, in lattice spacings, of the band in which distances are exact."""
RAY_OFFSET = np.array([1.234567e-5, 7.654321e-6])
"""Shift of the rays, in spacings, off the symmetry planes and edges that meshes love."""


def signed_distances(mesh: trimesh.Trimesh, lower: np.ndarray, spacing: float, shape: tuple[int, ...]) -> np.ndarray:
    """Distances [m] at lower + spacing * (i, j, k), negative inside.

    Near the surface the distance is that to the closest triangle; elsewhere to the closest of points spread over the
    surface at half a spacing, good to an eighth of a spacing.
    """
    inside = parity(mesh, lower, spacing, shape)
    points = np.stack(np.meshgrid(*[np.arange(n) * spacing for n in shape], indexing="ij"), -1).reshape(-1, 3) + lower
    count = int(min(4 * mesh.area / spacing**2 + 1000, 400_000))
    samples, faces = trimesh.sample.sample_surface(mesh, count, seed=0)
    distance, nearest = cKDTree(samples).query(points)
    near = np.flatnonzero(distance < BAND * spacing)
    distance[near] = _distance_to_neighbour_faces(mesh, points[near], samples, faces)
    return np.where(inside, -1.0, 1.0) * distance.reshape(shape)


def _distance_to_neighbour_faces(
    mesh: trimesh.Trimesh, points: np.ndarray, samples: np.ndarray, faces: np.ndarray, neighbours: int = 12
) -> np.ndarray:
    """Exact distance (n,) to the triangles of the closest samples: with several per point the closest is among them."""
    _, candidates = cKDTree(samples).query(points, k=neighbours)
    best = np.full(len(points), np.inf)
    for column in faces[candidates].T:
        closest = trimesh.triangles.closest_point(mesh.triangles[column], points)
        best = np.minimum(best, np.linalg.norm(closest - points, axis=1))
    return best


def parity(mesh: trimesh.Trimesh, lower: np.ndarray, spacing: float, shape: tuple[int, ...]) -> np.ndarray:
    """Whether lattice points (shape) are inside: an odd number of crossings below them along z."""
    crossings = np.zeros((shape[0], shape[1], shape[2] + 1), np.int64)
    corner = np.asarray(lower)[:2] + RAY_OFFSET * spacing
    for triangle in mesh.triangles:
        low = np.maximum(np.ceil((triangle[:, :2].min(0) - corner) / spacing), 0).astype(int)
        high = np.minimum(np.floor((triangle[:, :2].max(0) - corner) / spacing), np.array(shape[:2]) - 1).astype(int)
        if np.any(high < low):
            continue
        i, j = np.meshgrid(np.arange(low[0], high[0] + 1), np.arange(low[1], high[1] + 1), indexing="ij")
        rays = np.stack([i, j], -1) * spacing + corner
        (a, b, c) = triangle
        area = _cross(b[:2] - a[:2], c[:2] - a[:2])
        if area == 0:
            continue
        u = _cross(rays - a[:2], c[:2] - a[:2]) / area
        v = _cross(b[:2] - a[:2], rays - a[:2]) / area
        hit = (u >= 0) & (v >= 0) & (u + v <= 1)
        height = a[2] + u * (b[2] - a[2]) + v * (c[2] - a[2])
        first_above = np.clip(np.ceil((height - lower[2]) / spacing), 0, shape[2]).astype(int)
        np.add.at(crossings, (i[hit], j[hit], first_above[hit]), 1)
    return np.cumsum(crossings, axis=2)[:, :, : shape[2]] % 2 == 1


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
