"""Packings of particles, and the largest frequency of the grid that carries them, without the solver's own code."""

import itertools

import numpy as np

LEAST, CELLS = 0.3, 6
"""Smallest share of the stiffness; edge of the periodic box [cells]."""


class Stencils:
    """Nodes, weights and offsets of the quadratic B-splines at particles, in cells."""

    def __init__(self, places: np.ndarray) -> None:
        base = np.floor(places - 0.5).astype(int)
        f = places - base
        w = np.stack([0.5 * (1.5 - f) ** 2, 0.75 - (f - 1.0) ** 2, 0.5 * (f - 0.5) ** 2])
        steps = list(itertools.product(range(3), repeat=3))
        self.nodes = np.array([np.ravel_multi_index(tuple((base + s).T), (CELLS,) * 3, "wrap") for s in steps])
        self.weights = np.array([w[i, :, 0] * w[j, :, 1] * w[k, :, 2] for i, j, k in steps])
        self.offsets = np.array([np.array(s) - f for s in steps])
        self.masses = np.bincount(self.nodes.ravel(), self.weights.ravel(), CELLS**3)

    def around(self) -> np.ndarray:
        """Mass of the nodes around each particle, in masses of a particle."""
        return (self.weights * self.masses[self.nodes]).sum(0)


def largest_square(places: np.ndarray, per_cell: float, nu: float, passes: int = 60) -> float:
    """Return the square of the largest angular frequency, in those of a lone particle; by power iteration.
    Particles are as stiff as the material around them is dense."""
    s = Stencils(places)
    mu, lam, has_mass = 0.5 / (1 + nu), nu / ((1 + nu) * (1 - 2 * nu)), s.masses > 1e-12
    firm = np.clip(s.around() / per_cell, LEAST, 1.0)[:, None, None]
    gradient, square = 4.0 * s.weights[..., None] * s.offsets, 0.0
    v = np.random.default_rng(0).normal(size=(CELLS**3, 3))
    for _ in range(passes):
        v[~has_mass] = 0.0
        C = np.einsum("aps,apd->psd", v[s.nodes], gradient)
        tau = firm * (mu * (C + C.transpose(0, 2, 1)) + lam * np.trace(C, axis1=1, axis2=2)[:, None, None] * np.eye(3))
        force = np.einsum("psd,apd->aps", tau, gradient).reshape(-1, 3)
        u = np.stack([np.bincount(s.nodes.ravel(), force[:, c], CELLS**3) for c in range(3)], axis=1)
        u[has_mass] /= s.masses[has_mass, None]
        square = np.sqrt((u**2 * s.masses[:, None]).sum() / (v**2 * s.masses[:, None]).sum())
        v = u / np.abs(u).max()
    return square / (4.0 * (3 * lam + 2 * mu))


def packings(per_axis: int) -> dict[str, np.ndarray]:
    """Return places [cells] of beds, layers, slopes, clumps and lone particles, per_axis particles in CELLS."""
    rng = np.random.default_rng(1)
    line = (np.arange(per_axis) + 0.5) * CELLS / per_axis
    lattice = np.stack(np.meshgrid(line, line, line, indexing="ij"), -1).reshape(-1, 3)
    jittered = lattice + (rng.random(lattice.shape) - 0.5) * CELLS / per_axis
    x, y = jittered[:, 2], jittered[:, 1]
    per_cell = (per_axis / CELLS) ** 3
    return {"lattice": lattice, "jittered": jittered, "random": rng.random(lattice.shape) * CELLS,
            "thin layer": jittered[x < 1.0], "layer": jittered[x < 2.0], "slope": jittered[x + y < 4.0],
            "rod": jittered[(x < 2.0) & (y < 2.0)], "loose": rng.random((len(lattice) // 2, 3)) * CELLS,
            "rain": rng.random((len(lattice) // 50, 3)) * CELLS, "lone": np.array([[3.1, 3.2, 3.3]]),
            "clump": rng.random((round(3 * per_cell), 3)) * 0.4 + 3.2}
