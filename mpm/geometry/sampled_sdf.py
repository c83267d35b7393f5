"""Signed distances sampled on a lattice."""

from collections.abc import Hashable
from typing import Any

import numpy as np
import trimesh

from mpm.backend import once, put, ti
from mpm.geometry.mesh_distance import wall_thickness
from mpm.geometry.shape import Shape, digest, sign


@ti.func
def trilinear(s: ti.template(), f, y):
    """Return the distance at a place f (3,), in spacings, of a lattice's cell near y (3,), and its slope by f.
    s: the distances at the cell's eight corners."""
    z = [[once(s[i][j][0] + f[2] * (s[i][j][1] - s[i][j][0])) for j in range(2)] for i in range(2)]
    y0 = z[0][0] + f[1] * (z[0][1] - z[0][0])
    y1 = z[1][0] + f[1] * (z[1][1] - z[1][0])
    slope = 0.0 * y
    slope[0] = y1 - y0
    slope[1] = (1 - f[0]) * (z[0][1] - z[0][0]) + f[0] * (z[1][1] - z[1][0])
    low = (1 - f[1]) * (s[0][0][1] - s[0][0][0]) + f[1] * (s[0][1][1] - s[0][1][0])
    high = (1 - f[1]) * (s[1][0][1] - s[1][0][0]) + f[1] * (s[1][1][1] - s[1][1][0])
    slope[2] = (1 - f[0]) * low + f[0] * high
    return y0 + f[0] * (y1 - y0), slope


@ti.func
def trilinear_back(s: ti.template(), f, y, normal_bar, phi_bar, least: ti.template()):
    """Return the adjoint, times a spacing, of y (3,) in a cell of a lattice: of the distance there and of its normal.
    s, f: as of `trilinear`. least: difference [m] of the distance over a spacing below which the normal is another one,
    which is taken to be constant."""
    x = [[once(s[1][j][k] - s[0][j][k]) for k in range(2)] for j in range(2)]
    xy = [once(x[1][k] - x[0][k]) for k in range(2)]
    xz = [once(x[j][1] - x[j][0]) for j in range(2)]
    yz = [once(s[i][1][1] - s[i][1][0] - s[i][0][1] + s[i][0][0]) for i in range(2)]
    mixed = ti.Vector([xy[0] + f[2] * (xy[1] - xy[0]), xz[0] + f[1] * (xz[1] - xz[0]), yz[0] + f[0] * (yz[1] - yz[0])])
    _, slope = trilinear(s, f, y)
    length = slope.norm(1e-12)
    slope_bar = (normal_bar - slope * (slope.dot(normal_bar) / (length * length))) / length
    if length < least:
        slope_bar = 0.0 * slope_bar
    bar = slope * phi_bar
    bar[0] += mixed[0] * slope_bar[1] + mixed[1] * slope_bar[2]
    bar[1] += mixed[0] * slope_bar[0] + mixed[2] * slope_bar[2]
    bar[2] += mixed[1] * slope_bar[0] + mixed[2] * slope_bar[1]
    return bar


class Sampled(Shape):
    """Base of solids whose array of numbers in single precision, `host`, is looked up in a field, `values`."""

    host: np.ndarray
    values: Any = None

    def allocate(self) -> None:
        """Copy the numbers to a field; needs a running backend."""
        self.values = ti.field(ti.f32, self.host.shape)
        put(self.values, self.host)

    def signature(self) -> Hashable:
        return sign(self, digest(self.host))


