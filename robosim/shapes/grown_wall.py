"""The collider of a thin wall: thickened outward, so that what the vessel holds stays as it is.
Through a wall thinner than a grid cell grains would pass. The distance is that of the union of the real solid and of a
layer behind its inner surface: places within the growth of the solid, below the water's level, not on the inner side.
"""

import numpy as np
import trimesh
from numpy.typing import NDArray

import mpm
from mpm.geometry.mesh_distance import sheet_distances, wall_thickness
from mpm.geometry.sampled_sdf import Lattice
from robosim.base.errors import ConfigError
from robosim.shapes.inside import Inside, span
from robosim.shapes.mesh_files import join, pick_faces, subdivide

MARGIN = 4e-3
"""Distance [m] around the grown solid up to which its lattice reaches."""
PROBE = 1.5
"""Distance from a face to the place that decides on which side it is, in spacings of the inside."""
BURIED = 0.5
"""Distance from a face to the place that shows whether another mesh covers it, in spacings of the lattice."""
MOST_POINTS = 40_000_000
"""Lattice points beyond which a solid is too large for its spacing."""

Array = NDArray[np.float64]


def grow_outward(parts: list[trimesh.Trimesh], inside: Inside, growth: float, spacing: float) -> Lattice:
    """Return the distances of closed meshes whose wall is `growth` [m] thicker, on the side that holds nothing.
    spacing: of the lattice [m]. Raises ConfigError where no face borders the inside."""
    real = mpm.Sdf.from_mesh(parts, spacing=spacing)
    if growth <= 0.0:
        return real
    low, extents = span(parts)
    lower = low - growth - MARGIN
    shape = tuple(int(n) for n in np.ceil((extents + 2.0 * (growth + MARGIN)) / spacing).astype(int) + 1)
    if np.prod(np.array(shape, float)) > MOST_POINTS:
        raise ConfigError(f"a mesh of {np.round(1e3 * extents).astype(int)} mm: too large for distances every "
                          f"{1e3 * spacing:g} mm; accepted: up to {MOST_POINTS:.0e} of them")
    axes = [lower[k] + spacing * np.arange(shape[k]) for k in range(3)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), -1)
    solid = real.distance(points.reshape(-1, 3)).reshape(shape)
    inner = inner_surface(parts, inside, real, spacing)
    band = growth + 2.0 * spacing
    side, _ = sheet_distances(inner, lower, spacing, shape, band)
    side[side > 0.9 * band] = np.inf  # in the middle of the inside, where nothing grows
    level = inside.level if inside.eye is None else float(inner.vertices[:, 2].max())
    layer = np.maximum.reduce([solid - growth, points[..., 2] - level, side])
    return Lattice(np.minimum(solid, layer).astype(np.float32), lower, spacing)


def wall_at_inside(parts: list[trimesh.Trimesh], inside: Inside) -> float:
    """Return the least thickness [m] of the wall that borders an inside: of the part with the most of it."""
    shares = [int(looks_inward(part, inside).sum()) for part in parts]
    return wall_thickness(parts[int(np.argmax(shares))])


def inner_surface(parts: list[trimesh.Trimesh], inside: Inside, real: Lattice, spacing: float) -> trimesh.Trimesh:
    """Return the faces of closed meshes that border their inside, front to it; raises ConfigError for none.
    real: distance of the meshes, `spacing` [m] apart; faces that it shows buried in another mesh border nothing."""
    whole = join(parts)
    low, high = inside.bounds
    reach = 2.0 * PROBE * inside.spacing
    near = np.all((whole.triangles.max(1) > low - reach) & (whole.triangles.min(1) < high + reach), axis=1)
    if near.any():
        fine = subdivide(pick_faces(whole, near), 2.0 * inside.spacing)
        faces = looks_inward(fine, inside)
        faces &= real.distance(fine.triangles_center + BURIED * spacing * fine.face_normals) > 0.0
        if faces.any():
            return pick_faces(fine, faces)
    raise ConfigError("no wall found about the inside; accepted: an inside that the mesh's wall surrounds")


def looks_inward(mesh: trimesh.Trimesh, inside: Inside) -> NDArray[np.bool_]:
    """Return which faces (n,) border an inside, or look at its place."""
    found = inside.holds(mesh.triangles_center + PROBE * inside.spacing * mesh.face_normals)
    if inside.eye is not None:
        found &= np.einsum("ij,ij->i", inside.eye - mesh.triangles_center, mesh.face_normals) > 0.0
    return found
