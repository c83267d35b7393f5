"""Closed triangle meshes from curves: revolve, loft and sweep.

All lengths are metres. Every function returns a watertight trimesh.Trimesh with outward normals: the side is
a grid of quads (two triangles each), the ends are closed by fans, and the winding is inverted where the signed
volume is negative.
"""

import numpy as np
import trimesh
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


def superellipse(a: float, b: float, exponent: float = 2.0, count: int = 40) -> Array:
    """Sample points (count, 2) of |x/a|^e + |y/b|^e = 1.

    Counter-clockwise from +x; half axes a, b [m]. Exponent 2 is an ellipse, 4 to 8 a rounded rectangle.
    """
    angle = 2.0 * np.pi * np.arange(count) / count
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    # points of the ellipse are moved along its rays: they are spread better than with powers of sin and cos
    reach = np.sum(np.abs(circle) ** exponent, axis=1) ** (-1.0 / exponent)
    return circle * reach[:, None] * np.array([a, b])


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


def loft(
    sections: ArrayLike, apexes: tuple[ArrayLike | None, ArrayLike | None] = (None, None)
) -> trimesh.Trimesh:
    """Join k closed sections (k, n, 3) [m] into a solid.

    Its two ends are closed by triangle fans. apexes gives the centre points (3,) of the fans; None takes the mean of
    the end section (a flat cap).
    """
    rings = np.asarray(sections, float)
    k, n, _ = rings.shape
    tips = [ring.mean(axis=0) if tip is None else np.asarray(tip, float)
            for tip, ring in zip(apexes, (rings[0], rings[-1]), strict=True)]
    here = np.arange(n)
    after = np.roll(here, -1)
    row = n * np.arange(k - 1)[:, None]
    a, b, c, d = (row + here, row + after, row + n + after, row + n + here)
    side = np.concatenate([np.stack([a, b, c], -1).reshape(-1, 3), np.stack([a, c, d], -1).reshape(-1, 3)])
    first = np.stack([np.full(n, k * n), after, here], axis=1)
    last = np.stack([np.full(n, k * n + 1), (k - 1) * n + here, (k - 1) * n + after], axis=1)
    vertices = np.concatenate([rings.reshape(-1, 3), np.stack(tips)])
    mesh = trimesh.Trimesh(vertices, np.concatenate([side, first, last]), process=False)
    if mesh.volume < 0.0:
        mesh.invert()
    return mesh


def revolve(profile: ArrayLike, segments: int = 40) -> trimesh.Trimesh:
    """Revolve a profile (n, 2) of (radius, height) [m] about the z axis.

    A first or last radius of zero becomes a pole, else the end is closed by a flat disc.
    """
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