class Lattice(Sampled):
    """Distances sampled on a lattice, trilinear between its points; outside it, the distance from it is added."""

    def __init__(self, values: np.ndarray, lower: np.ndarray, spacing: float) -> None:
        self.host = np.asarray(values, np.float32)
        self.lower = tuple(float(c) for c in lower)
        self.spacing = float(spacing)
        corners = np.array([lower, np.asarray(lower) + (np.array(values.shape) - 1) * spacing])
        self.radius = float(np.linalg.norm(np.abs(corners).max(0)))
        ends = [np.take(self.host, place, axis) for axis in range(3) for place in (0, -1)]
        self.margin = float(min(end.min() for end in ends))
        """Distance [m] from the solid at the lattice's faces, at least."""
        self.parts: list[trimesh.Trimesh] = []  # the closed meshes that it was made from, if it was

    @ti.func
    def cell_at(self, y):
        """Return the values at the eight corners of the lattice's cell at y, and the place in it.
        Also returns how far y lies outside, in spacings."""
        u = ti.Vector([(y[d] - self.lower[d]) * (1.0 / self.spacing) for d in range(3)])
        last = ti.Vector([self.host.shape[d] - 1.0 for d in range(3)])
        held = ti.max(ti.min(u, last), 0.0 * u)
        c = ti.min(ti.cast(held, ti.i32), ti.cast(last, ti.i32) - 1)
        f = held - c
        s = [[[once(self.values[c[0] + i, c[1] + j, c[2] + k]) for k in range(2)] for j in range(2)] for i in range(2)]
        return s, f, u - held

    @ti.func
    def at(self, y):
        s, f, away = self.cell_at(y)
        phi, slope = trilinear(s, f, y)
        return slope / slope.norm(1e-12), phi + away.norm() * self.spacing

    @ti.func
    def is_beyond(self, y, reach):
        """Conservative early-out: look up the nearest point instead of eight.
        Outside, the solid is as far as the lattice, and `margin` more."""
        u = ti.Vector([(y[d] - self.lower[d]) * (1.0 / self.spacing) for d in range(3)])
        c = ti.Vector([ti.cast(u[d] + 0.5, ti.i32) for d in range(3)])
        shape = ti.static(self.host.shape)
        last = ti.Vector([shape[d] - 1.0 for d in range(3)])
        away = ti.max(ti.max(-u, u - last), 0.0 * u)
        far = self.margin + away.norm() * self.spacing > reach
        if c.min() >= 0 and c[0] < shape[0] and c[1] < shape[1] and c[2] < shape[2]:
            far = self.values[c[0], c[1], c[2]] > reach + 0.87 * self.spacing
        return far

    @ti.func
    def least_distance(self, y):
        """Return a lower bound [m] of the distance from y to the solid: within a spacing of it in the lattice."""
        s, _, away = self.cell_at(y)
        least = s[0][0][0]
        for i, j, k in ti.static(ti.ndrange(2, 2, 2)):
            least = ti.min(least, s[i][j][k])
        # the lattice's box holds the solid and is convex: beyond the box's nearest point it is farther by Pythagoras
        far = away.norm() * self.spacing
        return ti.select(far > 0.0, ti.sqrt(ti.max(least, 0.0) ** 2 + far * far), least)

    @ti.func
    def at_back(self, y, normal_bar, phi_bar, real: ti.template()):
        """Return the adjoint of y, exact for trilinear interpolation within a cell."""
        s, f, away = self.cell_at(y)
        bar, far = trilinear_back(s, f, y, normal_bar, phi_bar, 0.0), away.norm()
        for d in ti.static(range(3)):
            bar[d] = bar[d] / self.spacing if away[d] == 0 else away[d] / far * phi_bar
        return bar

    def near_inside(self, points: np.ndarray) -> np.ndarray:
        """Return which points (n, 3) [m] can be inside, by the nearest point of the lattice: much faster."""
        nearest = np.rint((points - self.lower) / self.spacing).astype(np.int32)
        near = np.flatnonzero(np.all((nearest >= 0) & (nearest < self.host.shape), axis=1))
        x, y, z = nearest[near].T
        return near[self.host[x, y, z] < 0.87 * self.spacing]

    def least_thickness(self) -> float:
        """Return the smallest thickness [m] of the meshes that it was made from; infinite without one."""
        return min((wall_thickness(part) for part in self.parts), default=np.inf)

    @property
    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Lower and upper corner [m] (3,) of the lattice in the frame, which hold the solid."""
        lower = np.asarray(self.lower, float)
        return lower, lower + self.spacing * (np.array(self.host.shape) - 1)

    def distance(self, points: np.ndarray) -> np.ndarray:
        from scipy.ndimage import map_coordinates

        u = (np.asarray(points) - self.lower) / self.spacing
        held = np.clip(u, 0.0, np.array(self.host.shape) - 1.0)
        inside = map_coordinates(self.host, held.T, order=1, mode="nearest")
        return inside + self.spacing * np.linalg.norm(u - held, axis=-1)
