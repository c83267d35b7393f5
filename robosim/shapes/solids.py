"""Closed solids and open inner faces through rings of points, from which containers of given sizes are made.
Lengths are metres. A solid is watertight with outward normals; the normals of an inner face point into what it holds.
"""

import numpy as np
import trimesh
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

CONTAINER_CORNER = 0.008
"""Inner radius [m] of a container's upright edges."""

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


def box_outline(size: Array, corner: float, grow: float, z: float) -> Array:
    """Make the rounded rectangle (n, 3) of a box, grown outward by `grow` [m], at height z [m]."""
    arc = np.linspace(0.0, np.pi / 2.0, 7)
    half = size[:2] / 2.0 - corner
    parts = []
    for i, sign in enumerate(((1, 1), (-1, 1), (-1, -1), (1, -1))):
        angle = arc + i * np.pi / 2.0
        direction = np.stack([np.cos(angle), np.sin(angle)], axis=1)
        parts.append(half * np.array(sign) + (corner + grow) * direction)
    flat = np.concatenate(parts)
    return np.column_stack([flat, np.full(len(flat), z)])


def make_box_face(inner_size: ArrayLike, corner: float) -> trimesh.Trimesh:
    """Make the inner face of an open-topped box with rounded upright edges; arguments as of `make_container_shell`."""
    size = np.asarray(inner_size, float)
    return make_face([box_outline(size, corner, 0.0, z) for z in (0.0, float(size[2]))], np.zeros(3))


def make_container_shell(inner_size: ArrayLike, wall: float = 0.006,
                         corner: float = CONTAINER_CORNER) -> trimesh.Trimesh:
    """Make an open-topped box with rounded upright edges; its origin is the centre of the inner floor, z up.
    inner_size (3,): cavity [m]. wall: thickness [m] of walls and floor. corner: inner radius [m] of the upright edges.
    """
    size = np.asarray(inner_size, float)
    lip, top = wall / 3.0, float(size[2])  # bevels of the upper rim catch the light
    return loft([box_outline(size, corner, grow, z) for grow, z in (
        (wall - lip, -wall), (wall, lip - wall), (wall, top - lip), (wall - lip, top), (lip, top), (0.0, top - lip),
        (0.0, 0.0))])
