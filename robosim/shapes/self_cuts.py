"""Refuses a mesh that cuts itself: a tool that holds the wrong volume looks right in every picture."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import trimesh
from numpy.typing import NDArray

from robosim.base.errors import ConfigError

IN_PLANE = 1e-12
"""Distance [m] from a plane below which a corner lies in it."""
LISTED, MOST_PAIRS = 2**23, 100_000_000
"""Pairs of faces that are listed at a time, and in all: more would take over half a minute."""


def check_intersections(mesh: trimesh.Trimesh, path: Path, what: str = "a mesh that does not cut itself") -> None:
    """Raise ConfigError where edges of faces pass through others that they share no corner with."""
    corners, normals = mesh.triangles, mesh.face_normals
    offsets, cuts = np.einsum("nd,nd->n", corners[:, 0], normals), [np.empty(0, int)]
    for pairs in find_near_pairs(mesh, path):
        cut = np.zeros(len(pairs), bool)
        for one, other in (pairs.T, pairs.T[::-1]):
            begin = np.einsum("nkd,nd->nk", corners[one], normals[other]) - offsets[other, None]
            end = np.roll(begin, -1, axis=1)
            k, edge = np.nonzero((np.minimum(begin, end) < -IN_PLANE) & (np.maximum(begin, end) > IN_PLANE))
            share = (begin[k, edge] / (begin - end)[k, edge])[:, None]
            meets = (1.0 - share) * corners[one[k], edge] + share * corners[one[k], (edge + 1) % 3]
            inside = np.all(trimesh.triangles.points_to_barycentric(corners[other[k]], meets) > 0.0, axis=1)
            apart = (mesh.faces[one[k], :, None] != mesh.faces[other[k], None, :]).all((1, 2))
            cut[k[inside & apart]] = True
        cuts.append(pairs[cut, 0])
    found = np.concatenate(cuts)
    if len(found):
        x, y, z = 1e3 * corners[found[0]].mean(0)
        raise ConfigError(f"{path}: cuts itself at {len(found)} pairs of faces, the first near ({x:.1f}, {y:.1f}, "
                          f"{z:.1f}) mm; accepted: {what}")


def find_near_pairs(mesh: trimesh.Trimesh, path: Path) -> Iterator[NDArray[np.int64]]:
    """Yield pairs (n, 2) of faces whose boxes overlap; raises ConfigError for more than MOST_PAIRS.
    The boxes are along the mesh's longest edges: those of slender faces side by side would overlap in any other way."""
    edges = mesh.vertices[mesh.edges[:, 1]] - mesh.vertices[mesh.edges[:, 0]]
    corners = mesh.triangles @ np.linalg.eigh(edges.T @ edges)[1]
    low, high, tree = corners.min(1), corners.max(1), trimesh.triangles.bounds_tree(corners)
    rows, listed = max(1, LISTED // len(low)), 0
    for begin in range(0, len(low), rows):
        second, counts = tree.intersection_v(low[begin : begin + rows], high[begin : begin + rows])
        listed += len(second)
        if listed > MOST_PAIRS:
            raise ConfigError(f"{path}: boxes of its {len(low)} triangles overlap in {listed} pairs and more; "
                              f"accepted: up to {MOST_PAIRS}, as of fewer or less slender triangles")
        first = begin + np.repeat(np.arange(len(counts)), counts.astype(int))
        yield np.column_stack([first, second.astype(int)])[second > first]
