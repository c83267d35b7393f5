"""Round columns of sand: the places of their particles, and the rim of their deposits."""

import math

import numpy as np

from mpm.scene.sampling import JITTER


def rim(radius: float, a: float) -> float:
    """Return the radius [m] of the deposit of a column of sand, a radii high.
    Source: fit of Lube et al. 2004, J. Fluid Mech. 508:175."""
    return radius * (1 + (1.24 * a if a < 1.7 else 1.6 * math.sqrt(a)))


def fill_column(radius: float, height: float, cell: float, rng: np.random.Generator, *, per_cell: int = 4,
                quarter: bool = True) -> np.ndarray:
    """Return positions [m] (n, 3) about the column's foot, jittered sites of a lattice of half cells.
    per_cell: 8 for all sites, 4 for the face-centred half, 2 for the body-centred quarter; the number of particles does
    not depend on the jitter."""
    half = cell / 2
    n, layers = math.ceil(radius / half), max(round(height / half), 2)
    sites = np.stack(np.meshgrid(*[np.arange(0 if quarter else -n, n)] * 2, np.arange(layers), indexing="ij"), -1)
    sites = sites.reshape(-1, 3)
    if per_cell == 4:
        sites = sites[sites.sum(1) % 2 == 0]
    elif per_cell == 2:
        sites = sites[np.all(sites % 2 == sites[:, :1] % 2, axis=1)]
    grains = (sites + 0.5) * (half, half, height / layers)
    grains = grains[np.hypot(grains[:, 0], grains[:, 1]) <= radius]
    return grains + rng.uniform(-JITTER, JITTER, grains.shape) * half
