"""Curves, swept bars and files that the scripts `make_meshes.py` of the models share.

All lengths are metres.
"""

from pathlib import Path

import numpy as np
import trimesh
from numpy.typing import ArrayLike, NDArray

from robosim.shapes.solids import loft, superellipse

Array = NDArray[np.float64]


def bezier(control: ArrayLike, t: ArrayLike) -> Array:
    """Evaluate the Bezier curve with control points (m, d) at t (k,) in 0..1.

    Returns points (k, d).
    """
    points = np.repeat(np.asarray(control, float)[:, None, :], np.size(t), axis=1)
    weight = np.asarray(t, float).reshape(-1, 1)
    while len(points) > 1:  # de Casteljau
        points = (1.0 - weight) * points[:-1] + weight * points[1:]
    return points[0]


def smoothstep(t: ArrayLike) -> Array:
    """Return the cubic blend 3t^2 - 2t^3 of t clipped to 0..1; same shape as t."""
    clipped = np.clip(np.asarray(t, float), 0.0, 1.0)
    return clipped * clipped * (3.0 - 2.0 * clipped)


def compute_end_scale(s: ArrayLike, start: float, end: float) -> Array:
    """Compute section scales (k,) that round both ends of a bar, by quarter ellipses.

    s (k,) is the arc length in m, start and end are the lengths (m) over which the ends are rounded.
    """
    s = np.asarray(s, float)
    scale = np.ones_like(s)
    for length, distance in ((start, s - s[0]), (end, s[-1] - s)):
        if length > 0.0:
            scale *= np.sqrt(np.clip(1.0 - np.clip(1.0 - distance / length, 0.0, 1.0) ** 2, 1e-4, 1.0))
    return scale


def space_stations(length: float, start: float, end: float, inner: int = 8, cap: int = 6) -> Array:
    """Space arc lengths [m] in 0..length, densely in the rounded ends.

    start, end: lengths of the rounded ends [m].
    """
    dense = 1.0 - np.cos(np.linspace(0.0, np.pi / 2, cap + 1))
    head = start * dense if start > 0.0 else np.zeros(1)
    tail = length - end * dense[::-1] if end > 0.0 else np.full(1, length)
    return np.concatenate([head, np.linspace(head[-1], tail[0], inner + 2)[1:-1], tail])


def transport_axes(centre_line: ArrayLike, side: ArrayLike) -> tuple[Array, Array]:
    """Transport the section axes (k, 3), (k, 3) along a polyline (k, 3) in parallel.

    The first axis starts as the part of `side` (3,) that is normal to the line, the second completes it to a
    right-handed frame with the tangent as third axis.
    """
    line = np.asarray(centre_line, float)
    tangents = np.gradient(line, axis=0, edge_order=1)
    tangents /= np.linalg.norm(tangents, axis=1, keepdims=True)
    first = np.empty_like(line)
    axis = np.asarray(side, float)
    for i, tangent in enumerate(tangents):  # removing the tangential part rotates the frame without twist
        axis = axis - tangent * (axis @ tangent)
        axis = axis / np.linalg.norm(axis)
        first[i] = axis
    return first, np.cross(tangents, first)


def sweep(
    centre_line: ArrayLike, sections: ArrayLike, side: ArrayLike = (0.0, 1.0, 0.0), segments: int = 24
) -> trimesh.Trimesh:
    """Sweep sections along a centre line (k, 3) in m.

    sections is (k,) radii, (k, 2) half axes, or (k, n, 2) curves in m; their first coordinate lies along the
    transported `side` vector (3,).
    """
    line = np.asarray(centre_line, float)
    shape = np.asarray(sections, float)
    if shape.ndim == 1:
        shape = np.stack([shape, shape], axis=1)
    if shape.ndim == 2:
        shape = superellipse(1.0, 1.0, count=segments)[None] * shape[:, None, :]
    first, second = transport_axes(line, side)
    rings = line[:, None] + shape[..., :1] * first[:, None] + shape[..., 1:] * second[:, None]
    return loft(rings)


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
