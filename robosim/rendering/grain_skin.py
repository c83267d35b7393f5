"""Grains drawn as one MuJoCo skin, whose vertices are overwritten in each frame.
A skin is lit, shaded, shadowed and occluded like any other geometry, and its vertices are streamed to the GPU (or to a
software rasteriser) anyway. Each grain is a small octahedron of its own shape and attitude."""

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.ndimage import map_coordinates, uniform_filter
from scipy.spatial.transform import Rotation

Array = NDArray[np.float64]

GRAIN_SKIN = "grains"
"""Name of the skin and its body."""
GRAIN_RADIUS = 0.62
"""Mean radius of a drawn grain, in spacings of the grains: neighbours touch, so that a heap looks closed."""
CORNERS: Array = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]], float)
FULL_CELL, STEEP = 8, 0.06
"""Grains in a cube of a heap, and the slope of density, in these per cube, from which a surface is one."""
CELL_IN_RADII = 4.0
"""Side of the cubes that find hidden grains, in radii: large enough that few inside a heap are empty by chance."""
HEAP = 2.0
"""Weight of a heap's normal beside that of a grain's face."""
FACES = np.array([[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]])
"""Corners of each face, counter-clockwise seen from outside."""
GRAIN_VERTICES = FACES.size
"""Faces share no vertex, so that each has its own normal."""


def add_grain_skin(spec: mujoco.MjSpec, count: int, radius: float, rgba: ArrayLike) -> None:
    """Add a skin of grains with a mean radius [m] and a colour rgba (4,), at the world's origin.
    Raises ValueError unless count and radius are positive."""
    if count < 1 or radius <= 0.0:
        raise ValueError(f"grain skin: count {count} and radius {radius} m must both be positive")
    vertices = count * GRAIN_VERTICES
    spec.worldbody.add_body(name=GRAIN_SKIN)
    spec.add_skin(name=GRAIN_SKIN, rgba=np.asarray(rgba, float).tolist(), face=list(range(vertices)),
                  vert=make_crystals(count, radius).ravel().tolist(), bodyname=[GRAIN_SKIN], bindpos=[0.0, 0.0, 0.0],
                  bindquat=[1.0, 0.0, 0.0, 0.0], vertid=[list(range(vertices))], vertweight=[[1.0] * vertices])


def make_crystals(count: int, radius: float) -> Array:
    """Make the facets (count, 24, 3) [m] of octahedra about the origin, of a mean radius [m].
    Axes vary by 25 % and corners by 15 %, about the scatter of crushed crystals; attitudes are uniform."""
    rng = np.random.default_rng(0)
    stretch = rng.uniform(0.75, 1.25, (count, 1, 3))
    corners = CORNERS * stretch + rng.uniform(-0.15, 0.15, (count, 6, 3))
    attitudes = Rotation.from_quat(rng.normal(size=(4, count)).T, scalar_first=True).as_matrix()
    rotated = np.einsum("nij,nkj->nki", attitudes, radius * corners)
    return rotated[:, FACES.ravel()]


def compute_normals(facets: Array) -> Array:
    """Compute unit normals (n, 24, 3) per vertex of facets (n, 24, 3).
    They are the mean of the facet's and a sphere's. With facet normals a heap of white grains looks like noise, with
    those of spheres like separate dots."""
    a, b, c = np.moveaxis(facets.reshape(-1, 3, 3), 1, 0)
    flat = np.cross(b - a, c - a)
    flat /= np.linalg.norm(flat, axis=1, keepdims=True)
    radial = facets / np.linalg.norm(facets, axis=2, keepdims=True)
    normals = np.repeat(flat, 3, axis=0).reshape(facets.shape) + radial
    return normals / np.linalg.norm(normals, axis=2, keepdims=True)


