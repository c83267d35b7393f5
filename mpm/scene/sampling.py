"""Initial positions of particles: jittered lattices in a box or a mesh."""

import numpy as np
import trimesh
from numpy.typing import ArrayLike

from mpm.errors import InvalidValue

JITTER = 0.25
"""Largest displacement of a particle from its lattice site, in spacings: breaks the lattice without making gaps."""
MAX_SITES = 20_000_000
"""Positions of a lattice: with 100 bytes each while they are made, 2 GB."""


def sample_box(lower: ArrayLike, upper: ArrayLike, spacing: float,
               rng: np.random.Generator | None = None) -> np.ndarray:
    """Return positions [m] (n, 3) on a lattice in the box from lower to upper [m].
    spacing: distance [m] between them, adjusted so that the box is filled. rng: displaces them at random, as grains
    need that flow: equal layers of a lattice move as one, and lose up to a fifth of their room
    (docs/concepts/limits.md); None: regular lattice. Raises InvalidValue for a spacing larger than the box."""
    lower, upper = np.asarray(lower, float), np.asarray(upper, float)
    if not 0 < spacing < np.inf or not np.all(upper - lower >= spacing):
        raise InvalidValue(f"spacing {spacing} m does not fit into the box {lower} .. {upper} m")
    # the spacing per axis that fills the box exactly: no half-empty layer at the upper faces
    sizes = np.maximum(np.round((upper - lower) / spacing), 1)
    if not np.prod(sizes) <= MAX_SITES:
        raise InvalidValue(f"spacing {spacing} m gives {np.prod(sizes):.3g} positions in the box {lower} .. {upper} m; "
                           f"accepted: up to {MAX_SITES}")
    counts = sizes.astype(int)
    axes = [low + (np.arange(n) + 0.5) * (high - low) / n for low, high, n in zip(lower, upper, counts)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3)
    if rng is not None:
        points += rng.uniform(-JITTER, JITTER, points.shape) * (upper - lower) / counts
    return points


def sample_mesh(mesh: trimesh.Trimesh, spacing: float, rng: np.random.Generator | None = None) -> np.ndarray:
    """Return positions [m] (n, 3) inside a watertight mesh; see `sample_box`. Raises InvalidValue for an open mesh."""
    if not mesh.is_watertight:
        raise InvalidValue("a body is sampled from a watertight mesh; this one has open edges")
    points = sample_box(mesh.bounds[0], mesh.bounds[1], spacing, rng)
    return points[mesh.contains(points)]
