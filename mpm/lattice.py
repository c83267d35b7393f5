"""Signed distances sampled on a lattice."""

import numpy as np

from mpm.backend import ti
from mpm.strain import keep


class Lattice:
    """Distances sampled on a lattice, trilinear between its points; 1 m outside it."""

    def __init__(self, values: np.ndarray, lower: np.ndarray, spacing: float) -> None:
        self.host = np.asarray(values, np.float32)
        self.lower = tuple(float(c) for c in lower)
        self.spacing = float(spacing)
        corners = np.array([lower, np.asarray(lower) + (np.array(values.shape) - 1) * spacing])
        self.radius = float(np.linalg.norm(np.abs(corners).max(0)))
        self.passage = np.inf
        """Narrowest gap [m] between its own walls, where it was made from a mesh."""
        self.values = None

    def allocate(self) -> None:
        """Copy the lattice to a field; needs a running backend."""
        if self.values is None:
            self.values = ti.field(ti.f32, self.host.shape)
            self.values.from_numpy(self.host)

    @ti.func
    def at(self, y):
        u = ti.Vector([(y[d] - self.lower[d]) / self.spacing for d in range(3)])
        n = y * 0.0
        phi = y[0] * 0.0 + 1.0
        shape = ti.static(self.host.shape)
        if u.min() >= 0 and u[0] < shape[0] - 1 and u[1] < shape[1] - 1 and u[2] < shape[2] - 1:
            c = ti.cast(u, ti.i32)
            f = u - c
            s = [[[keep(self.values[c[0] + i, c[1] + j, c[2] + k]) for k in range(2)] for j in range(2)]
                 for i in range(2)]
            z00 = s[0][0][0] + f[2] * (s[0][0][1] - s[0][0][0])
            z01 = s[0][1][0] + f[2] * (s[0][1][1] - s[0][1][0])
            z10 = s[1][0][0] + f[2] * (s[1][0][1] - s[1][0][0])
            z11 = s[1][1][0] + f[2] * (s[1][1][1] - s[1][1][0])
            y0 = z00 + f[1] * (z01 - z00)
            y1 = z10 + f[1] * (z11 - z10)
            phi = y0 + f[0] * (y1 - y0)
            n[0] = y1 - y0
            n[1] = (1 - f[0]) * (z01 - z00) + f[0] * (z11 - z10)
            low = (1 - f[1]) * (s[0][0][1] - s[0][0][0]) + f[1] * (s[0][1][1] - s[0][1][0])
            high = (1 - f[1]) * (s[1][0][1] - s[1][0][0]) + f[1] * (s[1][1][1] - s[1][1][0])
            n[2] = (1 - f[0]) * low + f[0] * high
            n = n / n.norm(1e-12)
        return n, phi

    def distance(self, points: np.ndarray) -> np.ndarray:
        """Distances [m] (n,) at points (n, 3) in the frame; 1 m outside the lattice."""
        from scipy.ndimage import map_coordinates

        u = (np.asarray(points) - self.lower) / self.spacing
        return map_coordinates(self.host, u.T, order=1, mode="constant", cval=1.0)
