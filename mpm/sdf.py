"""Signed distance of solids: analytic shapes, and lattices baked from meshes. Negative inside, metres.

Every shape has `radius`, of a ball about the frame's origin that holds the solid and the lattice around it, `at(y)`
for kernels and `distance(points)` for the host.
"""

import numpy as np
import trimesh

from mpm.backend import ti
from mpm.bake import passage_width, signed_distances
from mpm.errors import InvalidValue
from mpm.strain import keep

MAX_LATTICE = 40_000_000
"""Lattice points beyond which a spacing is refused: 160 MB."""


class Plane:
    """The half space below a plane through the frame's origin; the normal [-] (3,) points out of the solid."""

    radius = 1e6

    def __init__(self, normal: tuple[float, float, float] = (0.0, 0.0, 1.0)) -> None:
        self.normal = tuple(float(c) for c in np.asarray(normal) / np.linalg.norm(normal))

    @ti.func
    def at(self, y):
        n = ti.Vector([self.normal[0], self.normal[1], self.normal[2]])
        return n, y.dot(n)

    def distance(self, points: np.ndarray) -> np.ndarray:
        return points @ np.asarray(self.normal)


class Sphere:
    """A ball of radius r [m] about the frame's origin."""

    def __init__(self, r: float) -> None:
        self.r, self.radius = float(r), float(r)

    @ti.func
    def at(self, y):
        distance = y.norm(1e-12)
        return y / distance, distance - self.r

    def distance(self, points: np.ndarray) -> np.ndarray:
        return np.linalg.norm(points, axis=-1) - self.r


class Capsule:
    """Points within r [m] of the segment of half length h [m] along the frame's z axis."""

    def __init__(self, r: float, h: float) -> None:
        self.r, self.h, self.radius = float(r), float(h), float(r + h)

    @ti.func
    def at(self, y):
        rest = y
        rest[2] = y[2] - ti.math.clamp(y[2], -self.h, self.h)
        distance = rest.norm(1e-12)
        return rest / distance, distance - self.r

    def distance(self, points: np.ndarray) -> np.ndarray:
        rest = points - np.clip(points[..., 2:], -self.h, self.h) * [0.0, 0.0, 1.0]
        return np.linalg.norm(rest, axis=-1) - self.r


class Box:
    """A box of half sizes [m] (3,) about the frame's origin."""

    def __init__(self, half: tuple[float, float, float]) -> None:
        self.half = tuple(float(c) for c in half)
        self.radius = float(np.linalg.norm(half))

    @ti.func
    def at(self, y):
        # inside, the nearest face decides; outside, the offset from the nearest surface point
        out = ti.Vector([ti.abs(y[d]) - self.half[d] for d in ti.static(range(3))])
        side = ti.Vector([ti.select(y[d] < 0, -1.0, 1.0) for d in ti.static(range(3))])
        deepest = out.max()
        n = side * 0.0
        phi = deepest
        if deepest < 0:
            for d in ti.static(range(3)):
                if out[d] == deepest:
                    n = side * 0.0
                    n[d] = side[d]
        else:
            away = ti.max(out, 0.0)
            phi = away.norm(1e-12)
            n = side * away / phi
        return n, phi

    def distance(self, points: np.ndarray) -> np.ndarray:
        out = np.abs(points) - self.half
        return np.linalg.norm(np.maximum(out, 0.0), axis=-1) + np.minimum(out.max(-1), 0.0)


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


class Sdf:
    """Constructors of signed-distance shapes."""

    plane, sphere, box, capsule = Plane, Sphere, Box, Capsule

    @staticmethod
    def from_mesh(
        mesh: trimesh.Trimesh | list[trimesh.Trimesh], spacing: float = 1e-3, margin: float = 4e-3
    ) -> Lattice:
        """Lattice of the union of closed meshes, with `spacing` [m] between its points and `margin` [m] around them."""
        parts = mesh if isinstance(mesh, list) else [mesh]
        for part in parts:
            if not part.is_watertight:
                raise InvalidValue("Sdf.from_mesh: the mesh has open edges, and a solid is closed; close it, or make "
                                   "it a thin shell with Shell.from_mesh(mesh, thickness)")
        bounds = np.array([part.bounds for part in parts])
        lower = bounds[:, 0].min(0) - margin
        shape = np.ceil((bounds[:, 1].max(0) + margin - lower) / spacing).astype(int) + 1
        if np.prod(shape.astype(float)) > MAX_LATTICE:
            raise InvalidValue(f"Sdf.from_mesh: {tuple(shape)} lattice points; give a spacing above {spacing} m")
        values = np.min([signed_distances(part, lower, spacing, tuple(shape)) for part in parts], axis=0)
        lattice = Lattice(values, lower, spacing)
        lattice.passage = min(passage_width(part) for part in parts)
        return lattice
