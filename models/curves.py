"""Curves, lofts, swept bars and files that the scripts `make_meshes.py` of the models share.

All lengths are metres.
"""

from pathlib import Path

import numpy as np
import trimesh
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


def superellipse(a: float, b: float, exponent: float = 2.0, count: int = 40) -> Array:
    """Sample points (count, 2) of |x/a|^e + |y/b|^e = 1.
    Counter-clockwise from +x; half axes a, b [m]. Exponent 2 is an ellipse, 4 to 8 a rounded rectangle."""
    angle = 2.0 * np.pi * np.arange(count) / count
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    # points of the ellipse are moved along its rays: they are spread better than with powers of sin and cos
    reach = np.sum(np.abs(circle) ** exponent, axis=1) ** (-1.0 / exponent)
    return circle * reach[:, None] * np.array([a, b])


def join_rows(k: int, n: int, closed: bool = True) -> NDArray[np.int64]:
    """Return the faces (m, 3) between k rows of n points each, two for a quad; closed: whether rows are rings."""
    here = np.arange(n if closed else n - 1)
    after = (here + 1) % n
    row = n * np.arange(k - 1)[:, None]
    a, b, c, d = (row + here, row + after, row + n + after, row + n + here)
    return np.concatenate([np.stack([a, b, c], -1).reshape(-1, 3), np.stack([a, c, d], -1).reshape(-1, 3)])


def loft(sections: ArrayLike, apexes: tuple[ArrayLike | None, ArrayLike | None] = (None, None)) -> trimesh.Trimesh:
    """Join k closed sections (k, n, 3) [m] into a solid, whose two ends are closed by triangle fans.
    apexes: centre points (3,) of the fans; None: the mean of the end section (a flat cap)."""
    rings = np.asarray(sections, float)
    k, n, _ = rings.shape
    tips = [ring.mean(axis=0) if tip is None else np.asarray(tip, float)
            for tip, ring in zip(apexes, (rings[0], rings[-1]), strict=True)]
    here = np.arange(n)
    after = np.roll(here, -1)
    first = np.stack([np.full(n, k * n), after, here], axis=1)
    last = np.stack([np.full(n, k * n + 1), (k - 1) * n + here, (k - 1) * n + after], axis=1)
    vertices = np.concatenate([rings.reshape(-1, 3), np.stack(tips)])
    mesh = trimesh.Trimesh(vertices, np.concatenate([join_rows(k, n), first, last]), process=False)
    if mesh.volume < 0.0:
        mesh.invert()
    return mesh


def revolve(profile: ArrayLike, segments: int = 40) -> trimesh.Trimesh:
    """Revolve a profile (n, 2) of (radius, height) [m] about the z axis.
    A first or last radius of zero becomes a pole, else the end is closed by a flat disc."""
    curve = np.asarray(profile, float)
    tips: list[Array | None] = [None, None]
    for end, index in ((0, 0), (1, -1)):
        if curve[index, 0] <= 1e-9:
            tips[end] = np.array([0.0, 0.0, curve[index, 1]])
            curve = curve[1:] if end == 0 else curve[:-1]
    circle = superellipse(1.0, 1.0, count=segments)
    rings = np.empty((len(curve), segments, 3))
    rings[:, :, :2] = curve[:, None, :1] * circle
    rings[:, :, 2] = curve[:, 1:]
    return loft(rings, (tips[0], tips[1]))


def make_face(rows: ArrayLike, pole: ArrayLike, *, closed: bool = True) -> trimesh.Trimesh:
    """Make an open surface through rows of points (k, n, 3), whose first row a fan about the pole (3,) closes.
    closed: whether each row is a ring; otherwise it is a curve, and so are the surface's long sides."""
    grid = np.asarray(rows, float)
    k, n, _ = grid.shape
    here = np.arange(n if closed else n - 1)
    fan = np.stack([np.full(len(here), k * n), (here + 1) % n, here], axis=1)
    vertices = np.concatenate([grid.reshape(-1, 3), np.reshape(np.asarray(pole, float), (1, 3))])
    faces = np.concatenate([join_rows(k, n, closed), fan])
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