def find_surface(positions: NDArray[np.floating], cell: float) -> tuple[NDArray[np.intp], NDArray[np.float32]]:
    """Return which grains (m,) of those at positions (n, 3) [m] are not inside a heap, and the heap's outward direction
    at them (m, 3): about of length 1, upwards for a single grain.
    Inside one, all cubes around theirs are full. Without those grains the picture is the same at half the cost.
    cell: side of the cubes [m]."""
    if not len(positions):
        return np.zeros(0, np.intp), np.zeros((0, 3), np.float32)
    scaled = positions / cell
    scaled = scaled - np.floor(scaled.min(axis=0)) + 2.0
    index = scaled.astype(np.int32)
    shape = tuple(index.max(axis=0) + 3)
    flat = np.ravel_multi_index(tuple(index.T), shape)
    counts = np.bincount(flat, minlength=int(np.prod(shape))).reshape(shape)
    full = counts >= FULL_CELL
    for axis in range(3):
        full = full & np.roll(full, 1, axis) & np.roll(full, -1, axis)
    shown = np.flatnonzero(~full.ravel()[flat])
    density = uniform_filter(uniform_filter(np.minimum(counts, FULL_CELL).astype(np.float32), 3), 3)
    slopes = np.stack([map_coordinates(slope, scaled[shown].T - 0.5, order=1) for slope in np.gradient(density)], 1)
    steepness = np.linalg.norm(slopes, axis=1, keepdims=True)
    outward = -slopes / np.maximum(steepness, STEEP * FULL_CELL)
    outward[:, 2] = np.maximum(outward[:, 2], 0.0) + 0.5  # in a thin layer the slope is of either sign
    return shown, outward.astype(np.float32)


class Crystals:
    """Grains of given facets (n, 24, 3) [m] about the origin; of them a picture takes the faces that it can show."""

    def __init__(self, facets: Array) -> None:
        self._radius = float(np.linalg.norm(facets, axis=2).mean())
        self._normals = compute_normals(facets).astype(np.float32).reshape(-1, 9)
        faces = facets.astype(np.float32).reshape(-1, len(FACES), 3, 3)
        a, b, c = np.moveaxis(faces, 2, 0)
        self._faces, self._outward = faces.reshape(-1, 9), np.cross(b - a, c - a)
        """Faces of all grains, one after the other (8 n, 9), and their normals (n, 8, 3), not of unit length."""

    def show(self, positions: NDArray[np.floating], eye: Array) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Return corners (3 m, 3) [m] and normals, not of unit length, of the faces that grains at positions (n, 3)
        show an eye (3,). The first half of the faces is of every second grain.
        Raises ValueError for more positions than there are grains."""
        if len(positions) > len(self._outward):
            raise ValueError(f"positions of {len(positions)} grains; accepted: at most {len(self._outward)}, as many "
                             f"as the scene's skin has")
        positions = np.asarray(positions, np.float32)
        visible, outward = find_surface(positions, CELL_IN_RADII * self._radius)
        order = np.argsort(np.arange(len(visible)) % 2, kind="stable")
        visible, outward = visible[order], outward[order]
        sight = (eye - positions[visible]).astype(np.float32)
        seen = np.flatnonzero(np.einsum("nfd,nd->nf", self._outward[visible], sight) > 0.0)
        grain = seen // len(FACES)
        shown = visible[grain] * len(FACES) + seen % len(FACES)
        corners = self._faces[shown] + np.tile(positions[visible], 3)[grain]
        normals = self._normals[shown] + np.tile(HEAP * outward, 3)[grain]
        return corners.reshape(-1, 3).astype(np.float32), normals.reshape(-1, 3).astype(np.float32)


def read_facets(model: mujoco.MjModel, grain_count: int) -> Array:
    """Read the facets (grain_count, 24, 3) [m], about the origin, of the model's grains.
    Raises ValueError for a model without one skin of that many grains."""
    if grain_count == 0:
        return np.empty((0, GRAIN_VERTICES, 3))
    if model.nskin != 1 or model.nskinvert != grain_count * GRAIN_VERTICES:
        raise ValueError(f"the model has {model.nskin} skins with {model.nskinvert} vertices; {grain_count} grains "
                         f"need one with {grain_count * GRAIN_VERTICES}: call add_grain_skin(spec, {grain_count}, ...) "
                         f"first")
    return np.array(model.skin_vert, float).reshape(grain_count, GRAIN_VERTICES, 3)
